"""How far an iteration is from its end, and how trust radius and damping follow what a step brought."""

from __future__ import annotations

from math import inf, log, sqrt
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mbm.machine.words import Integer, Real


def relative_offset(inside: Real, outside: Real, moving: Integer, freedom: Integer) -> Real:
    """Bates and Watts (1981): residuals in the tangent plane against those outside it, root mean square per dimension.

    About the length of the next step in standard deviations of the estimates.
    """
    if inside <= 0.0:
        return 0.0
    if outside <= 0.0:
        return inf
    dimensions = float(moving) if moving > 1 else 1.0
    spare = float(freedom) if freedom > 1 else 1.0
    return sqrt((inside / dimensions) / (outside / spare))


def remaining(offset: Real, before: Real, tolerance: Real) -> Real:
    """Iterations still needed at the present linear rate, 1e300 where the offset does not shrink."""
    if offset <= tolerance:
        return 0.0
    if not before > 0.0 or offset >= before:
        return 1e300
    return log(tolerance / offset) / log(offset / before)


def radius_after(gain: Real, radius: Real, length: Real, whole: Integer) -> Real:
    """The trust radius after an accepted step of that length with that gain ratio (Moré 1978).

    ``whole`` 1: the step was the undamped one.
    """
    if gain <= 0.25:
        longest = 10.0 * length
        return 0.5 * (longest if longest < radius else radius)
    if whole == 1 or gain >= 0.75:
        return 2.0 * length
    return radius


def shortened(slope: Real, actual: Real) -> Real:
    """The factor for the radius after a step that was refused: half of where the parabola through ``slope`` (half the
    directional derivative of the cost) and the decrease ``actual`` is least, as MINPACK has it.
    """
    if actual >= 0.0:
        return 0.5
    share = 0.0
    if slope < 0.0:
        share = 0.5 * slope / (slope + 0.5 * actual)
    if share < 0.1:
        return 0.1
    return 0.5 if share > 0.5 else share


def damping_factor(gain: Real) -> Real:
    """The factor for the damping after an accepted step with that gain ratio (Nielsen 1999)."""
    turn = 2.0 * min(gain, 1.0) - 1.0
    return max(1.0 / 3.0, 1.0 - turn * turn * turn)
