"""Which of many solves may have readings in coarse steps, or at limits; what is found is looked at again by itself."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Mask
from mbm.estimation.batches.doubts import MARGIN
from mbm.estimation.batches.portion import Portion
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import Which
from mbm.estimation.trust.coarse import LEAST_ROWS, coarse, rounded_column
from mbm.estimation.trust.edges import SIDES, at_edge, clauses_read
from mbm.problem.types import Problem


def misread(
    problem: Problem, stack: Stack, which: Which, portion: Portion, residuals: Floats, basis: Floats, noise: Floats
) -> Mask:
    """Solves (K,) that `trust.coarse` or `trust.edges` may warn of; ``noise`` (K,) multiplies standard deviations."""
    given = problem, stack, which, portion, residuals, basis, noise
    return coarsely_read(*given) | read_at_edges(*given)


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


@np.errstate(all="ignore")
def read_at_edges(
    problem: Problem, stack: Stack, which: Which, portion: Portion, residuals: Floats, basis: Floats, noise: Floats
) -> Mask:
    """Solves (K,) that `trust.edges` may warn of; arguments as `coarsely_read` has them."""
    found = np.zeros(portion.count, dtype=bool)
    clauses = {} if portion.consensus else clauses_read(problem, stack.equations)
    if not clauses:
        return found
    deviations = portion.deviations()
    for clause, (table, column) in clauses.items():
        readings = np.full(residuals.shape, np.nan)
        for number, (owner, solve, slots) in enumerate(portion.groups()):
            positions = stack.equations.groups[number].positions
            if owner == clause and positions is not None and len(solve):
                readings[solve, slots[:, 0]] = stack.tables[table].numbers(column)[
                    positions[stack.lines(number, which)[1]]
                ]
        raw, scaled = residuals * deviations, deviations * noise[:, None]
        for sign in SIDES:
            found |= at_edge(readings, raw, scaled, basis, sign, MARGIN)[1]
    return found
