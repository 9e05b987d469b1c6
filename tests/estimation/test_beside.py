"""Other minima beside that of a single start: what is told, against minima found by SciPy from the other side."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import norm

import mbm

STATIONS = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
UP = np.array([0.0, 0.05, 0.0, -0.05, 0.02])
PLACE = (
    "(problem p (data d external) (unknowns {unknowns}) (observe d (= r (distance [x y] [s u])) :sigma {sigma}) {more})"
)


def told(solve):
    """Whether a solve warns of another solution."""
    return any(each.code.name == "another-solution" for each in solve.diagnostics)


def ranges(up, seed, sigma=0.1):
    """Measured distances of five stations from a place beside their line."""
    noise = sigma * np.random.default_rng(seed).normal(size=5)
    return {"d": {"s": STATIONS, "u": up, "r": np.hypot(1.5 - STATIONS, 2.0 - up) + noise}}


def minimum(data, start, sigma=0.1):
    """The minimum of χ² that SciPy finds from a start."""
    d = data["d"]
    found = least_squares(
        lambda p: (np.hypot(p[0] - d["s"], p[1] - d["u"]) - d["r"]) / sigma, start, xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    return found.x, 2.0 * found.cost


@pytest.mark.parametrize("start", [2.0, -2.0])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_place_on_the_other_side_is_told_beside_a_stated_start(start, seed):
    data = ranges(UP, seed)
    text = PLACE.format(unknowns=f"(x :init 1.5) (y :init {start})", sigma=0.1, more="")
    result = mbm.loads(text).solve(data=data)
    (other,) = result.alternatives
    x, cost = minimum(data, [1.5, -2.0 * np.sign(result["y"].value)])
    assert abs(cost - result.cost) < 9.0  # not excluded: the case is one that is to be told
    assert other.cost == pytest.approx(cost, rel=1e-9)
    assert [each.value for each in other.estimates] == pytest.approx(list(x), rel=1e-6)
    assert told(result)


def test_it_is_told_without_a_start_as_well():
    data = ranges(UP, 1)
    result = mbm.loads(PLACE.format(unknowns="(x) (y)", sigma=0.1, more="")).solve(data=data)
    costs = sorted(minimum(data, [1.5, y])[1] for y in (2.0, -2.0))
    assert [result.cost, *(each.cost for each in result.alternatives)] == pytest.approx(costs, rel=1e-9)
    assert told(result)


def test_with_unknown_noise_costs_count_in_its_units():
    data = ranges(10 * UP, 4)
    text = PLACE.format(unknowns="(x :init 1.5) (y :init 2)", sigma="unknown", more="")
    result = mbm.loads(text).solve(data=data)
    other = minimum(data, [1.5, -2.0], 1.0)[1]
    assert told(result) == (other - result.cost <= 9.0 * result.cost / 3)


def test_a_place_that_the_data_exclude_is_none():
    """Two metres off their line, the stations tell the sides apart by hundreds of χ²."""
    data = ranges(40 * UP, 5)
    result = mbm.loads(PLACE.format(unknowns="(x :init 1.5) (y :init 2)", sigma=0.1, more="")).solve(data=data)
    assert not result.alternatives
    assert not told(result)


def test_between_exact_mirror_images_the_stated_start_chooses():
    data = ranges(0 * UP, 6)
    for start in (2.0, -2.0):
        text = PLACE.format(unknowns=f"(x :init 1.5) (y :init {start})", sigma=0.1, more="")
        result = mbm.loads(text).solve(data=data)
        assert np.sign(result["y"].value) == np.sign(start)
        assert not told(result)


TURNED = "(observe d (- (- (* y (cos a)) (* x (sin a))) r) :sigma 0.02"


@pytest.mark.parametrize(
    "line",
    [
        "(unknowns (p :init 0) (q :init 1) (r :init 0.5)) (constraints (= (hypot p q) 1))"
        "(observe d (- (+ (* y q) (* x p)) r) :sigma 0.02)",
        f"(unknowns (a :init 0.2) (r :init 0.5)) {TURNED} :loss (tukey))",
        f"(unknowns (a :init 0.2) (r :init 0.5)) {TURNED})",
    ],
)
def test_a_line_whose_normal_is_turned_round_is_the_same_line(line):
    """Its distances have the other sign, all of them: the start that is stated has chosen the side."""
    random = np.random.default_rng(8)
    x = np.linspace(-4.0, 4.0, 20)
    data = {"x": x, "y": 0.77 + 0.4 * x + 0.02 * random.normal(size=20)}
    result = mbm.loads(f"(problem p (data d external) {line})").solve(data={"d": data})
    assert result["r"].value == pytest.approx(0.77 / np.hypot(1.0, 0.4), abs=0.02)
    assert not told(result)


def test_a_better_minimum_is_told_and_the_answer_stays_that_of_the_start():
    """y = t² − 0.3 t³ has the value 0.5 at three t; a prior-like second reading makes the far one better by little."""
    text = """(problem p (data d (table (v) (0.5))) (unknowns (t :init 0.8))
      (observe d (= v (- (^ t 2) (* 0.3 (^ t 3)))) :sigma 0.1)
      (observe near (= -0.65 t) :sigma 1))"""
    result = mbm.loads(text).solve()

    def residuals(t):
        return np.array([(t[0] ** 2 - 0.3 * t[0] ** 3 - 0.5) / 0.1, t[0] + 0.65])

    here, there = (least_squares(residuals, [s], xtol=1e-15, ftol=1e-15, gtol=1e-15) for s in (0.8, -0.6))
    assert 2 * there.cost < 2 * here.cost < 2 * there.cost + 9.0
    assert result["t"].value == pytest.approx(here.x[0], rel=1e-8)
    assert result.alternatives[0].cost == pytest.approx(2 * there.cost, abs=1e-9)
    assert "fits better" in next(d.message for d in result.diagnostics if d.code.name == "another-solution")


def test_phases_by_whole_turns_and_amplitudes_of_the_other_sign_are_one_solution():
    x = np.linspace(0.0, 6.0, 40)
    y = np.sin(2 * x + 0.5) + 0.1 * np.random.default_rng(7).normal(size=40)
    text = """(problem p (data d external) (unknowns (a :init 1) (w :init 2) (f :init 0.5))
      (observe d (= y (* a (sin (+ f (* w x))))) :sigma 0.1))"""
    assert not mbm.loads(text).solve(data={"d": {"x": x, "y": y}}).alternatives


@pytest.mark.parametrize(("up", "sigma"), [(UP, "0.1"), (UP, "unknown"), (12 * UP, "0.1"), (0 * UP, "0.1")])
def test_many_solves_tell_what_each_tells_by_itself(up, sigma):
    runs = 12
    single = mbm.loads(PLACE.format(unknowns="(x :init 1.5) (y :init -2)", sigma=sigma, more=""))
    many = mbm.loads(PLACE.format(unknowns="(x :init 1.5) (y :init -2)", sigma=sigma, more="(for-each run)"))
    each = [ranges(up, seed)["d"] for seed in range(runs)]
    columns = {name: np.concatenate([d[name] for d in each]) for name in ("s", "u", "r")}
    together = many.solve(data={"d": columns | {"run": np.repeat(np.arange(runs), 5)}})
    for own, solve in zip(each, together.solves, strict=True):
        alone = single.solve(data={"d": own})
        assert [d.message for d in alone.diagnostics] == [d.message for d in solve.diagnostics]
        assert [a.cost for a in solve.alternatives] == pytest.approx([a.cost for a in alone.alternatives], rel=1e-6)


def test_bounds_hold_for_other_minima():
    """The mirrored place is outside `:in`: no other solution."""
    text = PLACE.format(unknowns="(x :init 1.5) (y :init 2 :in (0.5 10))", sigma=0.1, more="")
    result = mbm.loads(text).solve(data=ranges(UP, 1))
    assert not told(result)


def test_a_board_behind_the_camera_is_no_other_solution():
    """The mirror image of a plane through the camera's centre has the same image; nothing behind a camera is seen."""
    generator = np.random.default_rng(4)
    x, y = np.meshgrid(np.arange(7) * 0.025, np.arange(4) * 0.025)
    places = np.column_stack([x.ravel(), y.ravel(), np.zeros(28)])
    seen = Rotation.from_euler("xyz", [0.3, -0.2, 0.4]).apply(places) + np.array([-0.05, -0.06, 0.37])
    points = 400 * seen[:, :2] / seen[:, 2:] + np.array([161, 119]) + 0.01 * generator.normal(size=(28, 2))
    text = """(problem p (data d external) (camera cam :focal (400 400) :center (161 119)) (unknowns (T (pose 3)))
      (observe d (= [u v] (project cam (transform T [x y 0]))) :sigma 0.01))"""
    columns = {"x": places[:, 0], "y": places[:, 1], "u": points[:, 0], "v": points[:, 1]}
    found = mbm.loads(text).solve(data={"d": columns})
    assert found["T"].value[6] > 0
    assert found.first.alternatives == ()
    assert found.status == "ok"


