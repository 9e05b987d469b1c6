"""Which of many solves have constraints whose surface bends within their intervals."""

from __future__ import annotations

import numpy as np

from mbm.equations.surface import exact_constraints
from mbm.equations.types import Floats, Mask
from mbm.estimation.batches.factor import Factors
from mbm.estimation.batches.portion import Portion
from mbm.estimation.batches.surface import Held
from mbm.estimation.batches.types import Ends
from mbm.estimation.trust.nonlinearity import LOOKED_AT, NORMAL_95, end_ratios

BACK, NEARLY = 3, 0.03
"""Steps back to a surface, and how far what they find may be from what more of them would."""


@np.errstate(all="ignore")
def curved(portion: Portion, ends: Ends, state: Held, found: Factors, noise: Floats) -> Mask:
    """Solves (K,) whose surface may bend within their intervals, which then are looked at one by one.

    The quick look of `nonlinearity` at coordinates, the ends brought back to the surface as `trust.surface` does it;
    ``noise`` (K,) times the root that was ``found`` leads there. Not under losses.
    """
    wrong = np.zeros(portion.count, dtype=bool)
    if portion.equations.lossy or bool(exact_constraints(portion.equations).all()):
        return wrong
    slopes = np.where(state.forcing[:, :, None], state.slopes, 0.0)
    slopes = np.where(np.isfinite(slopes), slopes, 0.0)
    scale = np.where(found.scale > 0.0, found.scale, 1.0)
    back = np.linalg.pinv(slopes / scale[:, None, :]) / scale[:, :, None]
    for place in range(found.root.shape[1]):
        length = np.sqrt(np.square(found.root[:, place]).sum(axis=1))
        along = found.root[:, place] / np.where(length > 0.0, length, 1.0)[:, None]
        far = NORMAL_95 * noise * length
        for side in (-1.0, 1.0):
            step = side * NORMAL_95 * noise[:, None] * np.matmul(found.root, along[:, :, None])[:, :, 0]
            for _ in range(BACK):
                points = portion.equations.retract(ends.points, step)
                values = np.where(state.forcing, portion.constrained(points)[0], 0.0)
                step = step - np.matmul(back, values[:, :, None])[:, :, 0]
            residuals = portion.residuals(portion.equations.retract(ends.points, step))
            grown = end_ratios(residuals, found.basis, along, ends.cost, np.square(noise))
            ratio = step[:, place] / (side * far) * grown
            wrong |= (length > 0.0) & ~(np.abs(ratio - 1.0) <= LOOKED_AT - NEARLY)
    return wrong
