"""Other minima beside that of a single start: what is told, against minima found by SciPy from the other side."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

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
