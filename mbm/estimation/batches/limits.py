"""Constraints of many solves in columns: value, violation and multiplier of each in each solve."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.portion import Portion
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.surface import Held, Tangents
from mbm.estimation.batches.types import Limits, Rows, Which
from mbm.problem.kinds import ConstraintKind
from mbm.problem.types import Problem


def limits(
    problem: Problem, stack: Stack, which: Which, portion: Portion, found: Held, along: Tangents, multipliers: Floats
) -> Limits:
    """The constraints of some solves."""
    owners = tuple(dict.fromkeys(group.kernel.owner for group in stack.equations.constraints))
    mine = {owner: _mine(portion, owner) for owner in owners}
    pushing = found.forcing & ~found.equality
    return Limits(
        owners=owners,
        values=np.stack([_value(problem, found, owner, mine[owner]) for owner in owners], axis=1),
        active=np.stack([(found.active & mine[owner]).any(axis=1) for owner in owners], axis=1),
        pushed=np.stack([(pushing & mine[owner]).any(axis=1) for owner in owners], axis=1),
        rows=_rows(portion, owners),
        at_limit=tuple(_at_limit(problem, stack, which, portion, found, owner) for owner in owners),
        multipliers=_in_order(problem, stack, which, portion, multipliers),
        dimension=stack.equations.dimension - along.taken + along.equalities,
        moving=stack.equations.dimension - along.taken,
    )


def _in_order(problem: Problem, stack: Stack, which: Which, portion: Portion, multipliers: Floats) -> Floats:
    """The multipliers (K, c) in the order of each solve by itself: windows are stacked by time, and look at rows as
    they stand in their table.
    """
    found = multipliers.copy()
    for number, (group, solve, slots) in enumerate(portion.limits(), len(stack.equations.groups)):
        table = problem.blocks[group.kernel.owner].table
        if table is not None and group.positions is not None:
            rows = stack.tables[table].rows[group.positions[stack.lines(number, which)[1]]]
            found[solve[:, None], slots] = multipliers[solve[:, None], slots[np.lexsort((rows, solve))]]
    return found


def _mine(portion: Portion, owner: int) -> Mask:
    """Which constraints (K, c) are those of a block."""
    found = np.zeros((portion.count, portion.most_limits), dtype=bool)
    for group, solve, slots in portion.limits():
        if group.kernel.owner == owner:
            found[solve[:, None], slots] = True
    return found


def _value(problem: Problem, found: Held, owner: int, mine: Mask) -> Floats:
    """What is left to the limit (K,), of equations the difference of their sides, the worst of several; 0 of none."""
    equation = problem.blocks[owner].constraint is ConstraintKind.EQUAL
    badness = np.where(mine, np.abs(found.values) if equation else found.values, -np.inf)
    worst = np.take_along_axis(found.values, badness.argmax(axis=1)[:, None], axis=1)[:, 0]
    worst = np.where(mine.any(axis=1), worst, 0.0)
    return worst if equation else 0.0 - worst


def _rows(portion: Portion, owners: tuple[int, ...]) -> Indices:
    """How often (K, owners) each block of constraints is there."""
    found = np.zeros((portion.count, len(owners)), dtype=np.int64)
    for group, solve, _ in portion.limits():
        found[:, owners.index(group.kernel.owner)] += np.bincount(solve, minlength=portion.count)
    return found


def _at_limit(problem: Problem, stack: Stack, which: Which, portion: Portion, found: Held, owner: int) -> Rows | None:
    """The rows that are at their limit, of inequalities over a table."""
    block = problem.blocks[owner]
    if block.table is None or block.constraint is ConstraintKind.EQUAL:
        return None
    result: Rows | None = None
    for number, (group, solve, slots) in enumerate(portion.limits(), len(stack.equations.groups)):
        if group.kernel.owner != owner or group.positions is None:
            continue
        reached = found.active[solve[:, None], slots].any(axis=1)
        lines = stack.lines(number, which)[1]
        mine = Rows.of_rows(stack.tables[block.table], group.positions[lines][reached], solve[reached], len(which))
        result = mine if result is None else result.joined(mine)
    return result
