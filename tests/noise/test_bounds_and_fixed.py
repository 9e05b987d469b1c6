"""Hard bounds by their Kuhn-Tucker conditions, and what is held fixed leaves the Jacobian."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from tests.noise.peer import linear, solved, table, values

RANDOM = np.random.default_rng(4)
X = np.linspace(-1.0, 2.0, 14)
Y = 0.4 + 1.1 * X - 0.7 * X**2 + RANDOM.normal(0, 0.2, X.size)
DATA = table("t", x=X, y=Y, g=np.arange(14) % 3)
POWERS = np.column_stack([np.ones_like(X), X, X**2])
MODEL = "(observe t (= y (+ a (* b x) (* c x x))) :sigma 0.2)"
BOXES = [
    ((-10, -10, -10), (10, 10, 10)), ((0.6, -10, -10), (10, 10, 10)), ((-10, -10, -10), (10, 0.8, -0.9)),
    ((0, 1.5, -0.2), (0.1, 3, 1)), ((-1, 0, -0.5), (0.3, 0.9, 0)),
]  # fmt: skip


@pytest.mark.parametrize(("lower", "upper"), BOXES)
def test_minimum_in_a_box_meets_the_kuhn_tucker_conditions(lower, upper):
    box = dict(zip("abc", zip(lower, upper, strict=True), strict=True))
    unknowns = " ".join(f"({n} :init {(lo + hi) / 2} :in ({lo} {hi}))" for n, (lo, hi) in box.items())
    result = solved(f"(problem p {DATA} (unknowns {unknowns}) {MODEL})")
    x = values(result, "a", "b", "c")
    gradient = POWERS.T @ (POWERS @ x - Y) / 0.04
    low, high = x <= np.array(lower) + 1e-12, x >= np.array(upper) - 1e-12
    free = ~(low | high)
    # Gradients of free coordinates vanish beside 1/sigma² times the data; at a bound they push outwards.
    assert np.abs(gradient[free]).max(initial=0) < 1e-8
    assert (gradient[low] > 0).all()
    assert (gradient[high] < 0).all()
    peer = lsq_linear(POWERS, Y, bounds=(lower, upper), method="bvls", tol=1e-14)
    np.testing.assert_allclose(x, peer.x, atol=1e-10)
    # What is held at a bound has no sigma; the others have that of the problem without it.
    found = np.array([float(result[n].sigma) for n in "abc"])
    assert np.isnan(found).tolist() == (~free).tolist()
    expected = np.sqrt(np.diag(np.linalg.inv(POWERS[:, free].T @ POWERS[:, free] / 0.04)))
    np.testing.assert_allclose(found[free], expected, rtol=1e-9)


def test_bounds_of_vectors_are_vectors_or_broadcast():
    for box, upper in (("[-9 -9 -9] [9 0.8 9]", (9, 0.8, 9)), ("-9 0.8", (0.8, 0.8, 0.8))):
        result = solved(f"""(problem p {DATA} (unknowns (p (vector 3) :init 0 :in ({box})))
          (observe t (= y (+ (p 1) (* (p 2) x) (* (p 3) x x))) :sigma 0.2))""")
        peer = lsq_linear(POWERS, Y, bounds=((-9,) * 3, upper), method="bvls", tol=1e-14)
        np.testing.assert_allclose(result["p"].value, peer.x, atol=1e-10)


def test_bounds_for_each_member_of_a_family():
    result = solved(f"""(problem p (data s (table (k hi) (0 0.1) (1 9) (2 9)) :key k) {DATA}
      (unknowns (m :per s :init 0 :in (-9 hi)))
      (observe t (= y (m g)) :sigma 0.2))""")
    means = np.array([Y[np.arange(14) % 3 == k].mean() for k in range(3)])
    np.testing.assert_allclose(result["m"].value, np.minimum(means, [0.1, 9, 9]), atol=1e-12)


def test_positive_unknown_stays_above_zero():
    result = solved(f"""(problem p {DATA} (unknowns (a positive :init 1))
      (observe t (= y (- a 20)) :sigma 0.2))""")
    assert float(result["a"].value) == pytest.approx(Y.mean() + 20, rel=1e-12)
    drawn = solved(f"(problem p {DATA} (unknowns (a positive :init 1)) (observe t (= y (+ a 20)) :sigma 0.2))")
    assert 0 < float(drawn["a"].value) < 1e-6


@pytest.mark.parametrize(
    ("unknowns", "held"),
    [
        ("(a :init 0) (b :init 1.3 :fixed true) (c :init 0)", {1: 1.3}),
        ("(a :init 0.5 :fixed true) (b :init 1.3 :fixed (< 1 2)) (c :init 0)", {0: 0.5, 1: 1.3}),
        ("(a :init 0) (b :init 0) (c :init 0 :fixed false)", {}),
    ],
)
def test_fixed_numbers(unknowns, held):
    result = solved(f"(problem p {DATA} (unknowns {unknowns}) {MODEL} (derive (f (+ a b c))))")
    free = [i for i in range(3) if i not in held]
    fit = linear(POWERS[:, free], Y - POWERS[:, list(held)] @ list(held.values()), np.full(14, 0.2))
    found = values(result, "a", "b", "c")
    np.testing.assert_allclose(found[free], fit.x, rtol=1e-10)
    np.testing.assert_array_equal(found[list(held)], list(held.values()))
    assert [float(result["abc"[i]].sigma) for i in held] == [0] * len(held)
    assert result.covariance.names == tuple("abc"[i] for i in free)
    np.testing.assert_allclose(result.covariance.matrix, fit.covariance, rtol=1e-10)
    assert result.first.dof == 14 - len(free)
    spread = np.sqrt(fit.covariance.sum())
    assert float(result["f"].sigma) == pytest.approx(spread, rel=1e-10)


def test_fixed_elements_of_a_vector():
    result = solved(f"""(problem p {DATA} (unknowns (p (vector 3) :init [0 1.3 0] :fixed [false true false]))
      (observe t (= y (+ (p 1) (* (p 2) x) (* (p 3) x x))) :sigma 0.2))""")
    fit = linear(POWERS[:, [0, 2]], Y - 1.3 * X, np.full(14, 0.2))
    np.testing.assert_allclose(result["p"].value, [fit.x[0], 1.3, fit.x[1]], rtol=1e-10)
    np.testing.assert_allclose(result["p"].sigma, [fit.sigma[0], 0, fit.sigma[1]], rtol=1e-10)
    assert result.covariance.names == ("p[1]", "p[3]")


def test_fixed_by_a_form_for_each_member():
    result = solved(f"""(problem p (data s (table (k v) (0 0.25) (1 0) (2 0)) :key k) {DATA}
      (unknowns (m :per s :init v :fixed (< 0 v)))
      (observe t (= y (m g)) :sigma 0.2))""")
    means = [Y[np.arange(14) % 3 == k].mean() for k in (1, 2)]
    np.testing.assert_allclose(result["m"].value, [0.25, *means], rtol=1e-12)
    np.testing.assert_allclose(result["m"].sigma, [0, 0.2 / np.sqrt(5), 0.2 / np.sqrt(4)], rtol=1e-12)
    assert result.covariance.names == ("m[1]", "m[2]")


@pytest.mark.parametrize("start", [-4.6, -0.3, 0.1, 1e-9, 0.55, -1234.5])
@pytest.mark.parametrize("bound", [0.8, 1 / 3, 0.1 + 0.6])
def test_estimate_at_a_bound_is_the_bound_to_the_last_bit(start, bound):
    """start + (bound − start) may fall short of the bound by a rounding, and would then count as free."""
    result = solved(f"(problem p (unknowns (a :init {start!r} :in (-1e4 {bound!r}))) (observe (= 5 a) :sigma 1))")
    assert float(result["a"].value) == bound
    assert np.isnan(result["a"].sigma)
