"""Batches: the same bits however they are cut, whatever was in the scratch, from however many threads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import mbm.estimation.minimise.native.system as native
from mbm.equations.assembly import Assembled
from mbm.equations.types import Reason
from mbm.estimation.minimise.native.system import system_of
from mbm.solver import description as of

TEXT = """
(problem p (data t external)
  (unknowns (a :init 2) (b positive :init 1) (c :init 0 :in [-1 1]))
  (observe t (= y (+ (* b (exp (* a x))) (* c (sin (* 5 x))))) :sigma 0.1 :loss (huber 2)))
"""


@pytest.fixture
def ready(both):
    """Equations, their start and settings, of a problem that takes several iterations."""
    x = np.linspace(0, 1, 30)
    y = 0.7 * np.exp(1.3 * x) + 0.2 * np.sin(5 * x) + 0.1 * np.random.default_rng(2).standard_normal(30)
    equations, start, settings, *_ = both.of(TEXT, t={"x": x, "y": y})[0]
    assert isinstance(equations, Assembled)
    return equations, start, settings


def starts(start):
    generator = np.random.default_rng(5)
    return start + generator.uniform([-3, -0.9, -1], [1, 3, 1], (40, 3))


def same(one, other):
    for a, b in zip(one.arrays().values(), other.arrays().values(), strict=True):
        np.testing.assert_array_equal(a, b)


def test_one_by_one_and_by_threads(ready):
    equations, start, settings = ready
    system, points = system_of(equations, settings), starts(start)
    whole = system.solve(points)
    assert whole.clean.sum() > 20
    for workers in (2, 3, 7):
        same(whole, system.solve(points, workers=workers))
    for k, point in enumerate(points):
        alone = system.solve(point[None])
        for a, b in zip(alone.arrays().values(), whole.arrays().values(), strict=True):
            np.testing.assert_array_equal(a[0], b[k])


def test_some_iterations_at_a_time(ready, monkeypatch):
    equations, start, settings = ready
    system, points = system_of(equations, settings), starts(start)[:6]
    whole = system.solve(points)
    monkeypatch.setattr(native, "AT_A_TIME", 1.0)
    same(whole, system.solve(points))


def test_what_was_in_the_scratch_does_not_matter(ready, monkeypatch):
    equations, start, settings = ready
    system, points = system_of(equations, settings), starts(start)[:6]
    whole = system.solve(points)
    monkeypatch.setattr(
        native.np, "empty", lambda n, dtype=float: np.full(n, -7 if dtype is np.int64 else np.nan, dtype)
    )
    same(whole, system.solve(points))


def test_no_end_is_worse_than_its_start(ready):
    equations, start, settings = ready
    points = starts(start)
    for most in (1, 2, 5):
        ends = system_of(equations, replace(settings, max_iterations=most)).solve(points)
        for k, point in enumerate(points):
            inside = equations.placed(point, np.clip(equations.coordinates(point), equations.lower, equations.upper))
            with np.errstate(all="ignore"):
                before = float(np.square(equations.residuals(inside)).sum())
            if np.isfinite(before) and ends.states[k, of.REASON] != of.NOT_FINITE_AT_START and point[1] > 0:
                assert ends.results[k, of.COST] <= before * (1 + 1e-12)


def test_the_answer_is_consistent(ready):
    """Cost, triangle, covariance and freedom are those of the equations at the point."""
    equations, start, settings = ready
    ends = system_of(equations, settings).solve(start[None])
    point, n = ends.numbers[0], equations.dimension
    jacobian, residuals = equations.jacobian(point), equations.residuals(point)
    assert ends.results[0, of.COST] == pytest.approx(residuals @ residuals, rel=1e-13)
    plain = equations.plain_residuals(point)
    assert ends.results[0, of.PLAIN_COST] == pytest.approx(plain @ plain, rel=1e-13)
    triangle = ends.triangles[0]
    gram = jacobian.T @ jacobian
    np.testing.assert_allclose(triangle[:n, :n].T @ triangle[:n, :n], gram, rtol=0, atol=1e-13 * np.abs(gram).max())
    np.testing.assert_allclose(triangle[:n, :n].T @ triangle[:n, n], jacobian.T @ residuals, rtol=0, atol=1e-10)
    # A condition below 1e3 lets the inverse of the normal equations be a reference to 1e-10.
    assert ends.results[0, of.CONDITION] < 1e3
    np.testing.assert_allclose(ends.covariances[0], np.linalg.inv(gram), rtol=1e-10, atol=1e-14)
    assert ends.states[0, of.FREEDOM] == 30 - 3


def test_an_interrupted_solve_gives_the_best_point_so_far(ready):
    equations, start, settings = ready
    asked = iter([False, False, True])
    ends = system_of(equations, settings).one(start, stopped=lambda: next(asked))
    assert ends.states[0, of.REASON] == of.RUNNING
    assert ends.states[0, of.STEPS] == 2
    before = float(np.square(equations.residuals(start)).sum())
    assert ends.results[0, of.COST] < before


def test_an_interrupted_minimum_says_so(ready):
    from mbm.equations.interruption import Interruption
    from mbm.estimation.minimise.native.minimum import native_minimum

    equations, start, settings = ready
    interruption = Interruption()
    interruption.listen()
    interruption.request()
    found = native_minimum(equations, start, settings, lambda: interruption.requested)
    assert found.reason is Reason.INTERRUPTED
    assert found.iterations == 0


def test_data_sets_of_a_batch(ready):
    """Two data sets in one system: each solve takes its own rows."""
    equations, start, settings = ready
    system = system_of(equations, settings)
    rows = system.rows
    data = np.repeat(rows.data, 2, axis=0)
    half = 13
    data[0, of.DataSet.count] = data[0, of.DATA_HEAD + of.DataBlock.rows] = half
    halves = replace(system, rows=replace(rows, data=data))
    points = np.stack([start, start, start])
    found = halves.solve(points, np.array([1, 0, 1]))
    units = np.arange(30) < half
    alone = system_of(equations.kept(units), settings).solve(start[None])
    np.testing.assert_array_equal(found.numbers[0], found.numbers[2])
    np.testing.assert_array_equal(found.numbers[0], system.solve(start[None]).numbers[0])
    # The rows left out are zeros there and absent here: only the order of the sums differs.
    np.testing.assert_allclose(found.numbers[1], alone.numbers[0], rtol=1e-9)
    assert found.states[1, of.FREEDOM] == alone.states[0, of.FREEDOM] == half - 3
