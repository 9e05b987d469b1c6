"""Steps that are brought back to the curved surface of constraints: many at once as each alone."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.equations.surface import OnSurface
from mbm.estimation.solve.estimate import assemble

CIRCLE = """
(problem circle
  (unknowns (x :init 0.6) (y :init 0.8))
  (observe (= 0.6 x) :sigma 1) (observe (= 0.8 y) :sigma 1)
  (constraints (= (+ (* x x) (* y y)) 1)))
"""
CIRCLES = """
(problem circles
  (data d (table (k) (0) (1)))
  (unknowns (x :per d.k :init 0.6) (y :per d.k :init 0.8))
  (observe d (= 0.6 (x k)) :sigma 1) (observe d (= 0.8 (y k)) :sigma 1)
  (constraints (= (+ (* (x k) (x k)) (* (y k) (y k))) 1 :over d)))
"""


def surface_of(text: str) -> OnSurface:
    """Plain numbers x and y that stay on circles of radius 1."""
    compiled = mbm.loads(text).compile()
    found = compiled.elaborated
    starts = {name: np.asarray(value) for name, value in found.starts.items()}
    equations = assemble(found.problem, compiled.kernels, found.tables, starts, compiled.cache)[0]
    holding = np.arange(len(equations.equality))
    return OnSurface(equations=equations, holding=holding, scale=np.ones(equations.dimension))


START = np.array([0.6, 0.8])
ALONG = np.array([-0.8, 0.6])


@pytest.mark.parametrize("length", [1e-4, 1e-3, 0.03, 0.3, 2.0])
def test_many_steps_end_where_each_does_alone(length: float) -> None:
    surface = surface_of(CIRCLE)
    steps = length * np.array([ALONG, -ALONG, ALONG + 0.5 * START, -3 * ALONG])
    together = surface.retract(np.tile(START, (len(steps), 1)), steps)
    alone = np.stack([surface.retract(START, step) for step in steps])
    assert np.hypot(*together.T) == pytest.approx(1.0, abs=1e-9)  # `CLOSE`
    assert np.abs(together - alone).max() < 1e-9  # `CLOSE`


def test_a_step_that_cannot_be_brought_back_is_nan() -> None:
    surface = surface_of(CIRCLE)
    found = surface.retract(np.tile(START, (2, 1)), np.array([-START, 1e-3 * ALONG]))  # the first ends at the centre
    assert np.isnan(found[0]).all()
    assert np.hypot(*found[1]) == pytest.approx(1.0, abs=1e-9)


def test_circles_of_rows_are_met_each_by_its_own_members() -> None:
    """Newton's method on a circle goes back along the radius: both points are those of their directions."""
    surface = surface_of(CIRCLES)
    start = surface.equations.numbers
    steps = np.random.default_rng(3).normal(scale=0.3, size=(5, 4))
    moved = surface.equations.retract(np.tile(start, (5, 1)), steps).reshape(5, 2, 2)
    found = surface.retract(np.tile(start, (5, 1)), steps).reshape(5, 2, 2)
    # numbers stand as x of all, then y of all
    np.testing.assert_allclose(found, moved / np.linalg.norm(moved, axis=1, keepdims=True), rtol=0, atol=1e-9)
