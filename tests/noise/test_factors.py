"""Noise that the data tell: one factor in closed form, several by Helmert's equations, and what cannot be told."""

from __future__ import annotations

import numpy as np
import pytest

from tests.noise.peer import check, helmert, linear, matrix_text, sigmas, solved, table, values

RANDOM = np.random.default_rng(5)
X = np.linspace(0.0, 5.0, 16)
Y = 1.5 + 0.8 * X + RANDOM.normal(0, 0.2, X.size)
Z = 0.5 - 1.2 * X + RANDOM.normal(0, 1.5, X.size)
W = 2.0 + 0.5 * X + RANDOM.normal(0, 0.05, X.size)
S = RANDOM.uniform(0.5, 2.0, X.size)
DATA = table("t", x=X, y=Y, z=Z, w=W, s=S)
LINE = np.column_stack([np.ones_like(X), X])
OTHER = LINE * [0.4, -1.0]
UNKNOWNS = "(unknowns (a :init 0) (b :init 0))"
FIXED_POINT = 1e-7
"""Relative: the iteration ends when factors move by less than 1e-9, and converges linearly."""


def problem(observe, rest=""):
    return solved(f"(problem p {DATA} {UNKNOWNS} {observe} {rest})")


@pytest.mark.parametrize(
    ("noise", "stated"),
    [
        ("", np.ones(16)),
        (":sigma unknown", np.ones(16)),
        (":sigma (unknown 0.1)", np.full(16, 0.1)),
        (":sigma (unknown s)", S),
    ],
)
def test_one_factor_is_the_root_of_sse_over_redundancy(noise, stated):
    result = problem(f"(observe t (= y (+ a (* b x))) {noise})")
    fit = linear(LINE, Y, stated)
    factor = np.sqrt(fit.cost / 14)
    check(result, fit, "a", "b", scale=factor)
    solve = result.first
    assert solve.noise["t"] == pytest.approx(factor, rel=1e-12)
    # A single unknown factor counts as 1 in the cost; there is nothing left to test.
    assert solve.cost == pytest.approx(fit.cost, rel=1e-12)
    assert solve.sigma0 == pytest.approx(factor, rel=1e-12)
    assert (solve.dof, solve.chi2_p) == (14, None)


def test_factor_of_a_vector_with_unequal_components():
    result = problem("(observe t (= [y z] [(+ a (* b x)) (- (* 0.4 a) (* b x))]) :sigma (unknown [0.2 1.5]))")
    matrix = np.stack([LINE, OTHER], axis=1).reshape(-1, 2)
    fit = linear(matrix, np.column_stack([Y, Z]).ravel(), np.tile([0.2, 1.5], 16))
    check(result, fit, "a", "b", scale=np.sqrt(fit.cost / 30))


def test_several_factors_are_those_of_helmerts_equations():
    result = problem("""
      (observe one t (= y (+ a (* b x))))
      (observe two t (= z (- (* 0.4 a) (* b x))) :sigma (unknown s))""")
    matrix, right = np.vstack([LINE, OTHER]), np.append(Y, Z)
    sigma, groups = np.append(np.ones(16), S), (np.arange(16), np.arange(16, 32))
    factors = helmert(matrix, right, sigma, groups)
    found = [result.first.noise["one"], result.first.noise["two"]]
    np.testing.assert_allclose(found, factors, rtol=FIXED_POINT)
    fit = linear(matrix, right, sigma * np.repeat(factors, 16))
    check(result, fit, "a", "b", rtol=FIXED_POINT)
    # Several factors count with their final values: the cost is then the redundancy.
    assert result.first.cost == pytest.approx(30, rel=FIXED_POINT)
    assert result.first.chi2_p is None


