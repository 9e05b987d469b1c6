"""Which of many solves may have readings in coarse steps; what is found is looked at again by itself."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Mask
from mbm.estimation.batches.doubts import MARGIN
from mbm.estimation.batches.portion import Portion
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import Which
from mbm.estimation.trust.coarse import LEAST_ROWS, coarse, rounded_column
from mbm.problem.types import Problem


@np.errstate(all="ignore")
def coarsely_read(
    problem: Problem, stack: Stack, which: Which, portion: Portion, residuals: Floats, basis: Floats, noise: Floats
) -> Mask:
    """Solves (K,) that `trust.coarse` may warn of; ``noise`` (K,) is what all standard deviations are multiplied by."""
    found = np.zeros(portion.count, dtype=bool)
    if portion.consensus or portion.equations.lossy or portion.equations.likely or portion.most < LEAST_ROWS:
        return found
    deviations: Floats | None = None
    for number, (owner, solve, slots) in enumerate(portion.groups()):
        name, table = rounded_column(problem, owner), problem.blocks[owner].table
        positions = stack.equations.groups[number].positions
        if name is None or table is None or positions is None or not len(solve):
            continue
        deviations = portion.deviations() if deviations is None else deviations
        readings = np.full(residuals.shape, np.nan)
        readings[solve, slots[:, 0]] = stack.tables[table].numbers(name)[positions[stack.lines(number, which)[1]]]
        found |= coarse(readings, residuals * deviations, deviations * noise[:, None], basis, MARGIN)
    return found
