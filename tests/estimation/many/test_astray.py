"""Starts that lead astray, on each path: beside stations that nearly stand in a line there is a minimum on either side.

SciPy says which one is lower, from a fan of starts.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

import mbm

COUNT = 12
"""Data sets: more than the eight from which on those of `for-each` and `window` are solved together."""

FAN = [(x, y) for x in (2.0, 5.0, 8.0) for y in (-3.0, 3.0)]
PATHS = ("single", "for-each", "window", "window of few", "stream")
ASTRAY = "(p (vector 2) :init [4 -2])"


def beside_a_line(count=COUNT, stations=5, seed=11, sigma=0.05, sides=(1.0,)):
    """Columns (count, stations) by name: ranges to places on the ``sides`` of nearly a line, by turns."""
    generator = np.random.default_rng(seed)
    x = np.tile(np.linspace(0, 10, stations), (count, 1))
    y = generator.uniform(-0.2, 0.4, (count, stations))
    place = generator.uniform([2, 1.5], [8, 4], (count, 2))
    place[:, 1] *= np.resize(sides, count)
    r = np.hypot(x - place[:, :1], y - place[:, 1:]) + sigma * generator.normal(size=x.shape)
    return {"sx": x, "sy": y, "r": r}


def text(columns, unknowns, point, more="", sigma=0.05):
    names = " ".join(columns)
    station = " ".join(name for name in columns if name.startswith("s"))
    return (
        f"(problem p (data d (table (run {names}))) (unknowns {unknowns})"
        f" (observe d (= r (distance {point} [{station}])) :sigma {sigma}) {more})"
    )


def answered(path, columns, unknowns=ASTRAY, point="p", more="", sigma=0.05):
    """Costs (count,) and estimates (count, n), where there are any."""
    count, rows = columns["r"].shape
    runs = np.repeat(np.arange(count), rows)
    joined = {"run": runs, **{name: values.ravel() for name, values in columns.items()}}
    if path in ("for-each", "window"):
        clause = "(for-each run)" if path == "for-each" else "(window run :length 1 :step 1)"
        asked = mbm.loads(text(columns, unknowns, point, f"{clause} {more}", sigma))
        solves = asked.solve(data={"d": joined}).solves
    elif path == "window of few":
        asked = mbm.loads(text(columns, unknowns, point, f"(window run :length 1 :step 1) {more}", sigma))
        parts = [runs // 4 == part for part in range(-(-count // 4))]
        solves = [s for p in parts for s in asked.solve(data={"d": {k: v[p] for k, v in joined.items()}}).solves]
    else:
        sets = [{"run": np.zeros(rows), **{k: v[i] for k, v in columns.items()}} for i in range(count)]
        once = mbm.loads(text(columns, unknowns, point, more, sigma)).compile(data={"d": sets[0]})
        if path == "stream":
            found = once.estimator(*(f"d.{name}" for name in columns)).many(*columns.values())
            return found.cost, found.values
        solves = [once.solve(data={"d": each}).first for each in sets]
    assert len(solves) == count
    values = [np.concatenate([np.ravel(np.asarray(e.value, float)) for e in s.estimates]) for s in solves]
    return np.array([s.cost for s in solves]), np.array(values)


LEAST = {}
"""What `least` found: the same for all paths."""


def least(columns, **given):
    """As `searched` says, which is asked once for the same numbers."""
    key = (*(values.tobytes() for values in columns.values()), *sorted(given.items()))
    if key not in LEAST:
        LEAST[key] = searched(columns, **given)
    return LEAST[key]


def searched(columns, sigma=0.05, height=None, known=None, most=np.inf):
    """The lowest cost of each data set (count,), and where it is (count, 2); x is ``most`` so large.

    The ``height`` is ``known`` with a standard deviation, or (None) without error.
    """
    found = []
    for i in range(len(columns["r"])):
        stations = np.stack([values[i] for name, values in columns.items() if name != "r"], axis=1)

        def residuals(p, stations=stations, r=columns["r"][i]):
            place = p if height is None or known is not None else [*p, height]
            found = (np.linalg.norm(stations - place, axis=1) - r) / sigma
            return found if known is None else [*found, (p[2] - height) / known]

        starts = [(min(x, most - 0.1), y) if known is None else (x, y, height) for x, y in FAN]
        limits = (-np.inf, [most, *[np.inf] * (len(starts[0]) - 1)])
        ends = [least_squares(residuals, start, xtol=1e-14, ftol=1e-14, gtol=1e-14, bounds=limits) for start in starts]
        found.append(min(ends, key=lambda end: end.cost))
    return np.array([2 * end.cost for end in found]), np.array([end.x for end in found])


def agree(costs, wanted):
    # Both end where rounding of the cost does, 1e-16 of it; SciPy's forward differences leave some 1e-9.
    np.testing.assert_allclose(costs, wanted, rtol=1e-7, atol=1e-9)


@pytest.fixture(scope="module")
def lowest():
    return least(beside_a_line())


@pytest.mark.parametrize("path", PATHS)
def test_a_stated_start_on_the_wrong_side_does_no_harm(path, lowest):
    assert (lowest[1][:, 1] > 0).sum() > COUNT / 2  # the start is below the line
    agree(answered(path, beside_a_line())[0], lowest[0])


@pytest.mark.parametrize("path", ["window", "window of few"])
@pytest.mark.parametrize("unknowns", [ASTRAY, "(p (vector 2))"])
def test_a_window_on_the_wrong_side_does_not_drag_along_those_behind_it(path, unknowns):
    """The place changes sides from window to window: each begins on the side of the one before."""
    columns = beside_a_line(sides=(1.0, -1.0, -1.0))
    wanted, places = least(columns)
    assert 5 < (places[:, 1] < 0).sum() < 15
    agree(answered(path, columns, unknowns)[0], wanted)


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("method", ["direct-search", "gauss-newton", "dogleg"])
def test_other_methods_compare_as_well(path, method, lowest):
    agree(answered(path, beside_a_line(), more=f"(solve :method {method})")[0], lowest[0])


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize(
    "stated", ["(x) (y :init -2)", "(x :init 4) (y :start (-3 -1))", "(x :start (3 5)) (y :init -2)"]
)
def test_where_some_unknowns_have_a_start_and_others_a_guess_all_are_compared(path, stated, lowest):
    agree(answered(path, beside_a_line(), stated, "[x y]")[0], lowest[0])


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize(
    ("unknowns", "point"),
    [
        (f"{ASTRAY} (z)", "p"),
        (f"{ASTRAY} (z :init 3)", "p"),
        (f"{ASTRAY} (q (rotation 3))", "p"),
        ("(p (vector 3) :init [4 -2 1])", "[(p 1) (p 2)]"),
    ],
)
def test_what_no_equation_mentions_does_not_spoil_the_comparison(path, unknowns, point, lowest):
    agree(answered(path, beside_a_line(), unknowns, point)[0], lowest[0])


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize(
    ("unknowns", "point", "known"),
    [
        ("(q (vector 2) :init [4 -2])", "[(q 1) (q 2) 1.5]", None),
        ("(x :init 4) (y :init -2) (z :init 1.5 :fixed true)", "[x y z]", None),
        ("(q (vector 3) :init [4 -2 1.5] :fixed [false false true])", "q", None),
        ("(x :init 4) (y :init -2) (z :init 1.5 :sigma 0.02)", "[x y z]", 0.02),
    ],
)
def test_a_height_that_is_known_stays_and_the_place_is_compared(path, unknowns, point, known):
    columns = {**beside_a_line(), "sz": np.full((COUNT, 5), 3.0)}
    columns["sz"] += np.random.default_rng(3).uniform(-0.5, 0.5, columns["sz"].shape)
    columns["r"] = np.hypot(columns["r"], columns["sz"] - 1.5)
    columns = {name: columns[name] for name in ("sx", "sy", "sz", "r")}
    wanted, _ = least(columns, height=1.5, known=known)
    agree(answered(path, columns, unknowns, point)[0], wanted)


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("stated", ["(x :init 4 :in (0 7)) (y :init -2)", "(x :in (0 7)) (y)"])
def test_a_bound_that_cuts_off_the_lower_fit_moves_the_closed_form_to_it(path, stated):
    """Data of places up to x = 8, where x is 7 at most."""
    columns = beside_a_line(20, seed=2)
    wanted, places = least(columns, most=7.0)
    assert (places[:, 0] > 7 - 1e-6).sum() > 3
    # SciPy's interior steps approach the bound: what they leave, times the push there, is 1e-8 of costs of hundreds
    np.testing.assert_allclose(answered(path, columns, stated, "[x y]")[0], wanted, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("path", PATHS)
def test_what_is_known_beforehand_takes_part_in_what_a_fit_costs(path):
    """A prior of rows without parameters; of the place it says next to nothing, but adds to the cost."""
    columns = beside_a_line()
    costs, values = answered(path, columns, "(x :init 4 :sigma 1e3) (y :init -2 :sigma 1e3)", "[x y]")
    wanted, places = least(columns)
    known = np.square((values - [4, -2]) / 1e3).sum(axis=1)
    # what the prior moves the place by, in deviations of about 0.1 from the ranges, is 1e-6 of them
    np.testing.assert_allclose(costs, wanted + known, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(values, places, atol=1e-5)


@pytest.mark.parametrize("path", PATHS)
def test_a_start_on_a_station_steps_aside(path):
    """There the distance has no derivative."""
    columns = beside_a_line()
    columns["sx"][:, 1], columns["sy"][:, 1] = 4.0, -2.0
    columns["r"][:, 1] = np.hypot(*(columns[name][:, 1] for name in ("sx", "sy"))) + 1.0
    agree(answered(path, columns)[0], least(columns)[0])


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("start", [(4.0, -2.0), (4.0, 9.0)])
def test_of_two_equal_fits_the_one_that_the_start_leads_to_stays(path, noise, start):
    """Stations stand in a line: both sides fit equally well, and rounding alone says which costs less."""
    generator = np.random.default_rng(7)
    x = np.sort(generator.uniform(0, 10, (COUNT, 5)), axis=1)
    place = generator.uniform([2, 4], [8, 7], (COUNT, 2))
    y = 0.3 * x + 0.1
    r = np.hypot(x - place[:, :1], y - place[:, 1:]) + noise * generator.normal(size=x.shape)
    _, values = answered(path, {"sx": x, "sy": y, "r": r}, f"(p (vector 2) :init [{start[0]} {start[1]}])")
    sides = np.sign(values[:, 1] - 0.3 * values[:, 0] - 0.1)
    np.testing.assert_array_equal(sides, np.sign(start[1] - 0.3 * start[0] - 0.1))


@pytest.mark.parametrize("path", ["single", "for-each", "window"])
def test_three_masts_nearly_in_a_line(path):
    """200 simulated sets of noise that hides the line: the lower fit is on the true side for 140 of them."""
    generator = np.random.default_rng(3)
    x, y = np.tile([0.0, 5.0, 10.0], (200, 1)), np.tile([0.0, 0.3, 0.0], (200, 1))
    columns = {"sx": x, "sy": y, "r": np.hypot(x - 4, y - 3) + 0.3 * generator.normal(size=x.shape)}
    wanted, places = least(columns, sigma=0.3)
    costs, values = answered(path, columns, sigma=0.3)
    agree(costs, wanted)
    np.testing.assert_array_equal(values[:, 1] > 0, places[:, 1] > 0)
    assert 100 < (values[:, 1] > 0).sum() < 180
