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
from mbm.kernels.types import KernelSet
from mbm.problem.sequence.types import TransitionKind
from mbm.problem.types import BlockRole
from mbm.solver import description as of
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Embedded:
    """``seen`` and ``moving`` have room for the steps that are held; ``whens`` as `step_rows` has them, by group.

    ``fixed`` are the rows of groups that belong to no step. Group k of a transition has ``noises[k]``: the first column
    of its noise, and how many there are. ``chain`` are the sizes, ``reached`` the columns of what varies in a
    transition.
    """

    begun: Begun
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


def embedded(begun: Begun, kernels: KernelSet, cache: EvaluationCache, most: Mapping[str, int]) -> Embedded:
    """A filter that holds the rows of as many steps as it needs, of a table with steps so many ``most`` rows each."""
    rows = StepRows(begun, kernels, cache)
    rules = replace(begun.rules, endless=True)
    held = (rules.lag or 0) + 2 if rules.smooth else 1
    fixed = tuple(None if when in BY_TABLE else rows.fixed(k) for k, when in enumerate(rows.when))
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
    return Embedded(
        begun=begun, seen=seen, moving=moving, whens=rows.when, fixed=fixed, noises=tuple(noises), chain=chain
    )


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
