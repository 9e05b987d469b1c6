"""Derived quantities and their covariance, members that nothing mentions, degrees of freedom."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from tests.noise.peer import linear, solved, table

RANDOM = np.random.default_rng(6)
X = np.linspace(0.0, 4.0, 9)
Y = 1.0 + 0.5 * X + RANDOM.normal(0, 0.1, X.size)
DATA = table("t", x=X, y=Y)
LINE = np.column_stack([np.ones_like(X), X])
FIT = linear(LINE, Y, np.full(9, 0.1))
HEAD = f"(problem p {DATA} (unknowns (a :init 0) (b :init 0)) (observe t (= y (+ a (* b x))) :sigma 0.1)"


def test_over_a_table_gives_one_value_for_each_row():
    result = solved(
        f"{HEAD} (data at (table (name v) (n1 0) (n2 2.5) (n3 10)) :key name) (derive (f (+ a (* b v)) :over at)))"
    )
    rows = np.column_stack([np.ones(3), [0, 2.5, 10]])
    np.testing.assert_allclose(result["f"].value, rows @ FIT.x, rtol=1e-10)
    covariance = rows @ FIT.covariance @ rows.T
    np.testing.assert_allclose(result["f"].sigma, np.sqrt(np.diag(covariance)), rtol=1e-10)
    assert result["f"].keys == ("n1", "n2", "n3")
    np.testing.assert_allclose(result.first.derived_covariance.matrix, covariance, rtol=1e-9)


def test_later_quantities_see_earlier_ones_with_their_correlation():
    result = solved(f"{HEAD} (derive (zero (- (/ a b))) (shifted (+ zero 3)) (gap (- shifted zero)) (v [zero a])))")
    a, b = FIT.x
    slope = np.array([-1 / b, a / b**2])
    spread = np.sqrt(slope @ FIT.covariance @ slope)
    assert float(result["zero"].value) == pytest.approx(-a / b, rel=1e-10)
    assert float(result["zero"].sigma) == pytest.approx(spread, rel=1e-10)
    assert float(result["shifted"].sigma) == pytest.approx(spread, rel=1e-10)
    assert float(result["gap"].value) == pytest.approx(3, rel=1e-12)
    # The two are fully correlated: what is left is rounding.
    assert float(result["gap"].sigma) == pytest.approx(0, abs=1e-8)
    np.testing.assert_allclose(result["v"].sigma, [spread, FIT.sigma[0]], rtol=1e-10)


def test_covariance_of_derived_quantities():
    result = solved(f"{HEAD} (derive (s (+ a b)) (d (- a (* 2 b)))))")
    rows = np.array([[1.0, 1.0], [1.0, -2.0]])
    found = result.document()["solves"][0]
    np.testing.assert_allclose(result.first.derived_covariance.matrix, rows @ FIT.covariance @ rows.T, rtol=1e-10)
    assert found["derived"]["s"]["sigma"] == pytest.approx(np.sqrt((rows @ FIT.covariance @ rows.T)[0, 0]), rel=1e-10)


FAMILY = """(problem p (data s (table (k) (1) (2) (3)) :key k)
  (data t (table (s y) (1 2.0) (2 3.0) (1 2.2) (2 3.3) (1 1.9)))
  (unknowns (q :per s :init 0.5))
  (observe t (= y (q s)) {noise})
  (derive (twice (* 2 (q k)) :over s) (of-one (q 1)) (of-three (+ (q 1) (q 3)))))"""


@pytest.mark.parametrize(("noise", "scale"), [(":sigma 0.2", None), ("", 1.0)])
def test_member_that_no_equation_mentions_and_what_is_derived_from_it(noise, scale):
    result = solved(FAMILY.format(noise=noise))
    first, second = np.array([2.0, 2.2, 1.9]), np.array([3.0, 3.3])
    squares = np.square(first - first.mean()).sum() + np.square(second - second.mean()).sum()
    sigma = 0.2 if scale is None else np.sqrt(squares / 3)
    spreads = sigma / np.sqrt([3, 2])
    np.testing.assert_allclose(result["q"].value[:2], [first.mean(), second.mean()], rtol=1e-12)
    np.testing.assert_allclose(result["q"].sigma[:2], spreads, rtol=1e-10)
    # It keeps its start, has no sigma, and is listed; it makes the others no worse.
    assert result["q"].value[2] == 0.5
    assert np.isnan(result["q"].sigma[2])
    assert result.observability.unused == ("q[3]",)
    assert (result.status, result.first.dof, result.observability.rank) == ("ok", 3, 2)
    np.testing.assert_allclose(result["twice"].sigma[:2], 2 * spreads, rtol=1e-10)
    assert np.isnan(result["twice"].sigma[2])
    assert float(result["of-one"].sigma) == pytest.approx(spreads[0], rel=1e-10)
    assert np.isnan(result["of-three"].sigma)


def test_degrees_of_freedom_count_scalars_priors_and_the_rank():
    result = solved(f"""(problem p {DATA} (unknowns (a :init 1 :sigma 5) (b :init 0) (c :init 0))
      (observe t (= [y x] [(+ a (* b x)) (+ x c)]) :sigma [0.1 0.2] :when (< x 3.2)))""")
    kept = X < 3.2
    assert result.first.dof == 2 * kept.sum() + 1 - 3
    matrix = np.vstack([LINE[kept], [1.0, 0.0]])
    fit = linear(matrix, np.append(Y[kept], 1.0), np.append(np.full(kept.sum(), 0.1), 5.0))
    assert result.first.cost == pytest.approx(fit.cost, rel=1e-10)
    assert result.first.sigma0 == pytest.approx(np.sqrt(fit.cost / result.first.dof), rel=1e-10)
    assert result.first.chi2_p == pytest.approx(chi2.sf(fit.cost, result.first.dof), rel=1e-8)


def test_rank_and_not_the_number_of_unknowns_counts_where_something_is_free():
    """a and b only as a product, c as well: rank 2 of 3."""
    result = solved(f"""(problem p {DATA} (unknowns (a :init 1) (b :init 1) (c :init 0))
      (observe t (= y (+ (* a b) (* c x))) :sigma 0.1)
      (derive (product (* a b))))""")
    assert (result.status, result.first.status) == ("attention", "unobservable")
    assert (result.observability.rank, result.first.dof) == (2, 7)
    assert result.first.cost == pytest.approx(FIT.cost, rel=1e-9)
    assert np.isnan(result["a"].sigma)
    assert np.isnan(result["b"].sigma)
    assert float(result["c"].sigma) == pytest.approx(FIT.sigma[1], rel=1e-8)
    # What the free motion leaves unchanged keeps its sigma.
    assert float(result["product"].value) == pytest.approx(FIT.x[0], rel=1e-9)
    assert float(result["product"].sigma) == pytest.approx(FIT.sigma[0], rel=1e-8)