def test_unknown_factors_beside_stated_noise():
    result = problem("""
      (observe known t (= w (+ 2 (* 0.5 x) (* 0.1 (- a 1.5)))) :sigma 0.05)
      (observe one t (= y (+ a (* b x))) :sigma (unknown s))
      (observe two t (= z (- (* 0.4 a) (* b x))))""")
    matrix = np.vstack([np.column_stack([np.full(16, 0.1), np.zeros(16)]), LINE, OTHER])
    right = np.concatenate([W - 2 - 0.5 * X + 0.15, Y, Z])
    sigma = np.concatenate([np.full(16, 0.05), S, np.ones(16)])
    groups = (np.arange(16, 32), np.arange(32, 48))
    factors = helmert(matrix, right, sigma, groups)
    found = [result.first.noise["one"], result.first.noise["two"]]
    np.testing.assert_allclose(found, factors, rtol=FIXED_POINT)
    assert result.first.noise["known"] is None
    fit = linear(matrix, right, sigma * np.repeat([1.0, *factors], 16))
    check(result, fit, "a", "b", rtol=FIXED_POINT)


def test_one_factor_beside_a_prior_does_not_scale_the_prior():
    result = solved(f"""(problem p {DATA} (unknowns (a :init 1.4 :sigma 0.05) (b :init 0))
      (observe t (= y (+ a (* b x)))))""")
    matrix, right = np.vstack([LINE, [1.0, 0.0]]), np.append(Y, 1.4)
    sigma = np.append(np.ones(16), 0.05)
    (factor,) = helmert(matrix, right, sigma, (np.arange(16),))
    assert result.first.noise["t"] == pytest.approx(factor, rel=FIXED_POINT)
    fit = linear(matrix, right, np.append(np.full(16, factor), 0.05))
    check(result, fit, "a", "b", rtol=FIXED_POINT)
    # The single unknown factor counts as 1 in the cost, the prior with its own sigma.
    misfit = (matrix @ fit.x - right) / sigma
    assert result.first.cost == pytest.approx(misfit @ misfit, rel=FIXED_POINT)


def test_noise_without_redundancy_is_not_made_up():
    result = solved(f"""(problem p {table("t", x=[0, 2], y=[1, 5])} {UNKNOWNS}
      (observe t (= y (+ a (* b x))))
      (derive (twice (* 2 a)) (number 3.5)))""")
    np.testing.assert_allclose(values(result, "a", "b"), [1, 2], atol=1e-12)
    assert np.isnan(sigmas(result, "a", "b")).all()
    solve = result.first
    assert (solve.dof, solve.sigma0, solve.chi2_p, solve.noise["t"]) == (0, None, None, None)
    assert [d.code.name for d in solve.diagnostics] == ["noise-not-estimated"]
    assert float(result["twice"].value) == pytest.approx(2, abs=1e-12)
    assert np.isnan(result["twice"].sigma)
    document = result.document()["solves"][0]
    assert document["estimates"]["a"]["sigma"] is None
    assert float(result["number"].value) == 3.5


def test_only_what_depends_on_untold_noise_is_left_open():
    """One row alone determines c; the others tell their own noise."""
    result = solved(f"""(problem p {DATA} (unknowns (a :init 0) (b :init 0) (c :init 0))
      (observe line t (= y (+ a (* b x))))
      (observe alone (= 7 c))
      (derive (sum (+ a b)) (mixed (+ a c))))""")
    fit = linear(LINE, Y, np.ones(16))
    factor = np.sqrt(fit.cost / 14)
    np.testing.assert_allclose(values(result, "a", "b", "c"), [*fit.x, 7], rtol=1e-10)
    np.testing.assert_allclose(sigmas(result, "a", "b"), factor * fit.sigma, rtol=FIXED_POINT)
    assert np.isnan(result["c"].sigma)
    ones = np.ones(2)
    assert float(result["sum"].sigma) == pytest.approx(factor * np.sqrt(ones @ fit.covariance @ ones), rel=FIXED_POINT)
    assert np.isnan(result["mixed"].sigma)
    assert "noise-not-estimated" in [d.code.name for d in result.first.diagnostics]


