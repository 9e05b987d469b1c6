"""Where noise is unknown: the fit to the units that agree, their noise and their limits, solved for together.

The noise of a group is ``SSE/((n − p) κ)`` of its inliers, κ depends on their limits, limits on the noise, and weights
in the fit on the noise again. Given which units are inside, all that is a function of the point, so that steps end at
rounding: the answer depends on the units that agree, and not on the way to them.
"""

from __future__ import annotations

import numpy as np

from mbm.solution.robust.refine import rest_of, weighted_step
from mbm.solution.robust.scale import noise_and_limits
from mbm.solution.robust.scores import STATED_CUT, variances_at
from mbm.solution.robust.trials import Trials
from mbm.solution.robust.units import Units
from mbm.solution.robust.units import limits as deviation_limits
from mbm.solution.types import Floats, Mask
from mbm.target.decisions import ARRIVED, JOINT_STEPS, STATED
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Joint:
    """The ``point`` (N,) that fits the ``inliers`` (U,), and there their limits (U,) and the noise's variances (U,)."""

    point: Floats
    inliers: Mask
    limits: Floats
    noise: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _There:
    """What the inliers make of a point, and the step (n,) from there that promises to lower their squares."""

    point: Floats
    squares: Floats
    noise: Floats
    limits: Floats
    step: Floats
    promise: float


def joint(
    trials: Trials, units: Units, point: Floats, inliers: Mask, cut: Floats, variances: Floats, *, widening: bool
) -> Joint:
    """The joint solution near a point (N,), with the units that come in by it.

    ``variances`` (U,) hold for stated noise; ``cut`` (U,) times those that the robust scale says are the limits. The
    robust scale of a few dozen residuals is uncertain by a tenth and more: where it came out low, good units were cut
    off. With ``widening``, three standard deviations of the inliers take them back.
    """
    reach = deviation_limits(units.components, STATED_CUT) if widening else None
    while True:
        found = _fitted(trials, units, point, inliers, cut, variances, reach)
        wider = found.limits
        if reach is not None:
            wider = np.where(units.group == STATED, wider, np.maximum(wider, reach * found.noise))
        more = inliers | (found.squares <= wider)
        if bool((more == inliers).all()):
            return Joint(point=found.point, inliers=inliers, limits=found.limits, noise=found.noise)
        point, inliers = found.point, more


def _fitted(
    trials: Trials,
    units: Units,
    point: Floats,
    inliers: Mask,
    cut: Floats,
    variances: Floats,
    reach: Floats | None,
) -> _There:
    """The fit to the inliers with weights by their noise: Gauss-Newton steps as long as they promise less and less."""

    def at(point: Floats) -> _There:
        residuals, jacobian = trials.linearised(point[None])
        squares = units.squares(residuals)[0]
        fresh = np.where(units.group == STATED, variances, variances_at(squares, units, trials.dimension))
        noise, limits = noise_and_limits(squares, inliers, fresh, units, trials.dimension, cut, reach)
        weights = units.expanded(np.where(inliers, 1.0 / noise, 0.0))
        steps, promise = weighted_step(trials, residuals, jacobian, weights[None], np.zeros(1))
        known = np.isfinite(squares[inliers].sum() + rest_of(residuals, units)[0])
        return _There(
            point=point,
            squares=squares,
            noise=noise,
            limits=limits,
            step=steps[0],
            promise=float(promise[0]) if known else np.inf,
        )

    found = at(point)
    for _ in range(JOINT_STEPS):
        if not ARRIVED < found.promise < np.inf:
            break
        there = at(trials.moved(found.point[None], found.step[None])[0])
        if not there.promise < found.promise:
            break
        found = there
    return found
