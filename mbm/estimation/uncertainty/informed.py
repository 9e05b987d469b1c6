"""Minimum of a likelihood → what its covariance follows from: the Fisher information, not squares of residuals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.likelihoods import likely
from mbm.equations.types import Floats, Mask, Minimum
from mbm.estimation.uncertainty.stationary import suspects


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


AT_END = 1e6
"""Times the information of a row beyond which the slope of its residual is that of a root at its end."""

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
    ending = (np.square(own).sum(axis=1) > AT_END * np.square(told).sum(axis=1)) & ((own != 0.0).sum(axis=1) == 1)
    sides = minimum.at_bound.copy()
    for row in np.flatnonzero(ending).tolist():
        which = int(np.argmax(own[row] != 0.0))
        sides[which] = -np.sign(own[row, which] * minimum.residuals[row])
    length = np.sqrt(np.square(told).sum(axis=0))
    for which in np.flatnonzero(suspects(equations, replace(minimum, at_bound=sides), length)).tolist():
        if _flat(equations, minimum, np.eye(len(length))[which] / length[which]):
            told[:, which] = 0.0
    if any(stated.rounded for _, stated in likely(equations.groups)):
        told[:, _along_ridges(equations, minimum, told)] = 0.0
    return replace(minimum, jacobian=told, at_bound=sides)


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
