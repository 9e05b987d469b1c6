"""Binds kernels to the tables of one solve: which rows, which unknowns and data go in, and with which weights."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.binding import EvaluationCache, Group, Slots, StatedNoise
from mbm.equations.gathering import (
    Gathered,
    MemberPicker,
    Sampled,
    aggregate_entry,
    picked_members,
    sampled_inputs,
    samplings,
)
from mbm.equations.layout import Entry, Layout
from mbm.equations.likelihoods import readings
from mbm.equations.types import Indices, Mask
from mbm.equations.whitening import Whitener, whitener
from mbm.expression.nodes import Column as ColumnNode, ColumnMember, Component, Member, leaves
from mbm.expression.rows import RowChoice
from mbm.kernels.types import Kernel, KernelSet
from mbm.problem.aggregates import is_aggregate
from mbm.problem.checks import used_rows
from mbm.problem.previous import has_before, mentions_before
from mbm.problem.rows import Positions, chosen_number, column_numbers, decided, keyed_rows, rows_of
from mbm.problem.tables import Table
from mbm.problem.types import BlockRole, EquationCase, Loss, Problem, RowValues, Static
from mbm.symbolic.types import ConstantInput, Parameter, Purpose, Slot
from mbm.values import dataclass, replace

if TYPE_CHECKING:
    from mbm.equations.losses import LossFunction
    from mbm.equations.types import Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Binder:
    """Binds kernels to the tables of one solve; ``pick`` says which members rows speak of."""

    problem: Problem
    layout: Layout
    tables: Mapping[str, Table]
    cache: EvaluationCache
    pick: MemberPicker = picked_members

    def equations(self, kernels: KernelSet) -> tuple[Group, ...]:
        """All observation and prior kernels with the rows in use."""
        return self._bound(kernels, constraints=False)

    def constraints(self, kernels: KernelSet) -> tuple[Group, ...]:
        """All constraint kernels with the rows in use."""
        return self._bound(kernels, constraints=True)

    def _bound(self, kernels: KernelSet, *, constraints: bool) -> tuple[Group, ...]:
        groups = []
        masks: dict[int, Mask | None] = {}
        first = first_unit = 0
        for number, kernel in enumerate(kernels.kernels):
            if kernel.purpose is not Purpose.EQUATION:
                continue
            block = self.problem.blocks[kernel.owner]
            if (block.role is BlockRole.CONSTRAINT) is not constraints:
                continue
            if kernel.owner not in masks:
                masks[kernel.owner] = used_rows(block, self.tables)
            case = block.cases[kernel.case]
            table, positions = self._rows(block.table, case.static, masks[kernel.owner])
            if samplings(kernel):
                inside = self.bind(number, kernel, table, positions).sampled_inside(self.layout.start)
                if positions is None and not inside.all():
                    continue
                positions = positions if positions is None else positions[inside]
            whiteners = () if constraints else self._whiteners(number, kernel, case, table, positions)
            group = replace(
                self.bind(number, kernel, table, positions),
                role=block.role,
                whiteners=whiteners,
                losses=() if block.loss is None else _losses(block.loss, whiteners),
                first=first,
                first_unit=first_unit,
                trusted=None
                if block.trust is None or positions is None
                else _decided(block.trust, self.tables, positions),
                readings=None if kernel.plain is None else readings(case, table, positions, self.tables),
                equations=case.equations,
            )
            groups.append(group)
            first += group.count
            first_unit += group.rows * len(whiteners)
        return tuple(groups)

    def _whiteners(
        self, number: int, kernel: Kernel, case: EquationCase, table: Table | None, positions: Positions | None
    ) -> tuple[Whitener, ...]:
        """What whitens each equation; where no data decide it, once for all data sets of a size."""
        found, offset = [], 0
        rows = 1 if positions is None else len(positions)
        for place, equation in enumerate(case.equations):
            if equation.likelihood is not None:
                size = len(equation.likelihood.residuals)
                found.append(Whitener(offset, offset + size, np.ones((rows, size))))
                offset += size
                continue
            known = self.cache.stated.get((number, place))
            if known is None or known.equation is not equation or len(known.whitener.weights) != rows:
                exact = kernel.corrections is not None
                singular = self.problem.blocks[kernel.owner].singular
                made = whitener(
                    equation, offset, table, positions, self.tables, may_be_exact=exact, may_be_singular=singular
                )
                known = StatedNoise(equation, made)
                if not any(isinstance(leaf, ColumnNode) for leaf in leaves(equation.noise)):
                    self.cache.stated[number, place] = known
            found.append(known.whitener)
            offset += len(equation.components)
        return tuple(found)

    def derived(self, kernels: KernelSet, owner: int) -> tuple[Group, ...]:
        """The kernels of one derived quantity, for all rows of its table."""
        derived = self.problem.derived[owner]
        statics = [case.static for case in derived.cases]
        return self._of_purpose(kernels, Purpose.DERIVED, owner, derived.table, statics)

    def _of_purpose(
        self, kernels: KernelSet, purpose: Purpose, owner: int, name: str | None, statics: Sequence[Static]
    ) -> tuple[Group, ...]:
        """The kernels of a derived quantity, or of the rows of an aggregate."""
        groups = []
        for number, kernel in enumerate(kernels.kernels):
            if kernel.purpose is purpose and kernel.owner == owner:
                mask = has_before(self.tables[name]) if name is not None and _looks_back(kernel) else None
                table, positions = self._rows(name, statics[kernel.case], mask)
                group = self.bind(number, kernel, table, positions, extended=False)
                groups.append(replace(group, gathered=self._gathered(kernels, kernel)))
        return tuple(groups)

    def _gathered(self, kernels: KernelSet, kernel: Kernel) -> Gathered | None:
        """The aggregates that a kernel takes, with their rows."""
        names = {slot.unknown for slot in kernel.variables}
        taken = [i for i, each in enumerate(self.problem.aggregates) if each.name in names]
        if not taken:
            return None
        found = [self.problem.aggregates[i] for i in taken]
        groups = [
            self._of_purpose(kernels, Purpose.AGGREGATE, i, each.table, [static for static, _ in each.cases])
            for i, each in zip(taken, found, strict=True)
        ]
        return Gathered(
            count=len(self.problem.aggregates), places=tuple(taken), aggregates=tuple(found), groups=tuple(groups)
        )

    def _rows(self, name: str | None, static: Static, mask: Mask | None) -> tuple[Table | None, Positions | None]:
        if name is None:
            return None, None
        table = self.tables[name]
        positions = rows_of(static, table)
        return table, positions if mask is None else positions[mask[positions]]

    def bind(
        self,
        number: int,
        kernel: Kernel,
        table: Table | None,
        positions: Positions | None,
        *,
        extended: bool = True,
    ) -> Group:
        """A kernel for the rows at ``positions``; ``extended``: tables that are sampled go on beyond their ends.

        What `Group` says beside, as noise and losses, is as it is by default.
        """
        rows = 1 if positions is None else len(positions)
        members: dict[tuple[str, Member], Indices | int] = {}
        slots = self._slots(number, kernel, table, positions, members)
        parameters = np.empty((rows, len(kernel.parameters)))
        for j, parameter in enumerate(kernel.parameters):
            parameters[:, j] = self._parameter(parameter, table, positions)
        sampled = self._sampled(kernel, table, positions, members, extended=extended)
        if sampled:
            with np.errstate(all="ignore"):  # times are NaN where an unknown has no start
                for each in sampled:
                    each.fill(parameters, lambda places: self.layout.start[places], np.arange(rows))
        return Group(
            kernel=kernel,
            evaluation=self.cache.evaluation(number, kernel, rows),
            positions=positions,
            index=slots.index if len(slots.index) == rows else slots.index.repeat(rows, axis=0),
            columns=slots.columns if len(slots.columns) == rows else slots.columns.repeat(rows, axis=0),
            shared=slots.shared,
            shared_columns=slots.shared_columns,
            parameters=parameters,
            number=number,
            cache=self.cache,
            sampled=sampled,
        )

    def _slots(
        self,
        number: int,
        kernel: Kernel,
        table: Table | None,
        positions: Positions | None,
        members: dict[tuple[str, Member], Indices | int],
    ) -> Slots:
        """Which numbers go in, row by row; in one row for all, once for all data sets, where rows pick no members."""
        known = self.cache.slots.get(number)
        if known is not None and known.layout is self.layout and known.kernel is kernel:
            return known
        plain = all(slot.member is None for slot in (*kernel.variables, *kernel.tangents))
        rows = 1 if positions is None or plain else len(positions)
        index = np.empty((rows, len(kernel.variables)), dtype=np.int64)
        columns = np.empty((rows, len(kernel.tangents)), dtype=np.int64)
        for j, slot in enumerate(kernel.variables):
            entry = self._entry(slot)
            member = self._member(slot, table, positions, members)
            index[:, j] = member * entry.unknown.size + (entry.offset + slot.component)
        for j, slot in enumerate(kernel.tangents):
            entry = self._entry(slot)
            member = self._member(slot, table, positions, members)
            columns[:, j] = member * entry.unknown.freedom + (entry.first + slot.component)
        found = Slots(
            layout=self.layout,
            kernel=kernel,
            index=index,
            columns=index if np.array_equal(index, columns) else columns,  # so it is where nothing is curved
            shared=tuple(not _differs(slot) for slot in kernel.variables),
            shared_columns=tuple(not _differs(slot) for slot in kernel.tangents),
        )
        if plain:
            self.cache.slots[number] = found
        return found

    def _entry(self, slot: Slot) -> Entry:
        """The place of an unknown, or of an aggregate."""
        if is_aggregate(slot.unknown):
            return aggregate_entry(self.problem, self.layout, slot.unknown)
        return self.layout.entry(slot.unknown)

    def _sampled(
        self,
        kernel: Kernel,
        table: Table | None,
        positions: Positions | None,
        members: dict[tuple[str, Member], Indices | int],
        *,
        extended: bool,
    ) -> tuple[Sampled, ...]:
        """What the kernel samples at times that may hold unknowns."""
        asked = samplings(kernel)
        if not asked:
            return ()
        rows = 1 if positions is None else len(positions)

        def places(leaf: Component) -> tuple[Indices, Indices]:
            entry = self.layout.entry(leaf.unknown)
            unknown = entry.unknown
            component = unknown.indices().index(leaf.index)
            member = self._member(Slot(leaf.unknown, component, leaf.member), table, positions, members)
            place = np.broadcast_to(entry.offset + member * unknown.size + component, (rows,))
            moving = np.unique(member)[:, None] * unknown.freedom + entry.first + np.arange(unknown.freedom)
            return np.asarray(place), moving.ravel()

        given = (table, positions, self.tables, self._constants())
        return tuple(sampled_inputs(kernel, sampling, given, places, extended=extended) for sampling in asked)

    def _parameter(self, parameter: Parameter, table: Table | None, positions: Positions | None) -> Floats | float:
        if isinstance(parameter, ConstantInput):
            return self._constants()[parameter.name]
        if parameter.sampling is not None:
            return np.nan  # filled where the time is known
        if parameter.row is RowChoice.EACH and table is not None and parameter.table == table.name:
            return column_numbers(table, parameter.name)[positions]
        node = ColumnNode(parameter.table, parameter.name, parameter.row, member=parameter.member)
        if parameter.row is RowChoice.KEYED:
            rows = keyed_rows(node, table, positions, self.tables)
            return column_numbers(self.tables[parameter.table], parameter.name)[rows]
        return chosen_number(node, self.tables)

    def _constants(self) -> Mapping[str, float]:
        """The numbers of all constants, by name."""
        if self.cache.constants is None or self.cache.constants[0] is not self.problem.constants:
            values: dict[str, float] = {}
            for constant in self.problem.constants:
                values.update(zip(constant.elements, constant.values, strict=True))
            self.cache.constants = (self.problem.constants, values)
        return self.cache.constants[1]

    def _member(
        self,
        slot: Slot,
        table: Table | None,
        positions: Positions | None,
        members: dict[tuple[str, Member], Indices | int],
    ) -> Indices | int:
        """Numbers (from 0) of the members of one slot, 0 without a family; ``members`` keeps what was found."""
        if slot.member is None:
            return 0
        found = members.get((slot.unknown, slot.member))
        if found is None:
            entry = self.layout.entry(slot.unknown)
            found = self.pick(entry, slot.member, table, positions, self.tables)
            members[slot.unknown, slot.member] = found
        return found


def _decided(condition: RowValues, tables: Mapping[str, Table], positions: Positions) -> Mask:
    """Where a condition holds, of the rows at ``positions``."""
    return np.asarray(decided(condition, tables)[positions, 0])


def _losses(asked: Loss, whiteners: Iterable[Whitener]) -> tuple[LossFunction, ...]:
    """The loss of a clause for each of its equations."""
    # Loaded by problems with a loss only, so that the others start at once.
    from mbm.equations.losses import loss_function

    return tuple(loss_function(asked, each.last - each.first) for each in whiteners)


def _looks_back(kernel: Kernel) -> bool:
    """Whether a kernel takes something of the row before."""
    names = [parameter.name for parameter in kernel.parameters]
    members = [slot.member.column for slot in kernel.variables if isinstance(slot.member, ColumnMember)]
    return mentions_before((*names, *members))


def _differs(slot: Slot) -> bool:
    """Whether the variable may be another member in each row."""
    return isinstance(slot.member, ColumnMember) and slot.member.row is RowChoice.EACH
