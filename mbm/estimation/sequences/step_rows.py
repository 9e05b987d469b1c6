"""The rows of a step that comes alone → what native code takes: as the whole problem would have bound them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.gathering import picked_members
from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices
from mbm.estimation.minimise.native.packing import weights_of
from mbm.estimation.native.code import native_code
from mbm.estimation.sequences import faults
from mbm.estimation.sequences.lowering import of_no_step, says_the_same
from mbm.estimation.sequences.noise import Spreads, spread_of
from mbm.estimation.sequences.places import NOT_OF_A_STEP
from mbm.estimation.sequences.room import GroupRows
from mbm.estimation.sequences.run import Begun
from mbm.expression.nodes import Column, ColumnMember, Member, leaves
from mbm.kernels.types import Kernel, KernelSet
from mbm.problem.checks import used_rows
from mbm.problem.rows import Positions
from mbm.problem.tables import Table
from mbm.problem.types import Block, BlockRole
from mbm.symbolic.types import ColumnInput
from mbm.text.types import MbmError
from mbm.values import dataclass

ALWAYS, ONCE, FIRST, BEGINNING = "always", "once", "first", "beginning"
"""When a group has rows: at every step as its table has them, one at the first of these, those that it was compiled
with at the first step, or at the first that is observed."""
BY_TABLE = (ALWAYS, ONCE)
"""When they come with the rows of a table."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plain:
    """A group of which rows differ by columns of numbers alone: parameter ``columns`` by place, and all others.

    ``row`` is one row with them.
    """

    columns: tuple[tuple[int, str], ...]
    row: GroupRows


class StepRows:
    """What binds the rows of steps. ``begun`` is the problem with the data that it was compiled with.

    Not to be shared between threads: it remembers rows that stay the same.
    """

    def __init__(self, begun: Begun, kernels: KernelSet, cache: EvaluationCache) -> None:
        self._begun, self._kernels, self._cache = begun, kernels, cache
        chained = begun.chained
        self.seen = (*chained.seen.equations.groups, *chained.seen.equations.constraints)
        self.moving = (*chained.moving.equations.groups, *chained.moving.equations.constraints)
        self._column, self._ahead = _columns(begun)
        blocks = begun.problem.blocks
        self.when = whens(begun)
        self.tables = tuple(blocks[group.kernel.owner].table or "" for group in self.seen)
        self.observed = tuple(blocks[group.kernel.owner].role is BlockRole.OBSERVATION for group in self.seen)
        self.numbers_of_transitions = _numbers_of(begun, self.moving)
        """Columns of transitions of which another number changes nothing but parameters of equations."""
        self._plain: dict[int, Plain | None] = {
            number: None for number, group in enumerate(self.seen) if self._may_be_plain(number, group)
        }

    def fixed(self, number: int) -> GroupRows:
        """The rows of a group that belong to no step, as they were compiled."""
        group = self.seen[number]
        return self._native(group, group.index, group.columns)

    def plain(self, number: int) -> Plain | None:
        """What is left to do for the rows of a group; None where they are to be bound."""
        return self._plain.get(number)

    def bound(self, tables: Mapping[str, Table]) -> dict[int, GroupRows]:
        """The rows of all groups that have some at every step, for the tables of one step.

        Raises:
            MbmError: a member or a row that is none, noise that is none, a cell without a value that decides.

        """
        groups = self._groups(tables)
        found = {}
        lost = self._lost(groups, tables)
        if lost is not None:
            raise MbmError(faults.other_equations(lost.span, lost.name))
        for number, group in enumerate(self.seen):
            if self.when[number] in BY_TABLE:
                own = groups[group.number]
                places = self._begun.places
                rows = self._native(own, places.number[own.index], places.coordinate[own.columns])
                found[number] = rows
                if number in self._plain and len(rows) and self._plain[number] is None:
                    self._plain[number] = Plain(columns=_inputs(group.kernel), row=first_row(rows))
        return found

    def moved(self, tables: Mapping[str, Table]) -> tuple[dict[int, GroupRows], Floats]:
        """Those of the transition to a step, and L (p, p) of its noise, filled up by columns of zeros.

        Raises:
            MbmError: likewise.

        """
        groups = self._groups(tables)
        places = self._begun.places
        size = len(places.free) - places.still
        spreads = Spreads(steps=1, rows=size)
        found = {}
        for number, group in enumerate(self.moving):
            own = groups[group.number]
            index = self._reaching(own.kernel, places.number[own.index], own.index, places.step_of_number, 0)
            columns = self._reaching(
                own.kernel, places.coordinate[own.columns], own.columns, places.step_of_coordinate, 1
            )
            block = self._begun.problem.blocks[group.kernel.owner]
            stated = block.cases[group.kernel.case].equations
            counts = np.array([own.rows])
            code = native_code(self._cache).filters
            spreads.add(spread_of(stated, block.table, own.positions, tables, code), counts - counts, counts)
            ones = tuple(replace(w, weights=np.ones((own.rows, own.kernel.outputs))) for w in group.whiteners)
            found[number] = self._native(replace(own, whiteners=ones), index, columns)
        matrix = spreads.matrices()[0]
        return found, np.pad(matrix, ((0, 0), (0, size - matrix.shape[1])))

    def renumbered(self, rows: Mapping[int, GroupRows], numbers: Mapping[str, float]) -> dict[int, GroupRows]:
        """The rows of a transition with other numbers in columns."""
        found = {}
        for number, group in enumerate(self.moving):
            parameters = rows[number].parameters.copy()
            for column, name in _inputs(group.kernel):
                parameters[:, column] = numbers[name]
            found[number] = replace(rows[number], parameters=parameters)
        return found

    def _groups(self, tables: Mapping[str, Table]) -> dict[int, Group]:
        begun = self._begun
        binder = Binder(
            problem=begun.problem, layout=begun.equations.layout, tables=tables, cache=self._cache, pick=_member
        )
        return {group.number: group for group in (*binder.equations(self._kernels), *binder.constraints(self._kernels))}

    def _lost(self, groups: Mapping[int, Group], tables: Mapping[str, Table]) -> Block | None:
        """A block that has rows of a kind for which there is no equation."""
        counts: dict[int, int] = {}
        for number, group in enumerate(self.seen):
            if self.when[number] in BY_TABLE:
                owner = group.kernel.owner
                counts[owner] = counts.get(owner, 0) + groups[group.number].rows
        for owner, count in counts.items():
            used = used_rows(self._begun.problem.blocks[owner], tables)
            if used is not None and int(used.sum()) != count:
                return self._begun.problem.blocks[owner]
        return None

    def _native(self, group: Group, index: Indices, columns: Indices) -> GroupRows:
        """Rows at places of a step, or of a transition."""
        weights = weights_of(group, None, None) if group.whiteners else np.zeros((group.rows, 0))
        return GroupRows(parameters=group.parameters, weights=weights, index=index, columns=self._column[columns])

    def _reaching(self, kernel: Kernel, found: Indices, whole: Indices, step_of: Indices, kind: int) -> Indices:
        """Places of a transition: states of the step reached stand behind the others."""
        slots = kernel.tangents if kind else kernel.variables
        key = self._begun.sequence.column
        reached = np.array([isinstance(s.member, ColumnMember) and s.member.column == key for s in slots], dtype=bool)
        return np.asarray(found + np.where(reached & (step_of[whole] != NOT_OF_A_STEP), self._ahead[kind], 0))

    def _may_be_plain(self, number: int, group: Group) -> bool:
        """Whether rows pick nothing but their step, all of them count, and noise is the same for all."""
        block = self._begun.problem.blocks[group.kernel.owner]
        case = block.cases[group.kernel.case]
        names = self._begun.sequence.names
        slots = (*group.kernel.variables, *group.kernel.tangents)
        return (
            self.when[number] == ALWAYS
            and not (block.when or block.distinct or block.trust or case.static or len(block.cases) > 1)
            and all(slot.member is None or slot.unknown in names for slot in slots)
            and all(not isinstance(p, ColumnInput) or p.table == block.table for p in group.kernel.parameters)
            and not any(isinstance(leaf, Column) for e in case.equations for leaf in leaves(e.noise))
        )


