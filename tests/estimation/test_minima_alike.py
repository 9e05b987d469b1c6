"""What counts as one minimum, as two of one cost, as mirror images, as a rival: cases on both sides of each limit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

import mbm
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.search.basins import EQUAL, FINE, Basin, equal_costs, merged
from mbm.estimation.search.twins import Twin, twin_of
from mbm.estimation.search.valleys import MOST_WALKS, Walks
from mbm.estimation.settings import settings_of
from mbm.estimation.solve.estimate import assemble
from mbm.report.types import SolveReport

ROOT = np.sqrt(4.5)
"""Where (x² - 4)² + (x² - 5)² is least, on either side; the cost there is 1/2."""


def square(first: str, second: str, starts: str) -> SolveReport:
    text = f"""(problem p (unknowns (x :in (-5 5)))
      (observe (= 4 (+ (^ x 2) {first})) :sigma 1) (observe (= 5 (+ (^ x 2) {second})) :sigma 1)
      (solve :starts {starts}))"""
    return mbm.loads(text).solve().first


@pytest.mark.parametrize(("share", "mirrored"), [(0.0, True), (1e-9, True), (1e-7, False), (1e-4, False)])
def test_mirror_images_leave_all_residuals_as_they_are(share, mirrored):
    """share · x³ makes 2 share x³ of difference in both residuals, and none in the least cost, which is 1/2 on either
    side: a symmetry leaves less than some 1e-7 of the residuals."""
    solve = square(*[f"(* {share!r} (^ x 3))"] * 2, "(random 10)")
    (other,) = solve.alternatives
    assert other.cost == pytest.approx(solve.cost, rel=1e-9)
    assert float(other.estimates[0].value) == pytest.approx(-float(solve.estimates[0].value), rel=1e-3)
    assert (other.remark is not None) == mirrored


@pytest.mark.parametrize(("slope", "first"), [(1e-7, -1), (1e-6, 1)])
def test_of_equal_costs_the_first_start_decides(slope, first):
    """slope · x moves the cost by slope · 2.12 down on one side and up on the other: 4e-7 apart is equal, 4e-6 not."""
    solve = square(f"(* {-slope!r} x)", "0", "(given ((x -2)) ((x 2)))")
    apart = solve.alternatives[0].cost - solve.cost
    assert abs(apart) == pytest.approx(2 * slope * ROOT, rel=1e-3)
    assert float(solve.estimates[0].value) == pytest.approx(first * ROOT, rel=1e-6)


def test_costs_are_equal_up_to_a_millionth():
    for cost in (0.0, 2.0, 1e6):
        allowed = EQUAL * (1 + cost)
        assert equal_costs(cost, cost + 0.9 * allowed)
        assert equal_costs(cost + 0.9 * allowed, cost)
        assert not equal_costs(cost, cost + 1.1 * allowed)


def line():
    """Equations of a line with its minimum: slope and offset with conditional deviations 0.1 / √14 and 0.1 / √3."""
    equations, (minimum,) = minima_of(
        """(problem p (data t (table (x y) (1 2.1) (2 3.9) (3 6.2))) (unknowns (a) (b))
      (observe t (= y (+ a (* b x))) :sigma 0.1))""",
        np.zeros(2),
    )
    return equations, minimum


def minima_of(text, *points):
    """The equations of a problem, and the minima that points lead to."""
    compiled = mbm.loads(text).compile()
    found = compiled.elaborated
    equations, _ = assemble(found.problem, compiled.kernels, found.tables, {}, compiled.cache)
    return equations, [minimise(equations, point, settings_of(found.problem.request)) for point in points]


@pytest.mark.parametrize(("share", "count"), [(0.0, 1), (0.8, 1), (1.2, 2)])
@pytest.mark.parametrize(("place", "deviation"), [(0, 0.1 / np.sqrt(3)), (1, 0.1 / np.sqrt(14))])
def test_minima_are_one_within_a_thousandth_of_a_deviation(place, deviation, share, count):
    equations, minimum = line()
    spread = np.sqrt(max(1.0, minimum.cost))
    step = np.zeros(2)
    step[place] = share * FINE * deviation * spread
    other = replace(minimum, point=minimum.point + step)
    basins = [Basin(minimum=m, starts=np.array([i])) for i, m in enumerate((minimum, other))]
    found = merged(Walks(equations, lambda: False), basins)
    assert len(found) == count
    assert sorted(np.concatenate([basin.starts for basin in found]).tolist()) == [0, 1]


def test_minima_of_other_costs_are_two():
    equations, minimum = line()
    for share, count in ((0.9, 1), (1.1, 2)):
        other = replace(minimum, cost=minimum.cost + share * EQUAL * (1 + minimum.cost))
        basins = [Basin(minimum=m, starts=np.array([i])) for i, m in enumerate((minimum, other))]
        assert len(merged(Walks(equations, lambda: False), basins)) == count


@pytest.mark.parametrize(("slope", "warned"), [(1.45, True), (1.55, False)])
def test_a_rival_fits_within_three_standard_deviations(slope, warned):
    """Minima at ±1, for x² = 1 to 1e-4; slope · (x - 1) adds (2 slope)² to the cost of the second: 8.4 and 9.6."""
    solve = (
        mbm.loads(f"""(problem p (unknowns (x :in (-3 3)))
      (observe (= 1 (^ x 2)) :sigma 1e-4) (observe (= 0 (* {slope} (- x 1))) :sigma 1)
      (solve :starts (random 12)))""")
        .solve()
        .first
    )
    assert float(solve.estimates[0].value) == pytest.approx(1.0, abs=1e-9)
    (other,) = solve.alternatives
    assert other.cost == pytest.approx(4 * slope**2, rel=1e-6)
    assert ("another-solution" in [d.code.name for d in solve.diagnostics]) == warned


TURNS = """(problem turns (unknowns {unknowns}) {observations})"""


def twin(relation: str, first: list[float], second: list[float]) -> Twin | None:
    """How the one point follows from the other, where equations hold the angles a1 … aₙ by a ``relation``."""
    names = [f"a{k}" for k in range(len(first))]
    compiled = mbm.loads(
        TURNS.format(
            unknowns=" ".join(f"({name} angle :init 0.3rad)" for name in names),
            observations=" ".join(f"(observe (= 0.3 ({relation} {name})) :sigma 1)" for name in names),
        )
    ).compile()
    equations, _ = compiled._assembled()
    return twin_of(equations, np.array(first), np.array(second))


def test_a_point_is_no_twin_of_itself():
    assert twin("sin", [0.1, 0.2], [0.1, 0.2]) is None


@pytest.mark.parametrize("count", [1, 5])
@pytest.mark.parametrize(("relation", "partner"), [("sin", -1.0), ("tan", 1.0)])
def test_any_number_of_angles_have_supplements_and_half_turns(relation, partner, count):
    """sin(π − a) = sin a, tan(π + a) = tan a."""
    first = [0.1 + 0.2 * k for k in range(count)]
    second = [np.pi + partner * each for each in first]
    expected = Twin.TURNED if relation == "tan" else Twin.MIRRORED
    assert twin(relation, first, second) is expected


@pytest.mark.parametrize(
    ("equation", "others"),
    [
        ("(= 3 (distance [x y] [0.5 0.2]))", 0),  # one circle
        ("(= 4 (^ (+ x y) 2))", 1),  # two lines
        ("(= 4 (^ (distance [x y] [0.5 0.2]) 2))", 0),
        ("(= 1 (^ (- (distance [x y] [0.5 0.2]) 2) 2))", 1),  # two circles about one middle
    ],
)
def test_valleys_that_no_way_connects_are_different_solutions(equation, others):
    """Along each of them no residual changes; from one to the other it does."""
    text = f"""(problem p (data t (table (k) (1) (2))) (unknowns (x :in (-5 5)) (y :in (-5 5)))
      (observe t {equation} :sigma 0.1) (solve :starts (random 12)))"""
    solve = mbm.loads(text).solve().first
    assert solve.status == "unobservable"
    assert len(solve.alternatives) == others


def test_walks_along_valleys_end_when_the_search_is_stopped_or_has_walked_enough():
    """The lines x + y = ±2 are two valleys; where nobody walks they count as one."""
    text = """(problem p (data t (table (k) (1) (2))) (unknowns (x :init 1) (y :init 1))
      (observe t (= 4 (^ (+ x y) 2)) :sigma 0.1))"""
    equations, (one, other) = minima_of(text, np.array([1.2, 0.9]), np.array([-1.2, -0.9]))
    basins = [Basin(minimum=m, starts=np.array([i])) for i, m in enumerate((one, other))]
    walks = Walks(equations, lambda: False)
    assert len(merged(walks, basins)) == 2
    for _ in range(MOST_WALKS - 1):
        assert not walks.connect(one, other.point)
    assert len(merged(walks, basins)) == 1
    asked = iter([False, False, True])
    assert Walks(equations, lambda: next(asked)).connect(one, other.point)
    assert not list(asked)


def test_a_walk_that_leaves_where_the_equation_is_defined_ends():
    """Richards' growth curve ends flat from some starts, where walks reach powers that overflow."""
    x = np.arange(0.0, 22.0, 2.0)
    y = 700.0 / (1.0 + np.exp(5.4 - 0.63 * x)) ** (1 / 1.44) + 5.0 * np.random.default_rng(3).normal(size=len(x))
    text = """(problem p (data d external) (unknowns (a) (b) (c) (d))
      (observe d (= y (/ a (^ (+ 1 (exp (- b (* c x)))) (/ 1 d)))) :sigma 5))"""
    solve = mbm.loads(text).solve(data={"d": {"x": x, "y": y}}).first
    least = least_squares(
        lambda p: (p[0] / (1.0 + np.exp(p[1] - p[2] * x)) ** (1 / p[3]) - y) / 5.0, [700, 5.4, 0.63, 1.44], method="lm"
    )
    assert solve.cost == pytest.approx(2.0 * least.cost, rel=1e-7)