def test_exact_data_have_no_noise():
    result = solved(f"""(problem p {table("t", x=[0, 1, 2, 3], y=[1, 3, 5, 7])} {UNKNOWNS}
      (observe t (= y (+ a (* b x)))))""")
    np.testing.assert_allclose(values(result, "a", "b"), [1, 2], atol=1e-13)
    assert (sigmas(result, "a", "b") == 0).all()
    assert [d.code.name for d in result.first.diagnostics] == ["noise-not-estimated"]


LOOPS = ((0.7, 1e8, 1.9), (0.7, 1.0, 1.9), (0.7, 1e-8, 1.9), (0.75, 1.0, 2.0), (0.7, 1.0, 1.91))
"""The second and third rise of a loop whose first is 1.2 or 1.25, and what they are multiplied by."""


@pytest.mark.parametrize(("second", "unit", "third"), LOOPS)
@pytest.mark.parametrize("rest", ["", "(for-each k)"])
def test_a_loop_that_closes_but_for_rounding_tells_no_noise(second, unit, third, rest):
    first = third - second if third != 1.91 else 1.2
    rises = unit * np.round([first, second, third], 2)
    result = solved(f"""(problem p {table("d", k=[1, 1, 1], a=[1, 2, 1], b=[2, 3, 3], y=rises)}
      (unknowns (h :per (d.a d.b))) (observe d (= y (- (h b) (h a)))) (observe mark (= {10 * unit} (h 1)) :sigma 0.01)
      {rest})""")
    solve = result.solves[0]
    assert solve.status.name == "CONVERGED"
    np.testing.assert_allclose(solve["h"].value, 10 * unit + np.array([0, first, third]) * unit, rtol=1e-3)
    assert solve["h"].sigma[0] == pytest.approx(0.01, rel=1e-6)
    closes = third != 1.91
    assert np.isnan(solve["h"].sigma[1:]).all() == closes
    assert [d.code.name for d in solve.diagnostics] == ["noise-not-estimated"] * closes
    # The closing error is shared by three rises alike: s² is its square over 3.
    assert solve.noise["d"] == (None if closes else pytest.approx(0.01 / np.sqrt(3), rel=1e-6))


def test_nonlinear_covariance_under_unknown_noise():
    """Jacobian at the minimum by hand: y = a exp(b x)."""
    y = 2 * np.exp(-0.4 * X) + RANDOM.normal(0, 0.01, 16)
    result = solved(f"""(problem p {table("t", x=X, y=y)} (unknowns (a :init 1) (b :init -0.1))
      (observe t (= y (* a (exp (* b x)))) :sigma unknown)
      (derive (half (/ (log 1/2) b))))""")
    a, b = values(result, "a", "b")
    jacobian = np.column_stack([np.exp(b * X), a * X * np.exp(b * X)])
    rest = a * np.exp(b * X) - y
    # A minimum: the residuals are orthogonal to the model's slopes, to the iteration's last digits.
    assert np.abs(jacobian.T @ rest).max() < 1e-9
    expected = (rest @ rest / 14) * np.linalg.inv(jacobian.T @ jacobian)
    np.testing.assert_allclose(result.covariance.matrix, expected, rtol=1e-8)
    slope = -np.log(0.5) / b**2
    assert float(result["half"].sigma) == pytest.approx(slope * np.sqrt(expected[1, 1]), rel=1e-8)


def test_full_covariance_is_never_scaled():
    covariance = np.array([[4e-4, 1e-4], [1e-4, 2.0]])
    result = problem(f"""(observe t (= [y z] [(+ a (* b x)) (- (* 0.4 a) (* b x))])
      :covariance {matrix_text(covariance)})""")
    matrix = np.stack([LINE, OTHER], axis=1).reshape(-1, 2)
    fit = linear(matrix, np.column_stack([Y, Z]).ravel(), np.kron(np.eye(16), covariance))
    assert fit.cost > 10 * 30  # far too small a stated noise
    check(result, fit, "a", "b")
    assert result.first.chi2_p < 1e-10
