"""Many starts at once: ends are minima by SciPy's word, whatever evaluates the equations, and when stopped."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

import mbm
from mbm.equations.excerpt import excerpt
from mbm.estimation.minimise.minimise import minima, minimise
from mbm.estimation.minimise.native import minimum as native_starts, system as native_system
from mbm.estimation.minimise.native.minimum import ends_of_starts
from mbm.estimation.settings import Settings
from tests.estimation.varied import PROBLEMS, points_about

pytest.importorskip("llvmlite")

STEPS = 60

FEW = 5
"""Starts where each takes long: more than the four lanes of one call."""


@pytest.fixture(params=PROBLEMS)
def equations(request):
    return mbm.loads(PROBLEMS[request.param]).compile(backend="native")._assembled()[0]


def lower_nearby(part, point):
    """The cost that SciPy comes to from a point, inside the bounds."""

    def residuals(step):
        return part.residuals(part.retract(point, step))

    here = part.coordinates(point)
    low, high = part.lower - here - 1e-12, part.upper - here + 1e-12
    low = np.where(part.positive, np.maximum(low, 1e-9 - here), low)
    found = least_squares(residuals, np.zeros(part.dimension), bounds=(low, high), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    return 2.0 * found.cost


@pytest.mark.parametrize("share", ["all", "some units"])
def test_ends_are_minima(equations, share):
    starts = points_about(equations, 6)
    units = np.unique(equations.units)
    part = excerpt(equations, equations.free, units if share == "all" else units[:-1])
    found = ends_of_starts(part, starts, STEPS, Settings())
    costs = np.array([np.square(part.residuals(point)).sum() for point in found.points])
    np.testing.assert_allclose(found.cost, costs, rtol=1e-12, atol=1e-20)
    assert (found.cost <= [np.square(part.residuals(point)).sum() for point in starts]).all()
    assert found.settled.sum() >= 5
    for point, cost in zip(found.points[found.settled], found.cost[found.settled], strict=True):
        # A step below 1e-6 standard deviations is left: 1e-12 of the cost; SciPy's differences see no less than 1e-8.
        assert lower_nearby(part, point) >= cost * (1.0 - 1e-8) - 1e-10


def test_coordinates_that_are_not_asked_for_stay(equations):
    starts = points_about(equations, 5)
    part = excerpt(equations, equations.free[:1], np.unique(equations.units))
    found = ends_of_starts(part, starts, STEPS, Settings())
    moved = part.moving()
    np.testing.assert_array_equal(found.points[:, ~moved], starts[:, ~moved])
    assert (found.points[:, moved] != starts[:, moved]).any()


def test_the_number_of_threads_does_not_matter(equations):
    starts = points_about(equations, 211 if equations.dimension < 50 else FEW)
    one, *others = (ends_of_starts(equations, starts, STEPS, Settings(workers=workers)) for workers in (1, 3))
    for other in others:
        for name in ("points", "cost", "settled", "iterations", "evaluations"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_where_it_is_stopped_every_start_stands_at_its_cost(equations):
    class Requested:
        requested = True

    starts = points_about(equations, 4)
    found = ends_of_starts(equations, starts, STEPS, Settings(interruption=Requested()))
    np.testing.assert_array_equal(found.points, starts)
    costs = [np.square(equations.residuals(point)).sum() for point in starts]
    np.testing.assert_allclose(found.cost, costs, rtol=1e-12)
    assert not found.settled.any()


def test_where_it_is_stopped_no_more_than_one_batch_of_costs_is_computed(equations, monkeypatch):
    """Not those of all starts: with many rows that takes longer than what was interrupted."""

    class Requested:
        requested = True

    monkeypatch.setattr(native_starts, "MEMORY", 2 * equations.count * equations.dimension)
    starts = points_about(equations, 6)
    found = ends_of_starts(equations, starts, STEPS, Settings(interruption=Requested()))
    np.testing.assert_array_equal(found.points, starts)
    assert np.isfinite(found.cost).tolist() == [True] * 2 + [False] * 4


@pytest.mark.parametrize("at_a_time", [1.0, 50.0])
def test_the_ends_do_not_depend_on_how_often_somebody_is_asked(equations, at_a_time, monkeypatch):
    starts = points_about(equations, 6 if equations.dimension < 50 else FEW)
    whole = ends_of_starts(equations, starts, STEPS, Settings())
    products = equations.count * (equations.dimension + 4) ** 2
    monkeypatch.setattr(native_system, "AT_A_TIME", at_a_time * products)
    parts = ends_of_starts(equations, starts, STEPS, Settings())
    for name in ("points", "cost", "settled", "iterations", "evaluations"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))


def test_a_start_without_a_value_has_an_infinite_cost():
    text = """(problem p (unknowns (x :in (-1 9) :init 1))
      (observe a (= 1 (sqrt x)) :sigma 1) (observe b (= 4.2 (^ x 2)) :sigma 1))"""
    equations = mbm.loads(text).compile(backend="native")._assembled()[0]
    found = ends_of_starts(equations, np.array([[-0.5], [4.0]]), STEPS, Settings())
    assert found.cost[0] == np.inf
    assert found.points[0, 0] == -0.5
    assert found.settled.tolist() == [False, True]


@pytest.mark.parametrize("backend", ["numpy", "casadi"])
@pytest.mark.parametrize("name", PROBLEMS)
def test_other_backends_lead_to_the_same_ends(name, backend):
    ends = []
    for each in ("native", backend):
        equations = mbm.loads(PROBLEMS[name]).compile(backend=each)._assembled()[0]
        starts = points_about(equations, 3)
        ends.append(ends_of_starts(equations, starts, STEPS, Settings()))
    # Where a start has settled the next step is below 1e-6 standard deviations; kernels differ by rounding.
    assert ends[1].settled.any()
    both = ends[0].settled & ends[1].settled
    np.testing.assert_allclose(ends[1].cost[both], ends[0].cost[both], rtol=1e-9, atol=1e-12)


def test_minima_of_many_points_are_those_of_each(equations):
    """The last digits of a point in one call and alone: the same code on the same numbers."""
    starts = points_about(equations, 7 if equations.dimension < 50 else FEW)
    settings = Settings()
    together = list(minima(equations, starts, settings))
    for start, found in zip(starts, together, strict=True):
        alone = minimise(equations, start, settings)
        for name in ("point", "residuals", "jacobian"):
            np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))
        assert (found.reason, found.iterations, found.evaluations) == (
            alone.reason,
            alone.iterations,
            alone.evaluations,
        )


def test_a_search_gives_the_same_document_for_any_number_of_workers():
    text = """(problem p (unknowns (x :in (-3 3)) (y :in (-3 3)))
      (observe a (- (^ x 2) 1) :sigma 1) (observe b (= 0 y) :sigma 1) (observe c (+ 1 (* 0.1 x)) :sigma 1)
      (solve :starts (random 200)))"""
    problem = mbm.loads(text)
    documents = [problem.solve(workers=workers).document() for workers in (1, 2, 3)]
    for document in documents:
        document["solves"][0]["seconds"] = None
    assert documents[0] == documents[1] == documents[2]
