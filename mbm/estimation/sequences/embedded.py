"""A filter with room for the rows of a step alone, as generated code takes it: sizes and descriptions of equations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.types import Indices
from mbm.estimation.minimise.native.packing import blocks_of
from mbm.estimation.sequences.room import GroupRows, Room, room
from mbm.estimation.sequences.run import Begun
from mbm.estimation.sequences.step_rows import BY_TABLE, StepRows
from mbm.estimation.sequences.walk import chain_of
from mbm.expression.nodes import Column, ColumnMember, leaves
from mbm.kernels.types import KernelSet
from mbm.problem.sequence.types import TransitionKind
from mbm.problem.types import BlockRole, Problem
from mbm.solver import description as of
from mbm.symbolic.types import ColumnInput
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Embedded:
    """``seen`` and ``moving`` have room for the steps that are held; ``whens`` as `step_rows` has them, by group.

    ``fixed`` are the rows of groups that belong to no step. Group k of a transition has ``noises[k]``: the first column
    of its noise, and how many there are. ``chain`` are the sizes, ``reached`` the columns of what varies in a
    transition.
    """

    seen: Room
    moving: Room
    whens: tuple[str, ...]
    fixed: tuple[GroupRows | None, ...]
    noises: tuple[tuple[int, int], ...]
    chain: Indices

    @property
    def held(self) -> int:
        """Steps whose rows there is room for."""
        return self.seen.held


def embedded(
    begun: Begun, kernels: KernelSet, cache: EvaluationCache, most: Mapping[str, int], beside: frozenset[str]
) -> Embedded:
    """A filter that holds the rows of as many steps as it needs, of some tables so many ``most`` rows each.

    Rows that belong to no step are fixed, but for those that depend on tables ``beside``.
    """
    rows = StepRows(begun, kernels, cache)
    rules = replace(begun.rules, endless=True)
    held = (rules.lag or 0) + 2 if rules.smooth else 1
    fixed = tuple(
        None if when in BY_TABLE or not beside.isdisjoint(tables_of(rows.seen[k], begun.problem)) else rows.fixed(k)
        for k, when in enumerate(rows.when)
    )
    capacity = [
        max(most.get(table, 1), 1) if own is None else len(own) for own, table in zip(fixed, rows.tables, strict=True)
    ]
    blocks, chained = begun.problem.blocks, begun.chained
    seen = room(chained.seen, held, np.array(capacity, dtype=np.int64), cache, blocks, calls=0)
    ones = np.ones(len(rows.moving), dtype=np.int64)
    moving = room(chained.moving, held, ones, cache, blocks, calls=0)
    noises: list[tuple[int, int]] = []
    for group in rows.moving:
        first = sum(noises[-1]) if noises else 0
        noises.append((first, _noises(begun, group)))
    width = sum(noises[-1]) if noises else 0
    size = len(begun.places.free) - begun.places.still
    whole = replace(chained, seen=seen.local, moving=moving.local, spreads=np.zeros((held, size, width)))
    chain = chain_of(whole, replace(rules, endless=False))
    return Embedded(seen=seen, moving=moving, whens=rows.when, fixed=fixed, noises=tuple(noises), chain=chain)


def tables_of(group: Group, problem: Problem) -> set[str]:
    """The tables that rows, their noise and what they pick depend on."""
    block = problem.blocks[group.kernel.owner]
    inputs = [each for each in group.kernel.parameters if isinstance(each, ColumnInput)]
    noises = leaves(tuple(node for e in block.cases[group.kernel.case].equations for node in e.noise))
    columns: list[ColumnInput | Column] = [*inputs, *(leaf for leaf in noises if isinstance(leaf, Column))]
    members = [*(each.member for each in columns), *(each.member for each in group.kernel.variables)]
    found = {each.table for each in columns} | {each.table for each in members if isinstance(each, ColumnMember)}
    found |= set() if block.table is None else {block.table}
    joined = (join.table for plan in problem.plans if plan.name in found for join in plan.joins)
    return found.union(joined)


def _noises(begun: Begun, group: Group) -> int:
    """The rank of the noise of a transition, at most."""
    problem, sequence = begun.problem, begun.sequence
    block = problem.blocks[group.kernel.owner]
    if block.role is BlockRole.CONSTRAINT:
        return 0
    kind = next(t.kind for t in sequence.transitions if t.block == block.name)
    size = sum(len(equation.components) for equation in block.cases[group.kernel.case].equations)
    return size // 2 if kind is TransitionKind.CONSTANT_VELOCITY else size


def numbered(whole: Room, first: int) -> Indices:
    """The description of a room's equations for rows one by one, with kernels by number.

    2k are the values of kernel k, 2k + 1 those with the derivatives; the first kernel is number ``first``.
    """
    system = whole.local.native.system.copy()
    blocks = blocks_of(system)
    blocks[:, of.Block.values] = 2 * (first + np.arange(len(blocks)))
    blocks[:, of.Block.jacobian] = blocks[:, of.Block.values] + 1
    return system
