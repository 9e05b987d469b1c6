"""Intervals beside limits that hold an estimate of normal errors: closed forms, sums over grids, simulations."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm, truncnorm

import mbm
from mbm.cli.main import run
from mbm.report.exports import write_estimates

NEAR = 5e-3
"""Relative accuracy of an end: −log L is known to 0.01 between the places where it was looked at."""

READINGS = np.array([-0.3, -0.1, 0.02])
BOUND = ("(a :in (0 10))", ""), ("(a)", "(constraints (>= a 0))"), ("(a)", "(constraints (normal c 1 1) (>= a 0))")
MEAN = """(problem p (data d external) (unknowns {unknown} (c)) {limit} {each}
    (observe d (= y a) :sigma 0.2) (observe (= c 1) :sigma 1)
    (derive (twice (* 2 a)) (square (^ a 2)) (less (- 1 a)) (other (* 3 c))))"""


def ends(readings: np.ndarray) -> float:
    """The upper end of the shortest interval of the normal distribution that is left above 0."""
    centre, scale = readings.mean(), 0.2 / np.sqrt(len(readings))
    return float(truncnorm.ppf(0.95, -centre / scale, np.inf, centre, scale))


@pytest.mark.parametrize(("unknown", "limit"), BOUND)
@pytest.mark.parametrize("each", ["", "(for-each k)"])
def test_what_is_derived_of_an_estimate_at_its_limit_goes_as_far_as_that(unknown: str, limit: str, each: str) -> None:
    data = {"y": READINGS, "k": np.zeros(3)}
    found = mbm.loads(MEAN.format(unknown=unknown, limit=limit, each=each)).solve(data={"d": data}).solves[0]
    far = ends(READINGS)
    for name, expected in (
        ("a", [0.0, far]),
        ("twice", [0.0, 2 * far]),
        ("square", [0.0, far**2]),
        ("less", [1 - far, 1.0]),
    ):
        assert found[name].interval() == pytest.approx(expected, rel=1e-9, abs=1e-9)
        zero = name == "a" and "constraints" in limit  # the covariance along the inequality
        assert found[name].sigma == pytest.approx(0.0 if zero else np.nan, abs=1e-12, nan_ok=True)
    assert found["twice"].reason is not None and "leaves the limit" in found["twice"].reason
    assert found["other"].interval_kind == "t"
    assert found["other"].sigma > 0.0


def test_documents_tables_and_csv_give_no_standard_deviation(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = MEAN.format(unknown="(a :in (0 10))", limit="", each="").replace(
        "external", "(table (y) (-0.3) (-0.1) (0.02))"
    )
    found = mbm.loads(text).solve()
    twice = found.document()["solves"][0]["derived"]["twice"]
    assert twice["sigma"] is None and twice["U"] is None
    assert "limit" in twice["reason"]
    assert twice["interval"] == pytest.approx([0.0, 2 * ends(READINGS)])
    stream = io.StringIO(newline="")
    write_estimates(found.result, stream)
    row = next(each for each in csv.DictReader(io.StringIO(stream.getvalue())) if each["scalar"] == "twice")
    assert row["sigma"] == "" and float(row["high"]) == pytest.approx(2 * ends(READINGS))
    file = tmp_path / "shown.mbm"
    file.write_text(text, encoding="utf-8")
    run(["solve", str(file), "--intervals"])
    out = capsys.readouterr().out
    line = next(each for each in out.splitlines() if each.startswith("  twice"))
    assert "± ?" in line and "leaves the limit" in line


X = np.array([3.0, 3.5, 4.0, 4.5])
"""Far from 0, so that the intercept and the slope of a line are correlated by -0.97."""
LINE = """(problem p (data d external) (unknowns {unknown} (b)) {limit} {each}
    (observe d (= y (+ a (* b x))) :sigma 0.3) (derive (far (+ a (* 10 b))) (sum (+ a b)) {more}))"""


def shortest(grid: np.ndarray, costs: np.ndarray) -> list[float]:
    """The shortest interval that holds 95 % of a likelihood."""
    left = np.exp(-0.5 * (costs - costs.min()))
    order = np.argsort(-left, kind="stable")
    inside = grid[order[: int(np.searchsorted(np.cumsum(left[order]), 0.95 * left.sum())) + 1]]
    return [float(inside.min()), float(inside.max())]


def profile(y: np.ndarray, ahead: float) -> list[float]:
    """Of (a + ahead b), or of b (infinite), over all a ≥ 0."""
    grid = np.linspace(-8.0, 8.0, 16_001) if np.isfinite(ahead) else np.linspace(-1.0, 1.0, 16_001)
    # b = (v - a)/ahead, or v: the cost is a parabola in a
    slope = 1.0 - X / ahead if np.isfinite(ahead) else np.ones(4)
    fixed = y[:, None] - (X[:, None] / ahead if np.isfinite(ahead) else X[:, None]) * grid
    best = np.maximum(0.0, (slope @ fixed) / (slope @ slope))
    return shortest(grid, (((fixed - slope[:, None] * best) / 0.3) ** 2).sum(axis=0))


@pytest.mark.parametrize(("unknown", "limit"), BOUND[:2])
def test_beside_an_estimate_at_its_limit_the_others_reach_to_where_it_leaves_it(unknown: str, limit: str) -> None:
    y = 0.2 * X + 0.3 * np.random.default_rng(3).standard_normal((16, 4))
    data = {"k": np.repeat(np.arange(16), 4), "x": np.tile(X, 16), "y": y.ravel()}
    text = LINE.format(unknown=unknown, limit=limit, each="(for-each k)", more="")
    held = 0
    for own, found in zip(y, mbm.loads(text).solve(data={"d": data}).solves, strict=True):
        if found["a"].value > 1e-9:
            continue
        held += 1
        # the grids have steps of 0.0001 and 0.001
        assert found["b"].interval() == pytest.approx(profile(own, np.inf), abs=2e-3)
        assert found["far"].interval() == pytest.approx(profile(own, 10.0), abs=2e-2)
        assert found["b"].sigma == pytest.approx(0.3 / np.sqrt(X @ X))
    assert held > 3


def test_what_an_inequality_of_several_estimates_holds_goes_as_far_as_its_profile() -> None:
    y = np.array([0.6, 0.2, -0.3, -0.4])
    text = LINE.format(unknown="(a)", limit="(constraints (<= (+ a b) 0.1))", each="", more="(twice (* 2 (+ a b)))")
    found = mbm.loads(text).solve(data={"d": {"x": X, "y": y}})
    grid = np.linspace(-6.0, 0.1, 60_001)
    slope = 1.0 - X
    fixed = y[:, None] - X[:, None] * grid
    best = (slope @ fixed) / (slope @ slope)
    wanted = shortest(grid, (((fixed - slope[:, None] * best) / 0.3) ** 2).sum(axis=0))
    for name, factor in (("sum", 1.0), ("twice", 2.0)):
        assert found[name].interval() == pytest.approx([factor * each for each in wanted], abs=5e-3)
        assert np.isnan(found[name].sigma)


def test_a_quantity_that_equations_determine_keeps_its_zero() -> None:
    text = """(problem p (data d (table (y) (-1) (-2))) (unknowns (a :in (0 10)) (b))
        (constraints (= b 3)) (observe d (= y a) :sigma 1) (derive (twice (* 2 b)) (both (+ a b))))"""
    found = mbm.loads(text).solve()
    assert found["twice"].sigma == pytest.approx(0.0, abs=1e-12)
    assert np.isnan(found["both"].sigma)
    far = brentq(lambda end: truncnorm.cdf(end, 1.5 * np.sqrt(2), np.inf, -1.5, 1 / np.sqrt(2)) - 0.95, 0.01, 3.0)
    assert found["both"].interval() == pytest.approx([3.0, 3.0 + far], rel=NEAR)


@pytest.mark.parametrize(("unknown", "limit"), BOUND[:2])
@pytest.mark.parametrize("each", ["", "(for-each k)"])
def test_what_equations_tie_to_an_estimate_at_its_limit_goes_as_far_as_that(
    unknown: str, limit: str, each: str
) -> None:
    limit = limit.replace("(constraints", "").replace("(>= a 0))", "(>= a 0)")
    text = f"""(problem p (data d external) (unknowns {unknown} (b)) (constraints {limit} (= (+ a b) 1)) {each}
        (observe d (= y a) :sigma 0.2)
        (derive (twice (* 2 b)) (sum (+ a b)) (none (- (+ a b) 1)) (both (+ a (* 3 b)))))"""
    data = {"y": READINGS, "k": np.zeros(3)}
    found = mbm.loads(text).solve(data={"d": data}).solves[0]
    far = ends(READINGS)
    for name, expected in (("b", [1 - far, 1.0]), ("twice", [2 - 2 * far, 2.0]), ("both", [3 - 2 * far, 3.0])):
        assert found[name].interval() == pytest.approx(expected, rel=NEAR)
        assert found[name].sigma == pytest.approx(0.0 if name == "b" else np.nan, abs=1e-12, nan_ok=True)
    for name, value in (("sum", 1.0), ("none", 0.0)):
        assert found[name].sigma == 0.0
        assert found[name].interval() == pytest.approx([value, value], abs=1e-15)


@pytest.mark.parametrize(
    ("unknowns", "limits"),
    [("(a :in (0 10)) (b :in (-1 0))", ""), ("(a) (b)", "(constraints (>= a 0) (<= b 0))")],
)
def test_a_product_of_two_estimates_at_their_limits_has_no_interval(unknowns: str, limits: str) -> None:
    text = f"""(problem p (data d external) (unknowns {unknowns}) {limits} (observe d (= y a) :sigma 0.2)
        (observe d (= y (- (* 2 b) a 1)) :sigma 0.2)
        (derive (product (* a b)) (sum (+ a b)) (small (* 1e-9 (+ a b)))))"""
    found = mbm.loads(text).solve(data={"d": {"y": READINGS}})
    assert np.isnan(found["product"].sigma) and np.isnan(found["product"].interval()).all()
    assert found["product"].reason is not None and "leaves the limit" in found["product"].reason
    assert found["small"].interval() == pytest.approx(1e-9 * found["sum"].interval(), rel=NEAR)


@pytest.mark.slow
@pytest.mark.parametrize("inside", [0.0, 0.5, 1.0, 2.0])
def test_intervals_beside_a_limit_hold_the_truth(inside: float) -> None:
    runs = 1000
    design = np.column_stack([np.ones(4), X])
    a = inside * 0.3 * np.sqrt(np.linalg.inv(design.T @ design)[0, 0])
    y = a + 0.2 * X + 0.3 * np.random.default_rng(5).standard_normal((runs, 4))
    text = LINE.format(unknown="(a :in (0 100))", limit="", each="(for-each k)", more="(twice (* 2 a))")
    data = {"k": np.repeat(np.arange(runs), 4), "x": np.tile(X, runs), "y": y.ravel()}
    solves = mbm.loads(text).solve(data={"d": data}).solves
    for name, truth in (("b", 0.2), ("far", a + 2.0), ("sum", a + 0.2)):
        found = np.array([each[name].interval() for each in solves])
        held = ((found[:, 0] <= truth) & (truth <= found[:, 1])).mean()
        # 1000 runs are known to 0.7 % (one standard deviation)
        assert 0.93 < held < 0.985


@pytest.mark.parametrize("constraint", ["(<= (^ a 2) 0.16)", "(<= (exp a) (exp 0.4))", "(<= (* a a a) 0.064)"])
def test_a_limit_on_a_function_of_the_only_unknown(constraint: str) -> None:
    """N(0.55, 0.1/√2) below 0.4: the shortest that holds 95 % of what is left begins where 5 % of that are."""
    text = f"""(problem p (data d (table (y) (0.5) (0.6))) (unknowns (a)) (constraints {constraint})
      (observe d (= y a) :sigma 0.1) (derive (twice (* 2 a))))"""
    result = mbm.loads(text).solve()
    sigma = 0.1 / np.sqrt(2.0)
    begin = 0.55 + sigma * norm.ppf(0.05 * norm.cdf((0.4 - 0.55) / sigma))
    # The likelihood is known to 1 % of its logarithm between the places looked at.
    assert result["a"].interval() == pytest.approx([begin, 0.4], rel=2e-3)
    assert result["twice"].interval() == pytest.approx([2 * begin, 0.8], rel=2e-3)


NEARBY = """(problem p (data d external) (unknowns {unknown} (b)) {limit} {each}
    (observe d (= y (+ a (* b x))) :sigma {sigma})
    (derive (twice (* 2 a)) (square (^ a 2)) (sum (+ a (* 3 b))) (less (- a b)) (b-too (* 1 b))))"""


@pytest.mark.parametrize(("unknown", "limit"), BOUND[:2])
@pytest.mark.parametrize("each", ["", "(for-each k)"])
def test_near_a_limit_what_is_derived_ends_where_the_estimate_does(unknown: str, limit: str, each: str) -> None:
    """The estimate's own interval is that of the normal distribution cut off at the limit, the sum's that of its
    profile within the limit, on a grid."""
    x, y = np.array([-1.0, 0.0, 1.0, 2.0]), np.array([0.1, 0.5, 0.7, 1.4])
    data = {"k": np.zeros(4), "x": x, "y": y}
    text = NEARBY.format(unknown=unknown, limit=limit, each=each, sigma=0.8)
    found = mbm.loads(text).solve(data={"d": data}).solves[0]
    covariance = 0.64 * np.linalg.inv(np.array([[4.0, x.sum()], [x.sum(), x @ x]]))
    a, b = covariance @ np.array([y.sum(), x @ y]) / 0.64
    scale = np.sqrt(covariance[0, 0])
    reach = brentq(lambda z: norm.cdf(z) - norm.cdf(-min(z, a / scale)) - 0.95 * norm.cdf(a / scale), 0.5, 5.0)
    assert reach > a / scale  # the limit cuts it
    far = a + reach * scale
    for name, wanted in (("a", [0.0, far]), ("twice", [0.0, 2 * far]), ("square", [0.0, far**2])):
        assert found[name].interval() == pytest.approx(wanted, rel=1e-6, abs=1e-9)
    assert found["b-too"].interval() == pytest.approx(found["b"].interval(), rel=1e-9)
    grid, inverse = np.linspace(-8.0, 12.0, 100_001), np.linalg.inv(covariance)
    for name, factor in (("sum", 3.0), ("less", -1.0)):
        # steps (s, (grid - a - s)/factor - b) from the estimates
        way, start = np.array([1.0, -1.0 / factor]), np.stack([np.zeros(len(grid)), (grid - a) / factor - b])
        best = np.maximum(0.0, a - (way @ inverse @ start) / (way @ inverse @ way))
        step = np.stack([best - a, (grid - best) / factor - b])
        wanted = shortest(grid, np.einsum("ik,ij,jk->k", step, inverse, step))
        assert found[name].interval() == pytest.approx(wanted, abs=2e-3)


def test_a_limit_of_several_cuts_what_is_derived_of_them() -> None:
    x, y = np.array([-1.0, 0.0, 1.0, 2.0]), np.array([0.1, 0.5, 0.7, 1.4])
    text = NEARBY.format(unknown="(a)", limit="(constraints (>= (+ a (* 3 b)) 1.5))", each="", sigma=0.5)
    found = mbm.loads(text).solve(data={"d": {"x": x, "y": y}})
    covariance = 0.25 * np.linalg.inv(np.array([[4.0, x.sum()], [x.sum(), x @ x]]))
    value = np.array([1.0, 3.0]) @ covariance @ np.array([y.sum(), x @ y]) / 0.25
    scale = np.sqrt(np.array([1.0, 3.0]) @ covariance @ np.array([1.0, 3.0]))
    down = (1.5 - value) / scale
    reach = brentq(lambda z: norm.cdf(z) - norm.cdf(down) - 0.95 * norm.cdf(-down), 0.1, 5.0)
    assert 0.0 < -down < reach
    assert found["sum"].interval() == pytest.approx([1.5, value + reach * scale], rel=1e-4)


def test_under_a_loss_what_is_derived_of_one_estimate_is_cut_too() -> None:
    x, y = np.array([-1.0, 0.0, 1.0, 2.0, 3.0]), np.array([-0.9, 1.0, 0.1, 1.9, 1.4])
    text = NEARBY.format(unknown="(a :in (0 10))", limit="", each="", sigma="0.5 :loss (huber 2)")
    found = mbm.loads(text).solve(data={"d": {"x": x, "y": y}})
    low, high = found["a"].interval()
    assert low == 0.0 and found["a"].interval_kind == "limited"
    assert found["twice"].interval() == pytest.approx([0.0, 2 * high], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("each", ["", "(for-each k)"])
def test_a_ratio_beside_what_a_limit_holds_ends_where_its_least_cost_has_grown(each: str) -> None:
    """By 1.96² over all a ≥ 0.2; it has no share: its likelihood does not fall to nothing on the way to b = 0."""
    x, y = np.arange(1.0, 6.0), np.array([0.3, 1.1, 1.6, 2.2, 2.4])
    text = f"""(problem p (data d external) (unknowns (a :in (0.2 10)) (b)) {each}
        (observe d (= y (+ a (* b x))) :sigma 0.4) (derive (r (/ a b)) (inverse (/ b a))))"""

    def growth(ratio: float) -> float:
        slope = max(y @ (ratio + x) / np.square(ratio + x).sum(), 0.2 / ratio)
        residuals = (y - slope * (ratio + x), y - 0.2 - x * (x @ (y - 0.2)) / (x @ x))
        return float(np.square(residuals[0]).sum() - np.square(residuals[1]).sum()) / 0.16 - norm.ppf(0.975) ** 2

    found = mbm.loads(text).solve(data={"d": {"x": x, "y": y, "k": np.zeros(5)}}).solves[0]
    middle = float(found["r"].value)
    low, high = brentq(growth, 0.05, middle), brentq(growth, middle, 20.0)
    # ends are where the growth is right to 0.2 %
    assert found["r"].interval() == pytest.approx([low, high], rel=NEAR)
    assert found["inverse"].interval() == pytest.approx([1 / high, 1 / low], rel=NEAR)


@pytest.mark.parametrize("more", ["", "(>= b -0.05)"])
@pytest.mark.parametrize("last", [1.8, 2.0])
@pytest.mark.parametrize("each", ["", "(for-each k)"])
def test_what_has_no_slope_beside_a_limit_of_several_goes_as_far_as_its_profile(
    more: str, last: float, each: str
) -> None:
    """The square of how far a + b, the line at 1, is from its limit, as far as least cost allows."""
    x, y = np.arange(1.0, 5.0), np.array([2.1, 1.9, 2.2, last])
    text = f"""(problem p (data d external) (unknowns (a) (b)) {each} (constraints (<= (+ a b) 2) {more})
        (observe d (= y (+ a (* b x))) :sigma 0.2)
        (derive (sum (+ a b)) (square (^ (- 2 (+ a b)) 2)) (more (+ 1 (^ (- 2 (+ a b)) 2)))))"""
    found = mbm.loads(text).solve(data={"d": {"x": x, "y": y, "k": np.zeros(4)}}).solves[0]
    slope, ahead = np.polyfit(x - 1.0, y, 1)
    assert ahead > 2.0
    scale = 0.2 * np.sqrt(1 / 4 + 1.5**2 / 5)
    begin = ahead + scale * norm.ppf(0.05 * norm.cdf((2.0 - ahead) / scale))
    assert found["sum"].interval() == pytest.approx([begin, 2.0], rel=NEAR)
    # b is above its own limit wherever a + b is below 2, and so has no part in this
    assert slope > -0.07 and np.isnan(found["more"].sigma) and np.isnan(found["sum"].sigma)
    far = np.sqrt((ahead - 2.0) ** 2 + (norm.ppf(0.975) * scale) ** 2) - (ahead - 2.0)
    assert found["square"].interval() == pytest.approx([0.0, far**2], rel=NEAR, abs=1e-6)
    assert found["more"].interval() == pytest.approx([1.0, 1.0 + far**2], rel=NEAR)


@pytest.mark.parametrize("limit", [-2.098, 0.429, 0.822, 2.342])
def test_ends_at_a_limit_of_several_lie_within_it(limit: float) -> None:
    y = limit + 0.2 + 0.2 * X + np.array([0.1, -0.2, 0.15, -0.05])
    text = LINE.format(unknown="(a)", limit=f"(constraints (>= (+ a b) {limit}))", each="", more="(less (- (+ a b)))")
    found = mbm.loads(text).solve(data={"d": {"x": X, "y": y}})
    assert float(found["sum"].value) > limit
    # the way there and back rounds twice
    rounding = 4 * np.spacing(abs(limit) + abs(float(found["sum"].value)))
    assert found["sum"].interval()[0] == pytest.approx(limit, abs=rounding, rel=0.0)
    assert found["less"].interval()[1] == pytest.approx(-limit, abs=rounding, rel=0.0)


def test_near_a_limit_sums_with_an_uncertain_constant_are_not_cut() -> None:
    """What is read is a + c, however uncertain both are: its mean ± 1.96 σ/√3."""
    text = """(problem p (data d (table (y) (0.35) (0.25) (0.3))) (constants (c 0.1 :sigma 0.3))
        (unknowns (a :in (0 10))) (observe d (= y (+ a c)) :sigma 0.1) (derive (s (+ a c))))"""
    far = 1.959963985 * 0.1 / np.sqrt(3)
    # 1e-6: half of a difference of two solves stands for the derivative by the constant
    assert mbm.loads(text).solve()["s"].interval() == pytest.approx([0.3 - far, 0.3 + far], rel=1e-6)


def test_what_bends_beside_an_estimate_at_its_limit_is_looked_for_where_that_has_left_it_too() -> None:
    """What varies with it to second order only, or where it is the larger one: a grid of both."""
    forms = {
        "bent": ("(+ b (* 5 (^ a 2)))", lambda a, b: b + 5 * a**2),
        "length": ("(hypot a b)", np.hypot),
        "larger": ("(max a (* 2 b))", lambda a, b: np.maximum(a, 2 * b)),
    }
    more = " ".join(f"({name} {form})" for name, (form, _) in forms.items())
    y = np.array([1.4, 1.9, 1.7, 2.5])
    text = LINE.format(unknown="(a positive)", limit="", each="", more=more)
    found = mbm.loads(text).solve(data={"d": {"x": X, "y": y}}).solves[0]
    design = np.column_stack([np.ones(4), X])
    centre = np.linalg.lstsq(design, y)[0]
    a, b = np.meshgrid(np.linspace(0.0, 4.0, 2001), np.linspace(-1.0, 1.5, 2001), indexing="ij")
    away = np.stack([a - centre[0], b - centre[1]])
    cost = np.einsum("iab,ij,jab->ab", away, design.T @ design / 0.3**2, away)
    inside = cost < cost.min() + norm.ppf(0.975) ** 2
    assert centre[0] < 0.0 and not inside[-1].any() and not inside[:, [0, -1]].any()
    for name, (_, function) in forms.items():
        values = function(a, b)[inside]
        # ends are where the growth is right to 0.2 %
        assert found[name].interval()[1] == pytest.approx(values.max(), abs=1e-2 * np.ptp(values))
        assert found[name].interval()[1] > 1.05 * found["b"].interval()[1]


@pytest.mark.parametrize("constant", ["", "(constants (g 0 :sigma 0.02))"])
def test_a_quotient_by_an_estimate_at_its_limit_has_no_interval(constant: str) -> None:
    """What is positive is held next to 0: the quotient by it is of the size of one over rounding there."""
    moved = "(+ b g)" if constant else "b"
    text = f"""(problem p {constant} (unknowns (a positive) (b)) (observe (= -0.1 a) (= 2 {moved}) :sigma 0.5)
        (derive (quotient (/ b a)) (less (/ -1 (* a b))) (inverse (/ a b))))"""
    found = mbm.loads(text).solve()
    assert found["quotient"].value > 1e12
    for name in ("quotient", "less"):
        assert np.isnan(found[name].interval()).all()
    assert np.isfinite(found["inverse"].interval()).all()


def test_beside_a_limit_a_quotient_has_no_end_where_its_divisor_reaches_0() -> None:
    """The cost grows by (1 / 0.8)² only, until (a + 1) / b is infinite."""
    text = "(problem p (unknowns (a positive) (b)) (observe (= -0.1 a) (= 1 b) :sigma 0.8) (derive (q (/ (+ a 1) b))))"
    assert mbm.loads(text).solve()["q"].interval()[1] == np.inf


def test_what_is_steep_at_a_limit_has_no_standard_deviation() -> None:
    """A root at 0, where its slope is infinite, goes as far as the estimate takes it."""
    found = mbm.loads(
        "(problem p (unknowns (a :in (0 5)) (b)) (observe (= -0.1 a) (= 1 b) :sigma 0.2)"
        " (derive (root (sqrt a)) (sum (+ b (sqrt a)))))"
    ).solve()
    assert np.isnan(found["root"].sigma) and np.isnan(found["sum"].sigma)
    assert found["root"].interval() == pytest.approx(np.sqrt(found["a"].interval()))
