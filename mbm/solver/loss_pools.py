"""Sums over the units of one loss, of which `mbm.solver.loss_spread` makes the factors of the sandwich."""

from __future__ import annotations

from math import fabs

from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.description import NO_LOSS, Problem, Unit
from mbm.solver.loss_spread import loss_trace, spread_factor
from mbm.solver.losses import loss_weight

TOTAL = 0
TRACES = 1
SQUARED_TRACES = 2
SPREAD = 3
COUNT = 4
STATED = 5
SUMS = 6


def same_loss(constants: ConstantReals, unit: Unit, other: Unit) -> Integer:
    """Whether two units have the same loss."""
    if unit.loss != other.loss:
        return 0
    if unit.loss == NO_LOSS:
        return 1
    a = unit.loss_at
    b = other.loss_at
    return 1 if constants[a] == constants[b] and constants[a + 1] == constants[b + 1] else 0


def first_with_loss(problem: Problem, constants: ConstantReals, number: Integer, own: Integer) -> Integer:
    """Whether no unit before unit ``own`` of block ``number`` has the same loss."""
    unit = problem.blocks[number].units[own]
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        for u in range(block.unit_count):
            if b == number and u == own:
                return 1
            if same_loss(constants, block.units[u], unit) == 1:
                return 0
    return 1


def add_to_sums(unit: Unit, constants: ConstantReals, stated: Integer, square: Real, sums: Reals) -> Real:
    """Add what a unit whose whitened residual has the squared norm ``square`` gives to the sums; its weight."""
    size = unit.last - unit.first
    weight = 1.0
    trace = float(size)
    if unit.loss != NO_LOSS:
        scale = constants[unit.loss_at]
        shape = constants[unit.loss_at + 1]
        weight = loss_weight(unit.loss, square, scale, shape)
        trace = loss_trace(unit.loss, square, scale, shape, size)
    sums[TOTAL] += float(size) * weight
    if stated == 1:
        sums[STATED] += float(size) * weight
    sums[SPREAD] += weight * weight * square
    sums[COUNT] += float(size)
    sums[TRACES] += trace
    sums[SQUARED_TRACES] += trace * trace / float(size)
    return weight


def spread_of_loss(share: Real, sums: ConstantReals) -> Real:
    """The factor of A in G, where the units determine ``share`` unknowns."""
    found = spread_factor(
        share, sums[TOTAL], sums[TRACES], sums[SQUARED_TRACES], sums[SPREAD], sums[COUNT], sums[STATED]
    )
    return fabs(found)  # it is not negative
