"""Room for the rows of some steps, or transitions, in native code: each step has the place of an older one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.types import Floats, Indices
from mbm.equations.whitening import Whitener
from mbm.estimation.sequences.local import WORTH_MACHINE_CODE, Local, local
from mbm.problem.kinds import ConstraintKind
from mbm.problem.types import Block, NoiseKind
from mbm.solver import description as of
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroupRows:
    """Rows of one group in the places of one step: R rows of parameters, weights, places of numbers and of coordinates.

    Coordinates (R, tangents) are those that vary, -1 for others.
    """

    parameters: Floats
    weights: Floats
    index: Indices
    columns: Indices

    def __len__(self) -> int:
        return len(self.parameters)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Room:
    """Equations with room for ``capacity`` (groups,) rows of each of ``held`` steps; ``parts`` are arrays of groups.

    Their first axis is that of ``held`` · capacity rows.
    """

    local: Local
    held: int
    capacity: Indices
    parts: tuple[GroupRows, ...]
    counted: list[Sequence[int]]
    """The rows of each group that each of the steps has."""

    def put(self, step: int, number: int, rows: GroupRows) -> None:
        """Let group ``number`` of a step have these rows."""
        first = self._first(step, number)
        last = first + len(rows)
        part = self.parts[number]
        part.parameters[first:last] = rows.parameters
        part.weights[first:last] = rows.weights
        part.index[first:last] = rows.index
        part.columns[first:last] = rows.columns

    def put_parameters(self, step: int, number: int, count: int, column: int, cells: Floats) -> None:
        """Let a parameter of the first rows of a group be these numbers (count,)."""
        first = self._first(step, number)
        self.parts[number].parameters[first : first + count, column] = cells

    def fill(self, number: int, row: GroupRows, varying: Sequence[int]) -> None:
        """Let all rows of a group, of all steps, be alike but for ``varying`` parameters."""
        part = self.parts[number]
        alike = np.setdiff1d(np.arange(row.parameters.shape[1]), varying)
        part.parameters[:, alike] = row.parameters[:, alike]
        part.weights[...] = row.weights
        part.index[...] = row.index
        part.columns[...] = row.columns

    def count(self, step: int, counts: Sequence[int]) -> None:
        """Let a step have so many rows of each group."""
        place = step % self.held
        if self.counted[place] == counts:
            return
        self.counted[place] = counts
        data = self.local.native.rows.data[place]
        data[of.DATA_HEAD + of.DataBlock.rows :: of.DATA_BLOCK] = counts
        groups = self.local.equations.groups
        data[of.DataSet.count] = sum(group.kernel.outputs * rows for group, rows in zip(groups, counts, strict=False))

    def larger(self, held: int, capacity: Indices, cache: EvaluationCache, blocks: Sequence[Block]) -> Room:
        """The same with room for more rows, or more steps behind those that are held, which has the rows of these."""
        made = room(self.local, held, capacity, cache, blocks)
        for number, (old, new) in enumerate(zip(self.parts, made.parts, strict=True)):
            for name in ("parameters", "weights", "index", "columns"):
                before, after = getattr(old, name), getattr(new, name)
                room_before, room_after = int(self.capacity[number]), int(capacity[number])
                kept = before.reshape(self.held, room_before, before.shape[1])
                after.reshape(held, room_after, after.shape[1])[: self.held, :room_before] = kept
        for step, counts in enumerate(self.counted):
            made.count(step, counts)
        return made

    def _first(self, step: int, number: int) -> int:
        return int(step % self.held * self.capacity[number])


def room(
    template: Local,
    held: int,
    capacity: Indices,
    cache: EvaluationCache,
    blocks: Sequence[Block],
    calls: int = WORTH_MACHINE_CODE,
) -> Room:
    """Room for so many rows of the equations ``template``, with none in it; ``blocks`` are those of the problem.

    ``calls`` of its kernels are to come.
    """
    equations = template.equations
    kinds = len(equations.groups)
    made: list[Group] = []
    done = [0, 0]
    for number, group in enumerate((*equations.groups, *equations.constraints)):
        if number == kinds:
            done = [0, 0]
        count = held * int(capacity[number])
        tiled = _tiled(group, count, blocks[group.kernel.owner])
        made.append(replace(tiled, first=done[0], first_unit=done[1]))
        done = [done[0] + tiled.count, done[1] + count * len(group.whiteners)]
    equal = [
        np.full(group.count, blocks[group.kernel.owner].constraint is ConstraintKind.EQUAL) for group in made[kinds:]
    ]
    whole = replace(
        equations,
        groups=tuple(made[:kinds]),
        constraints=tuple(made[kinds:]),
        equality=np.concatenate([np.zeros(0, dtype=bool), *equal]),
    )
    first = np.arange(held) * np.asarray(capacity)[:, None]
    found = local(whole, first, np.broadcast_to(np.asarray(capacity)[:, None], first.shape), cache, calls=calls)
    parts = _parts(found)
    empty = found.native.rows.data
    empty[:, of.DATA_HEAD + of.DataBlock.rows :: of.DATA_BLOCK] = 0
    empty[:, of.DataSet.count] = 0
    return Room(local=found, held=held, capacity=np.asarray(capacity), parts=parts, counted=[[0] * len(parts)] * held)


def _tiled(group: Group, count: int, block: Block) -> Group:
    """A group with so many rows, whose numbers are to come."""
    equations = block.cases[group.kernel.case].equations
    whiteners = tuple(
        Whitener(each.first, each.last, _pattern(each, count, equation.noise_kind))
        for each, equation in zip(group.whiteners, equations, strict=False)
    )
    return replace(
        group,
        index=np.zeros((count, group.index.shape[1]), dtype=np.int64),
        columns=np.zeros((count, group.columns.shape[1]), dtype=np.int64),
        shared=(False,) * len(group.shared),
        shared_columns=(False,) * len(group.shared_columns),
        parameters=np.zeros((count, group.parameters.shape[1])),
        positions=None,
        whiteners=whiteners,
        trusted=None,
    )


def _pattern(whitener: Whitener, count: int, kind: NoiseKind) -> Floats:
    """Weights of the shape that those to come have: factors, or triangles (of an information matrix the upper one)."""
    shape = whitener.weights.shape[1:]
    if len(shape) == 1:
        return np.ones((count, *shape))
    ones = np.triu(np.ones(shape)) if kind is NoiseKind.INFORMATION else np.tril(np.ones(shape))
    return np.broadcast_to(ones, (count, *shape)).copy()


def _parts(found: Local) -> tuple[GroupRows, ...]:
    """The arrays of each group in those of all."""
    rows = found.native.rows
    parts = []
    done = [0, 0, 0, 0]
    arrays = (rows.parameters, rows.weights, rows.index, rows.columns)
    for group in (*found.equations.groups, *found.equations.constraints):
        weights = sum(int(np.prod(each.weights.shape[1:])) for each in group.whiteners)
        widths = (group.parameters.shape[1], weights, group.index.shape[1], group.columns.shape[1])
        own: list[Any] = []
        for k, (array, width) in enumerate(zip(arrays, widths, strict=True)):
            own.append(array[done[k] : done[k] + group.rows * width].reshape(group.rows, width))
            done[k] += group.rows * width
        parts.append(GroupRows(parameters=own[0], weights=own[1], index=own[2], columns=own[3]))
    return tuple(parts)
