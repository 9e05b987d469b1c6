"""Unknowns that no residual feels to first order: a derivative that is rounding, or vanishes beside the curvature.

The cosine of an angle at half a turn has the derivative 1e-16 in floating point, and ``1/J`` is no standard deviation.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.metric import rounded_turns, turning
from mbm.equations.types import Equations, Floats, Indices, Mask, Minimum

FAR = 1e4
"""Conditional standard deviations above so many times the coordinate's size are looked into."""

VANISHING = 1e-12
"""A derivative that vanishes nearer to the estimate than this share of its size is zero."""

FAINT = 1e-8
"""``J² / |∂J/∂x|``, in standard deviations: where the curvature moves the residuals by one, ``J`` moves them by the
root of twice this at most. A parabola y = x² whose x is ten thousand times less certain than large comes to 1e-4."""

JACOBIANS = 16
"""Jacobians that are made for this at most: more suspects than these are moved in groups."""

STEP = 1e-4
LEAST = 1e-6
"""Share of the size over which the derivative is differenced, and the least size."""


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
    for first in range(min(JACOBIANS, len(suspect))):
        group = suspect[first::JACOBIANS]
        zero[group] = _stationary(equations, minimum, group, size[group], spread)
    if not zero.any():
        return minimum
    kept = jacobian.copy()
    kept[:, zero] = 0.0
    return replace(minimum, jacobian=kept)


def suspects(equations: Equations, minimum: Minimum, length: Floats, spread: float = 1.0) -> Mask:
    """Which coordinates, with columns of such a ``length`` (n,), have absurd conditional standard deviations."""
    absurd = length * FAR * _size(equations, minimum) < spread
    return np.asarray((length > 0.0) & (minimum.at_bound == 0) & absurd)


def _size(equations: Equations, minimum: Minimum) -> Floats:
    """That of the coordinates (n,), 1 for those that are zero."""
    coordinates = np.abs(equations.coordinates(minimum.point))
    return np.where(coordinates > 0.0, coordinates, 1.0)


@np.errstate(all="ignore")
def _stationary(equations: Equations, minimum: Minimum, columns: Indices, size: Floats, spread: float) -> Mask:
    """Which of the columns (k,) are zero beside what small steps of them all make of each."""
    steps = STEP * np.maximum(size, LEAST)
    step = np.zeros(minimum.jacobian.shape[1])
    step[columns] = steps
    here = minimum.jacobian[:, columns]
    there = equations.jacobian(equations.retract(minimum.point, step))[:, columns]
    length = np.linalg.norm(here, axis=0)
    bend = np.linalg.norm(there - here, axis=0) / steps
    return vanishing(length, size, bend, spread)


def vanishing(length: Floats, size: Floats, bend: Floats, spread: float | Floats) -> Mask:
    """Whether columns of a ``length`` (k,) are zero beside their change ``bend`` with coordinates of a ``size``."""
    return np.asarray((length <= VANISHING * size * bend) | (length * length <= FAINT * bend * spread))
