"""Derived quantities whose derivative is zero at the estimates: standard deviations of 0 are doubted."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, norm, t

import mbm

ONE = """(problem p (data d (table (y) (0.1) (-0.1))) (unknowns (b)) (observe d (= y b) :sigma 0.1)
  (derive (size (abs b)) (square (* b b)) (cosine (cos b)) (line (* 3 b)) (still (* 0 b))))"""
TWO = """(problem p (data d (table (y z) (0.1 0.2) (-0.1 -0.2))) (unknowns (b) (c)) (observe d (= [y z] [b c]))
  (derive (product (* b c)) (form (+ (* b b) (* 2 c c) (* b c)))))"""


def doubted(solve: mbm.Solve) -> set[str]:
    said = " ".join(d.message for d in solve.diagnostics if d.code.name == "too-nonlinear")
    return {name for name in solve if f"`{name}` beyond its width of 0" in said}


def test_one_estimate() -> None:
    solve = mbm.loads(ONE).solve().first
    reach = norm.ppf(0.975) * 0.1 / np.sqrt(2.0)
    assert doubted(solve) == {"size", "square", "cosine"}
    for name, ends in (("size", [0, reach]), ("square", [0, reach**2]), ("cosine", [np.cos(reach), 1])):
        assert solve[name].sigma == pytest.approx(0.0, abs=1e-12)
        np.testing.assert_allclose(solve[name].interval(0.95), ends, rtol=1e-3, atol=1e-12)
    np.testing.assert_allclose(solve["line"].interval(0.95), [-3 * reach, 3 * reach], rtol=1e-6)


def test_forms_of_two_estimates_with_the_noise_unknown() -> None:
    """Within a circle of the radius r a quadratic form reaches from λ₁ r² (or 0) to λ₂ r²."""
    solve = mbm.loads(TWO).solve().first
    square = (t.ppf(0.975, 2) * np.sqrt(0.1 / 2 / 2)) ** 2
    assert doubted(solve) == {"product", "form"}
    np.testing.assert_allclose(solve["product"].interval(0.95), [-square / 2, square / 2], rtol=1e-3)
    np.testing.assert_allclose(solve["form"].interval(0.95), [0, square * (3 + np.sqrt(2)) / 2], rtol=1e-3, atol=1e-9)


def test_what_a_constraint_determines_is_not_doubted() -> None:
    text = """(problem p (data d (table (y z) (1 2) (1.1 2.1))) (unknowns (b) (c))
      (observe d (= [y z] [b c]) :sigma 0.1)
      (constraints (= (+ b c) 3)) (derive (square (^ (+ b c) 2))))"""
    assert not doubted(mbm.loads(text).solve().first)


def test_many_keys_say_what_each_says() -> None:
    each = "(k y) (1 0.1) (1 -0.1) (2 0.3) (2 0.1) (3 0.5) (3 0.4) (4 0.2) (4 -0.2)"
    text = ONE.replace("(y) (0.1) (-0.1)", each).replace("(unknowns", "(for-each k) (unknowns")
    solves = mbm.loads(text).solve().solves
    flat = {"size", "square", "cosine"}
    assert [doubted(solve) for solve in solves] == [flat, set(), set(), flat]
    reach = norm.ppf(0.975) * 0.1 / np.sqrt(2.0)
    np.testing.assert_allclose(solves[3]["square"].interval(0.95), [0, reach**2], rtol=1e-3, atol=1e-12)


def test_the_scatter_about_a_line():
    """Least squares make it least: its derivative is zero but for roundings. At an end all 95 % go into the slopes.

    With χ² about the minimum, n·rms² = SSE + (1.96 σ)² at the farthest point of the 95 % interval of one direction.
    """
    text = """(problem p (data d (table (x y) (0 1.1) (1 2.2) (2 2.9) (3 4.2))) (unknowns (a) (b))
      (observe d (= y (+ a (* b x))) :sigma 0.1) (derive (r (rms d (- y (+ a (* b x)))))))"""
    x, y = np.arange(4.0), np.array([1.1, 2.2, 2.9, 4.2])
    scatter = np.sum(np.square(y - np.polyval(np.polyfit(x, y, 1), x)))
    farthest = np.sqrt((scatter + 0.1**2 * chi2.ppf(0.95, 1)) / 4)
    result = mbm.loads(text).solve()
    np.testing.assert_allclose(result["r"].interval(), [np.sqrt(scatter / 4), farthest], rtol=1e-6)
    assert "derivative is zero" in next(d.message for d in result.diagnostics if d.code.name == "too-nonlinear")
