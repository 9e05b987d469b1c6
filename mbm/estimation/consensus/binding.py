"""The equations of a solve as consensus asks for them: their units, without losses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats
from mbm.estimation.consensus.units import Units
from mbm.estimation.minimise.sparsity import sparse_suits
from mbm.problem.types import Block, Problem
from mbm.solver.decisions import CONSENSUS_ROUNDING, STATED


def units_of(equations: Assembled, problem: Problem, point: Floats, ruled: Callable[[Block], bool]) -> Units:
    """The units of the blocks that ``ruled`` picks; ``point`` (N,) is where the rounding of residuals is judged."""
    numbers = equations.units
    act = np.zeros(equations.whole, dtype=bool)
    group = np.full(equations.whole, STATED, dtype=np.int64)
    for each in equations.groups:
        block = problem.blocks[each.kernel.owner]
        lines = slice(each.first, each.first + each.count)
        act[lines] = ruled(block)
        group[lines] = each.kernel.owner if block.unknown_factor else STATED
    number, first, of_row, sizes = np.unique(numbers[act], return_index=True, return_inverse=True, return_counts=True)
    rows = np.full(equations.whole, -1, dtype=np.int64)
    rows[act] = of_row
    terms = np.abs(equations.plain_residuals(point))
    if not sparse_suits(equations):
        terms = terms + np.abs(equations.plain_jacobian(point)) @ np.abs(equations.coordinates(point))
    terms = np.where(np.isfinite(terms), terms, 0.0)[act]
    return Units(
        of_row=rows,
        components=np.asarray(sizes, dtype=np.int64),
        group=group[act][first],
        number=np.asarray(number, dtype=np.int64),
        rounding=np.square(CONSENSUS_ROUNDING * np.maximum.reduceat(terms, first)) if first.size else np.empty(0),
    )


def without_losses(equations: Assembled) -> Assembled:
    """The same equations, every unit with its plain squares."""
    return replace(equations, groups=tuple(replace(g, losses=()) for g in equations.groups))
