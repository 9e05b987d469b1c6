"""A start where a derivative has no value → one beside it where all have: a norm at zero, a point on its station."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbm.equations.types import Equations, Floats, Reason

SHARES = (1e-6, 1e-4, 1e-2)
"""How far to move, as shares of the size of the coordinates: no farther than it takes."""

SINGULAR = (Reason.NOT_FINITE_AT_START, Reason.JACOBIAN_NOT_FINITE_AT_START)


def beside(equations: Equations, start: Floats, seed: int) -> Iterator[Floats]:
    """Points (N,) beside a start (N,), farther and farther away; none without a finite value.

    All coordinates move, to either side in a direction that no symmetry of the equations has, and stay in their bounds;
    the direction follows from the ``seed`` of the solve.
    """
    with np.errstate(all="ignore"):
        if not bool(np.isfinite(equations.residuals(start)).all()):
            return
    coordinates = equations.coordinates(start)
    size = np.where(coordinates != 0.0, np.abs(coordinates), 1.0)
    random = np.random.default_rng(seed)
    step = size * random.uniform(0.5, 1.0, coordinates.size) * random.choice((-1.0, 1.0), coordinates.size)
    for share in (sign * share for share in SHARES for sign in (1.0, -1.0)):
        moved = equations.retract(start, share * step)
        yield equations.placed(moved, np.clip(equations.coordinates(moved), equations.lower, equations.upper))