WITH = "(problem p (data d external) (unknowns (x :init 1.5) (y :init -2) {more}) (observe d {equation} {noise}) {end})"
RANGE = "(= r (distance [x y] [s u]))"
ROUND = "(constraints (= (+ (^ x 2) (^ y 2)) 6.25))"
KINDS = {
    "huber": WITH.format(more="", equation=RANGE, noise=":sigma 0.1 :loss (huber 1.5)", end=""),
    "errors": WITH.format(more="", equation=RANGE, noise=":errors ((r 0.1) (s 0.02))", end=""),
    "inequality": WITH.format(more="", equation=RANGE, noise=":sigma 0.1", end="(constraints (< x 5))"),
    "equality": WITH.format(more="(z :init 1)", equation=RANGE, noise=":sigma 0.1", end="(constraints (= (* z x) 3))"),
    "circle": WITH.format(more="", equation=RANGE, noise=":sigma 0.1", end=ROUND),
}


def _on_circle(data):
    """χ² of the places (angle) on the circle of radius 2.5."""
    d = data["d"]
    angle = np.linspace(0.0, 2 * np.pi, 1_000_001)
    square = sum(
        np.square((np.hypot(2.5 * np.cos(angle) - s, 2.5 * np.sin(angle) - u) - r) / 0.1)
        for s, u, r in zip(d["s"], d["u"], d["r"], strict=True)
    )
    lowest = (square < np.roll(square, 1)) & (square <= np.roll(square, -1))
    return sorted(square[lowest])


