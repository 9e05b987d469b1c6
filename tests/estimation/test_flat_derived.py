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


BROKEN = """(problem p (data d (table ({columns}) {rows})) (unknowns (a) (b)) (observe d (= [y z] [a b]) :sigma 0.1)
  (derive (side (sign b)) (whole (floor (* 10 b))) (switched (if (> b 0) a (* 2 a))) (larger (max a b))
    (root (sqrt (* b b))) (line (+ a b))) {more})"""
REACH = float(norm.ppf(0.975)) * 0.1


@pytest.mark.parametrize("many", [False, True])
def test_jumps_within_the_interval(many: bool) -> None:
    """Of a = 0.3 and b = 0.05, each ± 0.1; ``switched`` is told as far as pairs of axes lead: 2 (a + r/√2)."""
    text = BROKEN.format(columns="y z", rows="(0.3 0.05)", more="")
    if many:
        text = BROKEN.format(columns="k y z", rows="(1 0.3 5) (2 0.3 0.05) (3 0.3 5)", more="(for-each k)")
    solves = mbm.loads(text).solve().solves
    solve = solves[1 if many else 0]
    wanted = {
        "side": (-1.0, 1.0),
        "whole": (-2.0, 2.0),
        "root": (0.0, 0.05 + REACH),
        "larger": (0.3 - REACH, 0.3 + REACH),
    }
    for name, ends in wanted.items():
        np.testing.assert_allclose(solve[name].interval(0.95), ends, rtol=1e-3, atol=1e-4)
    low, high = solve["switched"].interval(0.95)
    assert low == pytest.approx(0.3 - REACH, rel=1e-3)
    assert 2.0 * (0.3 + REACH / np.sqrt(2.0)) <= high <= 2.0 * (0.3 + REACH)
    said = " ".join(d.message for d in solve.diagnostics if d.code.name == "too-nonlinear")
    assert all(f"`{name}`" in said for name in ("side", "whole", "switched", "root"))
    assert "`larger`" not in said
    assert "`line`" not in said
    if many:  # 50 ± 1.96 has whole parts, and nothing else of it bends
        assert all("`whole`" in d.message and "`side`" not in d.message for d in solves[0].diagnostics)


def test_rows_that_follow_several_formulas_are_looked_at() -> None:
    text = """(problem p (data d (table (k t) ("u" 1) ("v" 2))) (unknowns (a) (b)) (observe (= 0.3 a) :sigma 0.1)
      (observe (= 0.05 b) :sigma 0.1) (derive (q (if (= k "u") (* t b b) (+ a (sign b)))) :over d))"""
    solve = mbm.loads(text).solve().first
    ends = solve["q"].interval(0.95)
    np.testing.assert_allclose(ends[0], [0.0, (0.05 + REACH) ** 2], rtol=1e-3, atol=1e-4)
    assert ends[1][0] < -0.7
    assert not solve.not_examined


def test_a_root_at_zero_has_no_finite_derivative() -> None:
    text = "(problem p (unknowns (b)) (observe (= 0 b) :sigma 0.1) (derive (root (sqrt b)) (twice (* 2 b))))"
    entry = mbm.loads(text).solve().document()["solves"][0]["derived"]["root"]
    assert entry["sigma"] is None
    assert entry["reason"] == "its derivative is not finite at the estimates"


def test_models_with_jumps_are_not_taken_for_linear() -> None:
    """Where y = a + sign(a), the cost of 0.05 and 1.05 falls until a jump at 0: by formula 0.95² + 0.05² just above."""
    solve = (
        mbm.loads("""(problem p (data d (table (y) (0.05) (1.05))) (unknowns (a))
      (observe d (= y (+ a (sign a))) :sigma 0.1))""")
        .solve()
        .first
    )
    assert solve.method != "linear"
    assert solve.cost == pytest.approx((0.95**2 + 0.05**2) / 0.01, rel=1e-6)


@pytest.mark.parametrize("backend", ["native", "numpy"])
def test_keys_without_rows_of_the_derived_table_have_no_numbers(backend: str) -> None:
    text = """(problem p (data few (table (id x) (1 1))) (data d (table (id y) (1 1) (0 1) (1 1.2)))
      (unknowns (a :init 1)) (observe d (= y (exp a)) :sigma 1) (for-each id) (derive (q (sin a) :over few)))"""
    first, second = mbm.loads(text).solve(backend=backend).document()["solves"]
    # exp(a) is the mean of 1 and 1.2, to 1e-7 standard deviations
    assert first["derived"]["q"]["value"] == pytest.approx([np.sin(np.log(1.1))], abs=1e-6)
    assert second["derived"]["q"]["value"] == []
