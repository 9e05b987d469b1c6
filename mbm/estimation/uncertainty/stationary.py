"""Unknowns that no residual feels to first order: a derivative that is rounding, or vanishes beside the curvature.

The cosine of an angle at half a turn has the derivative 1e-16 in floating point, and ``1/J`` is no standard deviation.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.metric import rounded_turns, turning
from mbm.equations.types import Equations, Floats, Indices, Mask, Minimum
from mbm.solver.decisions import ABSURD, BEND_STEP, LEAST_SIZE, MOST_GROUPS, vanishing


def without_stationary(equations: Equations, minimum: Minimum, spread: float = 1.0) -> Minimum:
    """The minimum with the columns of the Jacobian that are zero to first order set to zero; dense problems only.

    Looks closer, with one more Jacobian for each, or for a group of them where they are many, only at columns whose
    standard deviation would be absurd. ``spread`` is the standard deviation of the residuals.
    """
    jacobian = minimum.jacobian
    if (
        equations.linear
        or minimum.blocks is not None
        or not np.isfinite(minimum.cost)
        or not jacobian.size
        or not spread > 0.0
    ):
        return minimum
    length = np.sqrt(np.einsum("mn,mn->n", jacobian, jacobian))
    zero = (length > 0.0) & rounded_turns(turning(equations), length)
    suspect, size = np.flatnonzero(suspects(equations, minimum, length, spread) & ~zero), _size(equations, minimum)
    for first in range(min(MOST_GROUPS, len(suspect))):
        group = suspect[first::MOST_GROUPS]
        zero[group] = _stationary(equations, minimum, group, size[group], spread)
    if not zero.any():
        return minimum
    kept = jacobian.copy()
    kept[:, zero] = 0.0
    return replace(minimum, jacobian=kept)


def suspects(equations: Equations, minimum: Minimum, length: Floats, spread: float = 1.0) -> Mask:
    """Which coordinates, with columns of such a ``length`` (n,), have absurd conditional standard deviations."""
    return np.asarray((minimum.at_bound == 0) & (length > 0.0) & (length * ABSURD * _size(equations, minimum) < spread))


def _size(equations: Equations, minimum: Minimum) -> Floats:
    """That of the coordinates (n,), 1 for those that are zero."""
    coordinates = np.abs(equations.coordinates(minimum.point))
    return np.where(coordinates > 0.0, coordinates, 1.0)


@np.errstate(all="ignore")
def _stationary(equations: Equations, minimum: Minimum, columns: Indices, size: Floats, spread: float) -> Mask:
    """Which of the columns (k,) are zero beside what small steps of them all make of each."""
    steps = BEND_STEP * np.maximum(size, LEAST_SIZE)
    step = np.zeros(minimum.jacobian.shape[1])
    step[columns] = steps
    here = minimum.jacobian[:, columns]
    there = equations.jacobian(equations.retract(minimum.point, step))[:, columns]
    length = np.linalg.norm(here, axis=0)
    bend = np.linalg.norm(there - here, axis=0) / steps
    return np.array([vanishing(*each, spread) for each in zip(length, size, bend, strict=True)], dtype=bool)
