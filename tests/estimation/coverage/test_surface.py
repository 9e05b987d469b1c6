"""Steps that are brought back to the curved surface of constraints: many at once as each alone."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mbm.equations.surface import OnSurface


def circle_values(points: np.ndarray) -> np.ndarray:
    return (np.square(points).sum(axis=-1) - 1.0)[..., None]


def circle() -> OnSurface:
    """Plain numbers x and y that stay on the circle of radius 1."""
    equations: Any = SimpleNamespace(
        retract=lambda x, step: x + step,
        constraint_values=circle_values,
        constraint_jacobian=lambda x: 2.0 * x[None],
        constraints=[SimpleNamespace(values_at=circle_values)],
    )
    return OnSurface(equations=equations, holding=np.array([0]), scale=np.ones(2))


START = np.array([0.6, 0.8])
ALONG = np.array([-0.8, 0.6])


@pytest.mark.parametrize("length", [1e-4, 1e-3, 0.03, 0.3, 2.0])
def test_many_steps_end_where_each_does_alone(length: float) -> None:
    surface = circle()
    steps = length * np.array([ALONG, -ALONG, ALONG + 0.5 * START, -3 * ALONG])
    together = surface.retract(np.tile(START, (len(steps), 1)), steps)
    alone = np.stack([surface.retract(START, step) for step in steps])
    assert np.hypot(*together.T) == pytest.approx(1.0, abs=1e-9)  # `CLOSE`
    # The slopes of the start turn the way back by less than the step, over what is squared of it; far steps go alone.
    assert np.abs(together - alone).max() < (2 * length**2 if length < 0.1 else 1e-9)


def test_a_step_that_cannot_be_brought_back_is_nan() -> None:
    surface = circle()
    found = surface.retract(np.tile(START, (2, 1)), np.array([-START, 1e-3 * ALONG]))  # the first ends at the centre
    assert np.isnan(found[0]).all()
    assert np.hypot(*found[1]) == pytest.approx(1.0, abs=1e-9)
