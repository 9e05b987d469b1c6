"""Kernels and tables → groups of equations: which rows, which numbers, with which weights."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mbm.expression.nodes import Column as ColumnNode
from mbm.expression.nodes import ColumnMember, Component, Member, RowChoice
from mbm.kernels.types import Backend, Evaluation, Kernel, KernelSet, Stream
from mbm.problem.checks import used_rows
from mbm.problem.rows import Positions, chosen_number, column_numbers, keyed_rows, rows_of
from mbm.problem.tables import Table
from mbm.problem.types import BlockRole, Loss, Problem, Static
from mbm.solution.layout import Layout
from mbm.solution.layouts import Layouts
from mbm.solution.members import picked_members
from mbm.solution.sampling import Sampled, sampled_inputs, samplings
from mbm.solution.scatter import Scatter, scatter
from mbm.solution.types import Floats, Indices, Mask
from mbm.solution.whitening import Whitener, whitener
from mbm.symbolic.types import ConstantInput, Parameter, Purpose, Slot
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.solution.robust.losses.function import LossFunction

DENSE_PART = 20_000_000
"""Numbers in a dense Jacobian of some rows that is made at once: 160 MB."""


MOST_PREPARED_ROWS = 1_000_000
"""Rows of all prepared kernels together; growing windows would prepare every size there is."""


Kind: TypeAlias = tuple[tuple[str, ...], tuple[int, ...]]
"""Names of the unknowns and numbers of rows of the kernels: what decides which closed forms are made for equations."""


class EvaluationCache:
    """Prepared kernels by number of rows, so that a stream of data sets of one size prepares them once.

    Local to one compiled problem in one thread; an evaluation is filled anew before each use. Sets of unknowns and
    numbers of rows for which no closed form is made are remembered too, and in ``native`` what native solves share.
    """

    def __init__(self, backend: Backend, without_closed_form: Iterable[Kind] = ()) -> None:
        self.backend = backend
        self.without_closed_form: set[Kind] = set(without_closed_form)
        self.layouts = Layouts()
        self.native: dict[str, object] = {}
        self._prepared: dict[tuple[int, int], Evaluation] = {}
        self._streams: dict[int, Stream] = {}

    def stream(self, number: int, kernel: Kernel) -> Stream:
        """Kernel ``number`` for any number of rows."""
        found = self._streams.get(number)
        if found is None:
            found = self._streams[number] = self.backend.stream(kernel)
        return found

    def evaluation(self, number: int, kernel: Kernel, rows: int) -> Evaluation:
        """The evaluation of kernel ``number`` for ``rows`` rows."""
        found = self._prepared.get((number, rows))
        if found is None:
            if sum(size for _, size in self._prepared) + rows > MOST_PREPARED_ROWS:
                self._prepared.clear()
            found = self.backend.prepare(kernel, rows)
            self._prepared[number, rows] = found
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Group:
    """A kernel bound to the rows it holds for.

    ``positions`` (from 0) in the block's table, None without one; ``index`` (rows, variables) gives for each input of
    unknowns its place in the vector of all numbers, ``columns`` (rows, tangents) for each tangent its place in that of
    all coordinates; ``shared[j]`` and ``shared_columns[j]`` say that variable or tangent j is the same in all rows.
    Residuals stand at ``first …`` in the vector of all, units (one equation in one row) at ``first_unit …``. ``number``
    is the kernel's in the set of all, ``cache`` keeps what was made of it.
    """

    kernel: Kernel
    evaluation: Evaluation
    positions: Positions | None
    index: Indices
    columns: Indices
    shared: tuple[bool, ...]
    shared_columns: tuple[bool, ...]
    parameters: Floats
    role: BlockRole = BlockRole.OBSERVATION
    whiteners: tuple[Whitener, ...] = ()
    losses: tuple[LossFunction, ...] = ()
    first: int = 0
    first_unit: int = 0
    number: int
    cache: EvaluationCache
    sampled: tuple[Sampled, ...] = ()

    @property
    def places(self) -> Indices:
        """``index`` with one row in place of equal ones."""
        return self.index[:1] if all(self.shared) else self.index

    @property
    def touched(self) -> Indices:
        """``columns`` with one row in place of equal ones."""
        return self.columns[:1] if all(self.shared_columns) else self.columns

    @property
    def units(self) -> Indices:
        """The unit of each scalar output, shape (rows, outputs)."""
        sizes = [w.last - w.first for w in self.whiteners]
        of_output = np.repeat(np.arange(len(sizes)), sizes)
        return self.first_unit + np.arange(self.rows)[:, None] * len(sizes) + of_output

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.index)

    @property
    def count(self) -> int:
        """Number of scalar outputs."""
        return self.rows * self.kernel.outputs

    def fill(self, numbers: Floats) -> None:
        """Put the vector of all numbers (N,) and the data into the inputs."""
        variables = self.index.shape[1]
        self.evaluation.inputs[:, :variables] = numbers[self.places]
        self.evaluation.inputs[:, variables:] = self.parameters
        for each in self.sampled:
            each.fill(self.evaluation.inputs[:, variables:], lambda places: numbers[places], np.arange(self.rows))

    def sampled_inside(self, numbers: Floats) -> Mask:
        """Which rows (rows,) are sampled within the spans of the tables."""
        rows = np.arange(self.rows)
        inside = [each.inside(lambda places: numbers[places], rows) for each in self.sampled]
        return np.asarray(np.logical_and.reduce(inside)) if inside else np.ones(self.rows, dtype=bool)

    def values(self, numbers: Floats) -> Floats:
        """Outputs (rows, outputs), not whitened."""
        self.fill(numbers)
        return self.evaluation.values()

    def whitened(self, values: Floats) -> Floats:
        """Outputs divided by their noise, shape (rows, outputs)."""
        if len(self.whiteners) == 1:
            return self.whiteners[0].apply(values)
        return np.hstack([w.apply(values) for w in self.whiteners])

    def scatter(self, columns: Indices) -> Scatter:
        """Where the Jacobian goes; ``columns`` (M,) gives the column of each coordinate, -1: nowhere."""
        kernel = self.kernel
        return scatter(kernel.jacobian_rows, kernel.jacobian_columns, self.columns, self.shared_columns, columns)

    def dense_jacobian(self, numbers: Floats, columns: Indices, width: int) -> Floats:
        """Jacobian, not whitened, shape (rows, outputs, width); ``columns`` (M,) places each coordinate, or -1."""
        result = np.zeros((self.rows, self.kernel.outputs, width))
        self.add_jacobian(numbers, self.scatter(columns), result)
        return result

    def dense_slopes(self, numbers: Floats, columns: Indices, width: int) -> Iterator[tuple[slice, Floats]]:
        """``dense_jacobian`` a part of the rows at a time: which ones, and theirs."""
        step = max(DENSE_PART // max(self.kernel.outputs * width, 1), 1)
        if step >= self.rows:
            yield slice(0, self.rows), self.dense_jacobian(numbers, columns, width)
            return
        self.fill(numbers)
        nonzeros = self.evaluation.values_and_jacobian()[1].copy()
        outputs, inputs = self.kernel.jacobian_rows, self.kernel.jacobian_columns
        for start in range(0, self.rows, step):
            rows = slice(start, min(start + step, self.rows))
            part = np.zeros((rows.stop - rows.start, self.kernel.outputs, width))
            scatter(outputs, inputs, self.columns[rows], self.shared_columns, columns).add(nonzeros[rows], part)
            yield rows, part

    def add_jacobian(self, numbers: Floats, places: Scatter, target: Floats) -> None:
        """Add the Jacobian, not whitened, to ``target`` (rows, outputs, width)."""
        self.fill(numbers)
        places.add(self.evaluation.values_and_jacobian()[1], target)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Binder:
    """Binds kernels to the tables of one solve."""

    problem: Problem
    layout: Layout
    tables: Mapping[str, Table]
    cache: EvaluationCache

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
            group = self.bind(number, kernel, table, positions)
            if group.sampled:
                inside = group.sampled_inside(self.layout.start)
                if positions is None and not inside.all():
                    continue
                positions = positions if positions is None else positions[inside]
                group = self.bind(number, kernel, table, positions)
            whiteners, offset, exact = [], 0, kernel.corrections is not None
            for equation in () if constraints else case.equations:
                whiteners.append(whitener(equation, offset, table, positions, self.tables, may_be_exact=exact))
                offset += len(equation.components)
            bound = replace(
                group,
                role=block.role,
                whiteners=tuple(whiteners),
                losses=() if block.loss is None else _losses(block.loss, whiteners),
                first=first,
                first_unit=first_unit,
            )
            groups.append(bound)
            first += group.count
            first_unit += group.rows * len(whiteners)
        return tuple(groups)

    def derived(self, kernels: KernelSet, owner: int) -> tuple[Group, ...]:
        """The kernels of one derived quantity, for all rows of its table."""
        groups = []
        for number, kernel in enumerate(kernels.kernels):
            if kernel.purpose is Purpose.DERIVED and kernel.owner == owner:
                derived = self.problem.derived[owner]
                table, positions = self._rows(derived.table, derived.cases[kernel.case].static, None)
                groups.append(self.bind(number, kernel, table, positions, extended=False))
        return tuple(groups)

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
        """A kernel for the rows at ``positions``; ``extended``: tables that are sampled go on beyond their ends."""
        rows = 1 if positions is None else len(positions)
        index = np.empty((rows, len(kernel.variables)), dtype=np.int64)
        columns = np.empty((rows, len(kernel.tangents)), dtype=np.int64)
        members: dict[tuple[str, Member], Indices | int] = {}
        for j, slot in enumerate(kernel.variables):
            entry = self.layout.entry(slot.unknown)
            member = self._member(slot, table, positions, members)
            index[:, j] = member * entry.unknown.size + (entry.offset + slot.component)
        for j, slot in enumerate(kernel.tangents):
            entry = self.layout.entry(slot.unknown)
            member = self._member(slot, table, positions, members)
            columns[:, j] = member * entry.unknown.freedom + (entry.first + slot.component)
        parameters = np.empty((rows, len(kernel.parameters)))
        for j, parameter in enumerate(kernel.parameters):
            parameters[:, j] = self._parameter(parameter, table, positions)
        sampled = self._sampled(kernel, table, positions, members, extended=extended)
        with np.errstate(all="ignore"):  # times are NaN where an unknown has no start
            for each in sampled:
                each.fill(parameters, lambda places: self.layout.start[places], np.arange(rows))
        evaluation = self.cache.evaluation(number, kernel, rows)
        return Group(
            kernel=kernel,
            evaluation=evaluation,
            positions=positions,
            index=index,
            columns=columns,
            shared=tuple(not _differs(slot) for slot in kernel.variables),
            shared_columns=tuple(not _differs(slot) for slot in kernel.tangents),
            parameters=parameters,
            number=number,
            cache=self.cache,
            sampled=sampled,
        )

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
        return tuple(
            sampled_inputs(kernel, sampling, given, places, extended=extended) for sampling in samplings(kernel)
        )

    def _parameter(self, parameter: Parameter, table: Table | None, positions: Positions | None) -> Floats | float:
        if isinstance(parameter, ConstantInput):
            return self._constants()[parameter.name]
        node = ColumnNode(parameter.table, parameter.name, parameter.row, member=parameter.member)
        if parameter.sampling is not None:
            return np.nan  # filled where the time is known
        if parameter.row is RowChoice.KEYED:
            rows = keyed_rows(node, table, positions, self.tables)
            return column_numbers(self.tables[parameter.table], parameter.name)[rows]
        if parameter.row is RowChoice.EACH and table is not None and parameter.table == table.name:
            return column_numbers(table, parameter.name)[positions]
        return chosen_number(node, self.tables)

    def _constants(self) -> Mapping[str, float]:
        values: dict[str, float] = {}
        for constant in self.problem.constants:
            values.update(zip(constant.elements, constant.values, strict=True))
        return values

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
            found = picked_members(entry, slot.member, table, positions, self.tables)
            members[slot.unknown, slot.member] = found
        return found


def _losses(asked: Loss, whiteners: Iterable[Whitener]) -> tuple[LossFunction, ...]:
    """The loss of a clause for each of its equations."""
    # Loaded by problems with a loss only, so that the others start at once.
    from mbm.solution.robust.losses.parameters import loss_function

    return tuple(loss_function(asked, each.last - each.first) for each in whiteners)


def _differs(slot: Slot) -> bool:
    """Whether the variable may be another member in each row."""
    return isinstance(slot.member, ColumnMember) and slot.member.row is RowChoice.EACH


def affine(group: Group, mask: Mask) -> bool:
    """Whether the outputs of a group are affine in the coordinates that ``mask`` (M,) picks."""
    if any(bool(mask[sampled.coordinates].any()) for sampled in group.sampled):
        return False
    touched = np.asarray(mask[group.touched].any(axis=0), dtype=bool)
    return group.kernel.affine_in(touched)


def mentioned(groups: tuple[Group, ...], size: int) -> Mask:
    """Which of all coordinates (M,) some equation in use depends on."""
    used = np.zeros(size, dtype=bool)
    for group in groups:
        # counted, as np.unique would load NumPy's masked arrays at every start
        columns = np.flatnonzero(np.bincount(group.kernel.jacobian_columns, minlength=len(group.kernel.tangents)))
        used[group.touched[:, columns].ravel()] = True
    return used
