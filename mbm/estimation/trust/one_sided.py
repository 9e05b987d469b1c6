"""Outliers under a loss that nearly all lie on one side: they draw the estimates to it.

A loss bounds what each of them does, and where they lie on either side alike, they cancel. Ranges around corners are
too long, all of them: under Huber's loss a tenth of such rows shifts a mean by 0.15 standard deviations of a row, which
many rows do not average out. Under the hypothesis of symmetric errors far residuals are as often positive as negative
(the sign test: Conover 1999, Practical Nonparametric Statistics, chapter 3).
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from mbm.equations.assembly import Assembled, loss_lines
from mbm.equations.losses import loss_weights
from mbm.equations.types import Floats
from mbm.estimation.consensus import faults
from mbm.estimation.consensus.units import outlying
from mbm.problem.types import Problem
from mbm.text.types import Diagnostic

BY_CHANCE = 1e-3
"""Probability up to which signs that differ so much are no chance: 11 rows or more, all on one side."""

PULL = 1.0
"""What the far rows weigh on one side more than on the other, in deviations of a mean of all rows."""


@np.errstate(all="ignore")
def one_sided(problem: Problem, equations: Assembled, residuals: Floats) -> tuple[Diagnostic, ...]:
    """A warning about each clause of single equations whose far residuals pull to one side.

    ``residuals`` (all,) are plain and whitened with the final noise; NaN where there are none.
    """
    if equations.rows is not None:
        return ()
    from scipy.special import bdtr  # the binomial distribution; loaded by losses only, so that the others start at once

    pulls = loss_weights(loss_lines(equations), residuals) * residuals
    beyond = outlying(loss_lines(equations), residuals)
    single = [lines[:, 0] for _, lines in loss_lines(equations) if lines.shape[1] == 1]
    under = np.isin(np.arange(len(residuals)), np.concatenate(single)) if single else np.zeros(len(residuals), bool)
    owners = np.zeros(len(residuals), dtype=np.int64)
    for group in equations.groups:
        owners[group.first : group.first + group.count] = group.kernel.owner
    under &= np.isfinite(residuals)
    clauses = np.unique(owners[under]).tolist()
    found = []
    for owner in clauses:
        mine = under & (owners == owner)
        far = mine & beyond
        above, count = int((residuals[far] > 0.0).sum()), int(far.sum())
        chance = 2.0 * float(bdtr(min(above, count - above), count, 0.5))
        pulled = abs(float(pulls[far].sum())) / sqrt(float(mine.sum())) if count else 0.0
        if chance * len(clauses) < BY_CHANCE and pulled > PULL:
            block = problem.blocks[owner]
            found.append(faults.one_sided_outliers(block.span, block.name, max(above, count - above), count))
    return tuple(found)
