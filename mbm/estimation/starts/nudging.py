"""A start where a derivative has no value → one beside it where all have: a norm at zero, a point on its station.

The middle of a range in which no equation changes with an unknown → another point of the range: a square at zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Equations, Floats, Mask, Reason

SHARES = (1e-6, 1e-4, 1e-2)
"""How far to move, as shares of the size of the coordinates: no farther than it takes."""

SINGULAR = (Reason.NOT_FINITE_AT_START, Reason.JACOBIAN_NOT_FINITE_AT_START)

ELSEWHERE = (0.69, 0.27, 0.88, 0.11)
"""Other places in a range than its middle, as shares of it: to either side, alike under no symmetry."""

UNCHANGED = 1e-9
"""What an unknown changes of all residuals over its whole range, as a share of them, where it is said to change none:
rounding of the middle gives 1e-16, and a derivative so small leads nowhere."""


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


@np.errstate(all="ignore")
def off_stations(equations: Assembled, numbers: Floats, middle: Mask, completed: Callable[[Floats], Floats]) -> Floats:
    """The start (N,) that ``completed`` makes of the ``numbers`` (N,): those in the ``middle`` (N,) of their ranges
    elsewhere in these, where no equation changes with them at first.

    What no place of the range changes stays in the middle.
    """
    layout, own = equations.layout, equations.free
    lower = np.where(np.isfinite(layout.start_lower), layout.start_lower, layout.lower)[own]
    width = np.where(np.isfinite(layout.start_upper), layout.start_upper, layout.upper)[own] - lower
    places = layout.number[own]
    ranged = (places >= 0) & np.isfinite(width)
    ranged[ranged] = middle[places[ranged]]
    moved = numbers.copy()
    for share in ELSEWHERE:
        still = ranged & _still(equations, completed(moved), width)
        if not still.any():
            return completed(moved)
        moved[places[still]] = (lower + share * width)[still]
    still = ranged & _still(equations, completed(moved), width)
    moved[places[still]] = numbers[places[still]]
    return completed(moved)


def _still(equations: Assembled, point: Floats, width: Floats) -> Mask:
    """With which coordinates (n,) no residual changes at a point (N,), as far as derivatives tell over their ranges."""
    residuals, jacobian = equations.plain_linearised(point)
    change = np.linalg.norm(jacobian, axis=0) * width
    return np.asarray(change <= UNCHANGED * np.linalg.norm(residuals))