def _numbers_of(begun: Begun, moving: tuple[Group, ...]) -> frozenset[str]:
    """The columns that the equations of transitions take as they are, and that neither noise nor cases depend on."""
    blocks, reached = begun.problem.blocks, begun.sequence.reached
    found: set[str] = set()
    deciding: set[str] = set()
    for group in moving:
        block = blocks[group.kernel.owner]
        inputs = [each for each in group.kernel.parameters if isinstance(each, ColumnInput)]
        if len(block.cases) > 1 or block.cases[0].static or any(each.table != reached for each in inputs):
            return frozenset()
        found.update(each.name for each in inputs)
        noises = (leaf for each in block.cases[0].equations for leaf in leaves(each.noise))
        deciding.update(leaf.name for leaf in noises if isinstance(leaf, Column))
    return frozenset(found - deciding)


def _member(
    entry: Entry,
    member: Member,
    table: Table | None,
    positions: Positions | None,
    tables: Mapping[str, Table],
) -> Indices | int:
    """The members of a family; of states the first stands for that of any step."""
    if not entry.unknown.is_state:
        return picked_members(entry, member, table, positions, tables)
    return 0 if positions is None else np.zeros(len(positions), dtype=np.int64)


def _columns(begun: Begun) -> tuple[Indices, tuple[int, int]]:
    """What varies, of the coordinates of a transition, of which a step's are the first; and by how many numbers and
    coordinates those of the step reached stand behind those before.
    """
    places, equations = begun.places, begun.chained.moving.equations
    column = equations.columns
    numbers = len(places.numbers[0]) - places.still_numbers
    return column, (numbers, len(places.coordinates[0]) - places.still_coordinates)


def whens(begun: Begun) -> tuple[str, ...]:
    """When each group of the rows of a step has some: `ALWAYS`, `FIRST` or `BEGINNING`."""
    equations, blocks = begun.chained.seen.equations, begun.problem.blocks
    groups = (*equations.groups, *equations.constraints)
    return tuple(_when(group, blocks[group.kernel.owner], begun) for group in groups)


def _when(group: Group, block: Block, begun: Begun) -> str:
    tables, sequence, places = begun.tables, begun.sequence, begun.places
    if block.role is BlockRole.CONSTRAINT:
        whole = next(g for g in begun.equations.constraints if g.number == group.number)
        if of_no_step(whole, block, places, sequence, tables):
            return BEGINNING
        if says_the_same(whole, block, begun.equations.layout, sequence):
            return BEGINNING if block.table in (None, sequence.steps) else ONCE
    stepped = block.table is not None and sequence.column in tables[block.table].columns
    return ALWAYS if stepped else FIRST


def _inputs(kernel: Kernel) -> tuple[tuple[int, str], ...]:
    return tuple((j, p.name) for j, p in enumerate(kernel.parameters) if isinstance(p, ColumnInput))


def first_row(rows: GroupRows) -> GroupRows:
    """The first of some rows alone."""
    return GroupRows(
        parameters=rows.parameters[:1].copy(),
        weights=rows.weights[:1].copy(),
        index=rows.index[:1].copy(),
        columns=rows.columns[:1].copy(),
    )
