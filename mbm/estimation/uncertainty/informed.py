"""Minimum of a likelihood → what its covariance follows from: the Fisher information, not squares of residuals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mbm.equations.assembly import Assembled
from mbm.equations.metric import rounded_turns, turning
from mbm.equations.solves import likely
from mbm.equations.types import Equations, Floats, Indices, Mask, Minimum, Reason
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


def informed(equations: Assembled, minimum: Minimum) -> Minimum:
    """The minimum with a Jacobian whose squares are the Fisher information; as it is where there is no likelihood."""
    if not equations.likely or not np.isfinite(minimum.cost):
        return minimum
    if minimum.blocks is None:
        return _informed(equations, minimum)
    # Loaded by sparse problems only, so that the others start at once.
    from mbm.sparse.equations import blocked
    from mbm.sparse.system import blocks_of

    blocks, own = blocks_of(minimum), blocked(equations.informing())
    told = own.plain_block_jacobian(minimum.point, blocks.plan.arithmetic)
    count = len(own.places)
    return replace(minimum, blocks=replace(blocks, values=[*told[:count], *blocks.values[count:]]))


@np.errstate(all="ignore")
def rises_on(equations: Assembled, minimum: Minimum) -> bool:
    """Whether counts or limits still change with what they tell nothing of at an informed minimum: they are ever more
    probable towards the infinite, and no point on the way is a maximum.
    """
    if not equations.likely or minimum.blocks is not None or not minimum.jacobian.size:
        return False
    untold = (minimum.at_bound == 0) & ~(minimum.jacobian != 0.0).any(axis=0)
    rising = np.zeros(equations.whole, dtype=bool)
    for group, stated in likely(equations.groups):
        rising[group.first : group.first + group.count] = stated.rising
    kept = rising if equations.rows is None else rising[equations.rows]
    if not untold.any() or not kept.any():
        return False
    return bool((equations.plain_jacobian(minimum.point)[kept][:, untold] != 0.0).any())


AT_END = 100.0
"""Times the information of all rows beyond which the slope of the residual of one is that of a root at its end."""

INSIDE = 1e-3
"""Change of such a residual, were it straight, within which it goes on straight to one side, and as a root to the
other: roots end in 3e-6."""

BESIDE_ENDS = 1e-8
"""Standard deviations that the next step may have where others are at their ends: what these were off shows in it."""

GROWN = 0.1, 10.0
"""What the cost may have grown by one standard deviation away, where it is 1 if that means anything."""

ROUNDING = 1e-12
"""Share of the largest singular value below which one is rounding."""


TIED = 0.5
"""Correlation from which on coordinates move together."""


@np.errstate(all="ignore")
def _informed(equations: Assembled, minimum: Minimum) -> Minimum:
    """The same of dense problems.

    Estimates at which the model of a row ends are held by that as by a bound. Where the likelihood is flat about an
    estimate nothing tells it: its column is zero.
    """
    told, own = (each.plain_jacobian(minimum.point) for each in (equations.informing(), equations))
    sides, point = _ends(equations, minimum, np.square(told).sum(axis=0), own)
    if point is not minimum.point:
        minimum = _at_end(equations, minimum, sides == 0, point)
        told = equations.informing().plain_jacobian(point)
    length = np.sqrt(np.square(told).sum(axis=0))
    level = length == 0.0
    for which in np.flatnonzero(suspects(equations, replace(minimum, at_bound=sides), length)).tolist():
        level[which] = _flat(equations, minimum, np.eye(len(length))[which] / length[which])
    if any(stated.rounded for _, stated in likely(equations.groups)):
        level |= _along_ridges(equations, minimum, np.where(level, 0.0, told))
        level |= _told_beside(equations, told, level)
        if level.any() and minimum.reason.under_way:  # it is as high farther on
            minimum = replace(minimum, reason=Reason.ROUNDING)
        sides[level] = 0
    return replace(minimum, jacobian=np.where(level, 0.0, told), at_bound=sides)


def _told_beside(equations: Assembled, told: Floats, level: Mask) -> Mask:
    """Coordinates (n,) of rounded readings whose scatter is ``level`` (n,): how well they are told is open with it."""
    found = np.zeros(len(level), dtype=bool)
    numbers = equations.layout.number[equations.free]
    for group, seen in zip(equations.groups, equations.informing().groups, strict=True):
        if group.readings is None or not group.readings.rounded:
            continue
        scales = [numbers[level] == equations.layout.entry(name).range.start for name in group.readings.scales]
        if np.any(scales):
            found |= (told[seen.first : seen.first + seen.count] != 0.0).any(axis=0)
    return found


def _ends(equations: Assembled, minimum: Minimum, information: Floats, own: Floats) -> tuple[NDArray[np.int8], Floats]:
    """The sides (n,) at which estimates are held, those included at which the model of a row ends: one after the other,
    where rows hold all but one of the coordinates that they depend on. The point is the minimum, brought to such ends.
    """
    sides, point = minimum.at_bound.copy(), minimum.point
    least = np.maximum(AT_END * information, 1.0 / np.square(ABSURD * np.maximum(_size(equations, minimum), 1.0)))
    while True:
        slopes = np.where(sides == 0, own, 0.0)
        ending = (np.square(slopes) > least).any(axis=1) & ((slopes != 0.0).sum(axis=1) == 1)
        if not ending.any():
            return sides, point
        row = int(np.argmax(ending))
        which = int(np.argmax(slopes[row] != 0.0))
        step = np.zeros(len(sides))
        step[which] = INSIDE / own[row, which]
        points = np.stack([equations.retract(minimum.point, side * step) for side in (-1.0, 1.0)])
        low, high = np.abs(equations.residuals_at(points)[:, row])
        sides[which] = np.sign(step[which]) * (-1 if low > high else 1)
        point = _where_it_ends(equations, point, row, which, float(own[row, which]))


def _where_it_ends(equations: Assembled, point: Floats, row: int, which: int, slope: float) -> Floats:
    """The point with one coordinate where the residual of a row, with such a ``slope``, is zero, or at 0 if it is there
    as well.
    """
    place, off = float(equations.coordinates(point)[which]), float(equations.residuals(point)[row])
    steps = np.zeros((2, equations.dimension))
    steps[:, which] = -place, np.clip(place - off / slope, equations.lower[which], equations.upper[which]) - place
    points = np.stack([equations.retract(point, step) for step in steps])
    zero, near = np.abs(equations.residuals_at(points)[:, row])
    within = equations.lower[which] <= 0.0 <= equations.upper[which]
    if within and zero <= near:
        return np.asarray(points[0])
    return np.asarray(points[1]) if near <= abs(off) else point


def _at_end(equations: Assembled, minimum: Minimum, free: Mask, point: Floats) -> Minimum:
    """The minimum at the ``point``, where all coordinates but the ``free`` (n,) are held; settled, if those are."""
    residuals, reason = equations.residuals(point), minimum.reason
    if reason.under_way:
        slopes = equations.plain_jacobian(point)[:, free]
        left = slopes @ np.linalg.lstsq(slopes, residuals)[0]
        reason = Reason.SMALL_OFFSET if float(left @ left) < BESIDE_ENDS**2 else reason
    return replace(minimum, point=point, residuals=residuals, cost=float(residuals @ residuals), reason=reason)


def _along_ridges(equations: Assembled, minimum: Minimum, told: Floats) -> Mask:
    """Coordinates (n,) that a ridge of the likelihood leaves open together: rounded readings in two neighbouring steps
    are explained the better, the less they scatter about the limit between the steps.
    """
    length = np.sqrt(np.square(told).sum(axis=0))
    scale = np.where(length > 0.0, length, 1.0)
    values, vectors = np.linalg.svd(told / scale, full_matrices=False)[1:]
    factor = (vectors / np.where(values > ROUNDING * values.max(initial=0.0), values, np.inf)[:, None]).T / scale[
        :, None
    ]
    sigma = np.sqrt(np.square(factor).sum(axis=1))
    found = np.zeros(len(length), dtype=bool)
    for which in np.flatnonzero(length > 0.0).tolist():
        step = factor @ factor[which] / sigma[which]
        if _flat(equations, minimum, step):
            found |= np.abs(step) > TIED * sigma
    return found


def _flat(equations: Assembled, minimum: Minimum, step: Floats) -> bool:
    """Whether a step of one standard deviation to both sides does something else to the cost than it should."""
    there = equations.residuals_at(np.stack([equations.retract(minimum.point, side * step) for side in (-1.0, 1.0)]))
    grown = np.square(there).sum(axis=1) - minimum.cost
    return not bool(((grown > GROWN[0]) & (grown < GROWN[1])).any())
