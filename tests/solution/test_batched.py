"""Marquardt's method over many trials: classics, bounds, undefined regions, and trials that keep to themselves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbm.problem.types import Method
from mbm.solution.minimise import minimise
from mbm.solution.settings import Settings
from mbm.solution.solvers import batched
from mbm.solution.solvers.batched import minimise_all
from tests.solution.classics import CLASSICS, Functions
from tests.solution.test_bounds import BOUNDED


class Loop:
    """A stack made of equations for one point, evaluated one after the other."""

    def __init__(self, equations: Functions) -> None:
        self.equations = equations
        self.dimension, self.count = equations.dimension, equations.count
        self.lower, self.upper, self.positive = equations.lower, equations.upper, equations.positive

    def linearised(self, points, which):
        with np.errstate(all="ignore"):
            values = [(self.equations.residuals(x), self.equations.jacobian(x)) for x in points]
        return np.array([r for r, _ in values]), np.array([j for _, j in values])

    def coordinates(self, points):
        return points

    def moved(self, points, steps):
        return np.clip(points + steps, self.lower, self.upper)


def spread(start, count, seed):
    random = np.random.default_rng(seed)
    scale = np.maximum(np.abs(start), 0.1)
    return np.array(start) + 0.3 * scale * random.normal(size=(count, len(start)))


@pytest.mark.parametrize("name", ["Rosenbrock", "Bard", "Wood", "Box three-dimensional", "Jennrich-Sampson"])
def test_most_trials_end_in_listed_minima(name):
    function, start, minima, _ = CLASSICS[name]
    stack = Loop(Functions(function=function, start=start))
    found = minimise_all(stack, np.array([start, *spread(start, 20, 1)]), iterations=300)
    near = [np.isclose(found.cost, m, rtol=1e-5, atol=1e-9) for m in minima]  # the digits that the paper prints
    assert np.any(near, axis=0)[0]
    assert np.any(near, axis=0).mean() > 0.75
    assert found.settled[0]


@pytest.mark.parametrize("name", ["Rosenbrock", "Wood", "Bard", "Brown-Dennis", "Powell singular"])
def test_bounded_minima_are_those_of_the_solver_for_one_point(name):
    function, start, _, _ = CLASSICS[name]
    lower, upper = (np.array(side, dtype=float) for side in BOUNDED[name])
    equations = Functions(function=function, start=start, lower=lower, upper=upper)
    starts = np.clip(spread(start, 10, 2), lower, upper)
    found = minimise_all(Loop(equations), starts, iterations=300)
    assert (found.points >= lower).all()
    assert (found.points <= upper).all()
    polished = [minimise(equations, x, Settings(method=Method.MARQUARDT)) for x in found.points]
    assert all(p.reason.converged for p in polished)
    # Settled means a promise of 1e-14 of the cost; the slowest problems end a little above.
    assert np.isclose(found.cost, [p.cost for p in polished], rtol=1e-6).mean() > 0.8


@settings(max_examples=60)
@given(
    st.sampled_from(sorted(CLASSICS)),
    st.integers(0, 2**32 - 1),
    st.integers(1, 12),
    st.booleans(),
)
def test_never_worse_than_the_start_and_undefined_regions_are_survived(name, seed, iterations, boxed):
    """Residuals have no value beyond a random plane; starts may lie there too, and then stay."""
    function, start, _, _ = CLASSICS[name]
    random = np.random.default_rng(seed)
    starts = spread(start, 6, seed)
    normal = random.normal(size=len(start))
    limit = float(np.median(starts @ normal))

    def undefined(x):
        values = np.asarray(function(x))
        return values if (x @ normal).real <= limit else np.full_like(values, np.nan)

    box = {"lower": starts.min(axis=0), "upper": starts.max(axis=0)} if boxed else {}
    equations = Functions(function=undefined, start=start, **box)
    with np.errstate(all="ignore"):
        before = np.array([np.square(equations.residuals(x)).sum() for x in starts])
        found = minimise_all(Loop(equations), starts, iterations=iterations)
        after = np.array([np.square(equations.residuals(x)).sum() for x in found.points])
    usable = np.isfinite(before) & np.isfinite(found.cost)
    assert (found.cost[usable] <= before[usable]).all()
    np.testing.assert_array_equal(found.points[~np.isfinite(before)], starts[~np.isfinite(before)])
    np.testing.assert_allclose(after[usable], found.cost[usable], rtol=1e-12)


def test_trials_do_not_depend_on_their_company():
    function, start, _, _ = CLASSICS["Wood"]
    stack = Loop(Functions(function=function, start=start))
    starts = spread(start, 9, 5)
    together = minimise_all(stack, starts, iterations=40)
    for i in range(9):
        alone = minimise_all(stack, starts[i : i + 1], iterations=40)
        assert np.array_equal(alone.points[0], together.points[i])
        assert alone.cost[0] == together.cost[i]


def test_positive_coordinates_stay_above_zero_and_constant_ones_stay_put():
    equations = Functions(
        function=lambda x: np.array([np.log(x[0]) + 3.0, 0.0 * x[1]]), start=(1.0, 2.0), positive=[True, False]
    )
    found = minimise_all(Loop(equations), np.array([[1.0, 2.0], [100.0, 2.0], [1e-6, 2.0]]), iterations=100)
    np.testing.assert_allclose(found.points[:, 0], np.exp(-3.0), rtol=1e-7)
    np.testing.assert_array_equal(found.points[:, 1], 2.0)


def test_chunks_that_were_not_begun_when_it_is_stopped_stay_without_a_cost(monkeypatch):
    """Nobody linearises them: with many rows that takes longer than what was interrupted."""
    function, start, _, _ = CLASSICS["Wood"]
    stack = Loop(Functions(function=function, start=start))
    monkeypatch.setattr(batched, "MEMORY", 2 * stack.count * stack.dimension)
    asked = []

    def stopped():
        asked.append(1)
        return len(asked) > 3

    starts = spread(start, 7, 3)
    found = minimise_all(stack, starts, iterations=100, stopped=stopped)
    assert np.isfinite(found.cost).tolist() == [True] * 2 + [False] * 5
    assert found.iterations.tolist() == [3] * 2 + [0] * 5
    assert not found.evaluations[2:].any()
    assert not found.settled.any()
    np.testing.assert_array_equal(found.points[2:], starts[2:])
