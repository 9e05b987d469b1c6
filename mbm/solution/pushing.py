"""Active bounds: those with a non-zero multiplier; a bound whose multiplier is zero is released."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mbm.solution.types import Equations, Floats, Minimum

if TYPE_CHECKING:
    from numpy.typing import NDArray


def pushed(at_bound: NDArray[np.int8], slopes: Floats, lengths: Floats, x: Floats, cost: float) -> NDArray[np.int8]:
    """``at_bound`` (n,), 0 where the slopes ``Jᵀ r`` are nothing beside ``lengths`` of columns and ``cost`` = rᵀ r.

    Where data leave a combination of unknowns free, an iteration may end anywhere along it: whether that is just at a
    bound, and to which side rounding then tips the slope, says nothing. ``x`` (n,) are the coordinates.
    """
    from mbm.target.decisions import IDLE, ROUNDED_PUSH

    made_of = np.sqrt(np.square(lengths * x).sum())
    idle = np.abs(slopes) <= lengths * (IDLE * np.sqrt(cost) + ROUNDED_PUSH * made_of)
    return np.where(idle, 0, at_bound).astype(np.int8)


@np.errstate(all="ignore")
def with_pushed_bounds(equations: Equations, minimum: Minimum) -> Minimum:
    """The minimum with coordinates held only where the residuals push; dense problems without constraints.

    Constraints push as well, and say so themselves; the sparse solver looks at its own columns.
    """
    if minimum.blocks is not None or minimum.constraints is not None or not minimum.at_bound.any():
        return minimum
    lengths = np.linalg.norm(minimum.jacobian, axis=0)
    slopes = minimum.jacobian.T @ minimum.residuals
    sides = pushed(minimum.at_bound, slopes, lengths, equations.coordinates(minimum.point), minimum.cost)
    return replace(minimum, at_bound=sides)