@pytest.mark.parametrize("kind", KINDS)
def test_losses_corrections_and_constraints_have_other_minima_as_well(kind):
    data = ranges(UP, 1)
    result = mbm.loads(KINDS[kind]).solve(data=data)
    (other,) = result.alternatives
    assert told(result)
    if kind == "circle":
        # the grid is fine to 1e-5 of the curvature of χ²
        assert [result.cost, other.cost] == pytest.approx(_on_circle(data)[:2], rel=1e-4)
    elif kind != "errors":
        # residuals stay within 1.5 standard deviations, where Huber's loss is the square
        assert other.cost == pytest.approx(minimum(data, [1.5, 2.0])[1], rel=1e-6)
    else:

        def residuals(p):
            where = data["d"]["s"] + p[2:]
            return np.concatenate([(np.hypot(p[0] - where, p[1] - UP) - data["d"]["r"]) / 0.1, p[2:] / 0.02])

        outside = least_squares(residuals, [1.5, 2.0, *np.zeros(5)], xtol=1e-15, ftol=1e-15, gtol=1e-15)
        assert other.cost == pytest.approx(2 * outside.cost, rel=1e-6)


def test_on_a_curved_constraint_of_linear_equations():
    """x is measured, y hardly: both places of the circle fit."""
    text = f"""(problem p (data d (table (r) (1.5) (1.45))) (unknowns (x :init 1.5) (y :init -2))
      (observe d (= r x) :sigma 0.1) (observe e (= 0.05 y) :sigma 1.5) {ROUND})"""
    result = mbm.loads(text).solve()
    assert result["y"].value < 0.0 < next(e.value for e in result.alternatives[0].estimates if e.name == "y")
    assert result.alternatives[0].cost < result.cost
    assert told(result)


