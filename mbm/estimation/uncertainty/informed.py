"""Minimum of a likelihood → what its covariance follows from: the Fisher information, not squares of residuals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Minimum


def informed(equations: Assembled, minimum: Minimum) -> Minimum:
    """The minimum with a Jacobian whose squares are the Fisher information; as it is where there is no likelihood."""
    if not equations.likely or not np.isfinite(minimum.cost):
        return minimum
    if minimum.blocks is None:
        return replace(minimum, jacobian=equations.informing().plain_jacobian(minimum.point))
    # Loaded by sparse problems only, so that the others start at once.
    from mbm.sparse.equations import blocked
    from mbm.sparse.system import blocks_of

    blocks, own = blocks_of(minimum), blocked(equations.informing())
    told = own.plain_block_jacobian(minimum.point, blocks.plan.arithmetic)
    count = len(own.places)
    return replace(minimum, blocks=replace(blocks, values=[*told[:count], *blocks.values[count:]]))
