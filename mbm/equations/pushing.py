"""Active bounds: those with a non-zero multiplier; a bound whose multiplier is zero is released."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.types import Floats

if TYPE_CHECKING:
    from numpy.typing import NDArray


def pushed(at_bound: NDArray[np.int8], slopes: Floats, lengths: Floats, x: Floats, cost: float) -> NDArray[np.int8]:
    """``at_bound`` (n,), 0 where the slopes ``Jᵀ r`` are nothing beside ``lengths`` of columns and ``cost`` = rᵀ r.

    Where data leave a combination of unknowns free, an iteration may end anywhere along it: whether that is just at a
    bound, and to which side rounding then tips the slope, says nothing. ``x`` (n,) are the coordinates.
    """
    from mbm.solver.decisions import IDLE, ROUNDED_PUSH

    made_of = np.sqrt(np.square(lengths * x).sum())
    idle = np.abs(slopes) <= lengths * (IDLE * np.sqrt(cost) + ROUNDED_PUSH * made_of)
    return np.where(idle, 0, at_bound).astype(np.int8)