@pytest.mark.parametrize("more", ["", "(solve :starts (random 30))"])
def test_beside_a_loss_costs_are_those_without_it_and_the_sum_of_losses_stands_beside(more):
    """SciPy's Cauchy loss of scale c is c² log(1 + (r/c)²), as here; one range is off by two standard deviations."""
    data = ranges(UP, 1)
    data["d"]["r"][0] += 0.2
    text = WITH.format(more="", equation=RANGE, noise=":sigma 0.1 :loss (cauchy 2)", end=more)
    solve = mbm.loads(text if not more else text.replace(" :init 1.5", "").replace(" :init -2", "")).solve(data=data)
    (other,) = solve.alternatives

    def residuals(p):
        return (np.hypot(p[0] - STATIONS, p[1] - UP) - data["d"]["r"]) / 0.1

    ends = [
        least_squares(residuals, [1.5, y], loss="cauchy", f_scale=2.0, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        for y in np.sign([float(solve["y"].value), float(other["y"].value)]) * 2.0
    ]
    for found, end in zip((solve, other), ends, strict=True):
        assert found.robust_cost == pytest.approx(2.0 * end.cost, rel=1e-7)
        assert found.cost == pytest.approx(np.square(residuals(end.x)).sum(), rel=1e-5)
    written = json.loads(solve.to_json())["solves"][0]["alternatives"][0]
    assert written["robust_cost"] == other.robust_cost
    assert written["cost"] == other.cost
    said = next(each.message for each in solve.diagnostics if each.code.name == "another-solution")
    assert (
        f"sum of the losses is {other.robust_cost:.6g}, that of the solution reported {solve.robust_cost:.6g}" in said
    )


def test_of_minima_that_fit_exactly_no_rounding_is_told():
    """3² + 2² = 13 and 9 + 4: both places left and right of the line fit three exact ranges."""
    rows = " ".join(f"({s} {float(np.hypot(1.5 - s, 2.0))!r})" for s in (0.0, 1.0, 4.0))
    result = mbm.loads(f"""(problem p (data d (table (s r) {rows})) (unknowns (x) (y))
      (observe d (= r (distance [x y] [s 0])) :sigma 0.1) (derive (side y)))""").solve()
    (said,) = (each.message for each in result.diagnostics if each.code.name == "another-solution")
    assert "no residuals are left in either" in said


def test_constraints_that_exclude_the_other_place():
    text = WITH.format(more="", equation=RANGE, noise=":sigma 0.1", end="(constraints (< y 0))")
    assert not mbm.loads(text).solve(data=ranges(UP, 1)).alternatives


@pytest.mark.parametrize("kind", KINDS)
def test_they_are_told_of_many_solves_as_of_each(kind):
    each = [ranges(UP * (1 if seed % 2 else 40), seed)["d"] for seed in range(4)]
    columns = {name: np.concatenate([d[name] for d in each]) for name in ("s", "u", "r")}
    many = mbm.loads(KINDS[kind].rstrip()[:-1] + " (for-each run))")
    together = many.solve(data={"d": columns | {"run": np.repeat(np.arange(4), 5)}})
    single = mbm.loads(KINDS[kind])
    alone = [told(single.solve(data={"d": own})) for own in each]
    assert [told(solve) for solve in together.solves] == alone
    assert any(alone)


def test_another_minimum_costs_in_the_units_of_the_solve():
    """One unknown factor counts as 1 in both costs."""
    solve = mbm.loads(
        """(problem p (data d (table (y) (4.3) (3.6) (4.2) (3.9))) (data e (table (z) (0.3))) (unknowns (a :init 2.2))
        (observe d (= y (^ a 2)) :sigma unknown) (observe e (= z (* 0.1 a)) :sigma 1))"""
    ).solve()
    (other,) = solve.alternatives
    y = np.array([4.3, 3.6, 4.2, 3.9])
    for cost, a in ((solve.cost, solve["a"].value), (other.cost, float(other.estimates[0].value))):
        assert cost == pytest.approx(np.square(y - a * a).sum() + (0.3 - 0.1 * a) ** 2, rel=1e-9)  # rounding


def test_circles_that_become_a_line_are_no_other_solution() -> None:
    """The cost of points on a short arc falls, far away, towards that of the line through them, which no circle is."""
    rng = np.random.default_rng(1084)
    angle = np.linspace(0.2, 0.9, 12)
    text = """(problem p (data d external) (unknowns (p :init 1) (q :init 2) (r :init 3))
      (observe d (- (+ (^ (- x p) 2) (^ (- y q) 2)) (^ r 2)) :errors ((x 0.05) (y 0.05))) (for-each run))"""
    runs = 40
    x, y = (
        each[None] + 0.05 * rng.normal(size=(runs, len(angle)))
        for each in (1 + 3 * np.cos(angle), 2 + 3 * np.sin(angle))
    )
    run = np.repeat(np.arange(runs), len(angle))
    solves = mbm.loads(text).solve(data={"d": {"run": run, "x": x.ravel(), "y": y.ravel()}}).solves
    assert "another-solution" not in {each.code.name for solve in solves for each in solve.diagnostics}


TIMES = np.arange(6.0)


@pytest.mark.parametrize(
    ("model", "names", "start", "readings", "left"),
    [
        # exp(a) → 0 leaves the mean
        ("(+ b (* x (exp a)))", "`a` → −∞", "(a :init -2) (b :init 1)", [1.02, 0.96, 1.01, 0.95, 1.05, 1.0], 0),
        # exp(-k x) → 1 for x = 0, and 0 else; between them the cost is higher
        ("(+ b (* 0.1 (exp (- (* a x)))))", "`a` → ∞", "(a :init 0) (b :init 1)", [1, 1.02, 0.97, 1.04, 1.0, 1.1], 0.1),
    ],
)
def test_a_cost_that_approaches_a_value_in_the_infinite_is_no_other_solution(
    model: str, names: str, start: str, readings: list[float], left: float
) -> None:
    text = f"(problem p (data d external) (unknowns {start}) (observe d (= y {model}) :sigma 0.05))"
    y = np.array(readings)
    solve = mbm.loads(text).solve(data={"d": {"x": TIMES, "y": y}}).solves[0]
    rest = y - left * (TIMES == 0)
    cost = np.square((rest - rest.mean()) / 0.05).sum()
    said = {each.code.name: each.message for each in solve.diagnostics}
    assert "another-solution" not in said and solve.alternatives == ()
    assert names in said["open-ended"] and f"approaches {cost:.6g}" in said["open-ended"]
    assert solve.cost < cost < solve.cost + 9.0


@pytest.mark.parametrize("seed", [2, 3])
def test_a_much_worse_minimum_is_not_told_where_the_factor_of_a_models_weights_is_unknown(seed):
    dose = np.repeat(10.0 ** np.linspace(-2.0, 3.0, 8), 3)
    response = 0.05 + 1.95 / (1.0 + (dose / 7.0) ** -1.2)
    data = {"d": {"c": dose, "y": response * (1.0 + 0.04 * np.random.default_rng(seed).normal(size=24))}}
    result = mbm.loads(
        """(problem p (data d external) (unknowns (lo) (hi) (ec positive) (h))
          (observe d (= y (+ lo (/ (- hi lo) (+ 1 (^ (/ c ec) (- h)))))) :sigma (unknown (* 1 model))))"""
    ).solve(data=data)
    assert not told(result)
    # With σ = s·model, s estimated for each, −2 log L differs by n log of the ratio of Σ (h/model)² and more.
    assert all(24 * np.log(other.cost / result.cost) > 9.0 for other in result.alternatives)


def test_costs_are_those_of_the_likelihood_where_unknowns_decide_the_weights():
    data = ranges(UP, 1)
    d = data["d"]
    result = mbm.loads(PLACE.format(unknowns="(x) (y)", sigma="(* 5% model)", more="")).solve(data=data)
    (other,) = result.alternatives

    def surprise(solution):
        model = np.hypot(float(solution["x"].value) - d["s"], float(solution["y"].value) - d["u"])
        return -2.0 * norm.logpdf(d["r"], model, 0.05 * model).sum()

    (said,) = [each.message for each in result.diagnostics if each.code.name == "another-solution"]
    assert said.endswith(f"its −2 log L is {surprise(other):.6g}, that of the solution reported {surprise(result):.6g}")
