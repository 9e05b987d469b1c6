"""Kernels and tables → one least squares problem: which rows, which numbers, with which weights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mbm.expression.nodes import Column as ColumnNode
from mbm.expression.nodes import ColumnMember, LiteralMember, Member, RowChoice
from mbm.kernels.types import Backend, Evaluation, Kernel, KernelSet
from mbm.problem import faults as problem_faults
from mbm.problem.checks import used_rows
from mbm.problem.rows import Positions, chosen_number, column_numbers, rows_of
from mbm.problem.scopes import ROW
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem, Static
from mbm.solution.layout import Entry, Layout
from mbm.solution.scatter import Scatter, scatter
from mbm.solution.types import Floats, Indices, Mask
from mbm.solution.whitening import Whitener, whitener
from mbm.symbolic.types import ConstantInput, Parameter, Purpose, Slot
from mbm.text.types import MbmError


class EvaluationCache:
    """Prepared kernels by number of rows, so that a stream of data sets of one size prepares them once.

    Local to one compiled problem in one thread; an evaluation is filled anew before each use.
    """

    def __init__(self, backend: Backend) -> None:
        self.backend = backend
        self._prepared: dict[tuple[int, int], Evaluation] = {}

    def evaluation(self, number: int, kernel: Kernel, rows: int) -> Evaluation:
        """The evaluation of kernel ``number`` for ``rows`` rows."""
        found = self._prepared.get((number, rows))
        if found is None:
            found = self.backend.prepare(kernel, rows)
            self._prepared[number, rows] = found
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Group:
    """A kernel bound to the rows it holds for.

    ``positions`` (from 0) in the block's table, None without one; ``index`` (rows, variables) gives for each input of
    unknowns its place in the vector of all numbers; ``shared[j]`` says that variable j is the same in all rows.
    """

    kernel: Kernel
    evaluation: Evaluation
    positions: Positions | None
    index: Indices
    shared: tuple[bool, ...]
    parameters: Floats
    whiteners: tuple[Whitener, ...] = ()
    first: int = 0

    @property
    def places(self) -> Indices:
        """``index`` with one row in place of equal ones."""
        return self.index[:1] if all(self.shared) else self.index

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
        """Where the Jacobian goes; ``columns`` (N,) gives the column of each number, -1: nowhere."""
        kernel = self.kernel
        return scatter(kernel.jacobian_rows, kernel.jacobian_columns, self.index, self.shared, columns)

    def dense_jacobian(self, numbers: Floats, columns: Indices, width: int) -> Floats:
        """Jacobian, not whitened, shape (rows, outputs, width); ``columns`` (N,) places each number, -1: nowhere."""
        result = np.zeros((self.rows, self.kernel.outputs, width))
        self.add_jacobian(numbers, self.scatter(columns), result)
        return result

    def add_jacobian(self, numbers: Floats, places: Scatter, target: Floats) -> None:
        """Add the Jacobian, not whitened, to ``target`` (rows, outputs, width)."""
        self.fill(numbers)
        places.add(self.evaluation.values_and_jacobian()[1], target)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Assembled:
    """The equations of one solve, as the solvers see them (protocol ``Equations``), over the free numbers.

    ``numbers`` is the vector of all numbers with the fixed ones in place; ``free`` the positions of the estimated ones.
    ``factors`` (m,) multiplies σ row by row: the noise factors of unknown groups.
    """

    layout: Layout
    groups: tuple[Group, ...]
    numbers: Floats
    free: Indices
    factors: Floats | None = None
    linear: bool = False
    _scatters: tuple[Scatter, ...] = ()

    @property
    def dimension(self) -> int:
        """Free numbers."""
        return len(self.free)

    @property
    def count(self) -> int:
        """Scalar residuals."""
        return self.groups[-1].first + self.groups[-1].count if self.groups else 0

    @property
    def lower(self) -> Floats:
        """Hard lower bounds."""
        return self.layout.lower[self.free]

    @property
    def upper(self) -> Floats:
        """Hard upper bounds."""
        return self.layout.upper[self.free]

    @property
    def positive(self) -> Mask:
        """Numbers that stay above zero."""
        return self.layout.positive[self.free]

    def all_numbers(self, x: Floats) -> Floats:
        """The vector of all numbers at the free ones ``x``."""
        numbers = self.numbers.copy()
        numbers[self.free] = x
        return numbers

    def residuals(self, x: Floats) -> Floats:
        """Whitened residuals (m,)."""
        numbers = self.all_numbers(x)
        result = np.empty(self.count)
        for group in self.groups:
            result[group.first : group.first + group.count] = group.whitened(group.values(numbers)).ravel()
        return result if self.factors is None else result / self.factors

    def jacobian(self, x: Floats) -> Floats:
        """Whitened Jacobian (m, n)."""
        numbers = self.all_numbers(x)
        width = self.dimension
        result = np.zeros((self.count, width))
        for group, places in zip(self.groups, self._scatters, strict=True):
            lines = result[group.first : group.first + group.count]
            part = lines.reshape(group.rows, group.kernel.outputs, width)
            group.add_jacobian(numbers, places, part)
            for whitener_ in group.whiteners:
                rows = part[:, whitener_.first : whitener_.last]
                if whitener_.weights.ndim == 2:
                    rows *= whitener_.weights[:, :, None]
                else:
                    rows[...] = np.einsum("rij,rjn->rin", whitener_.weights, rows)
        return result if self.factors is None else result / self.factors[:, None]

    def retract(self, x: Floats, step: Floats) -> Floats:
        """x + step: every unknown so far is a number."""
        return x + step

    def with_factors(self, factors: Floats | None) -> Assembled:
        """The same equations with other noise factors."""
        return replace(self, factors=factors)

    def freed(self, free: Indices, numbers: Floats) -> Assembled:
        """The same equations over another set of free numbers."""
        columns = np.full(len(numbers), -1, dtype=np.int64)
        columns[free] = np.arange(len(free))
        linear = all(affine(group, columns >= 0) for group in self.groups)
        scatters = tuple(group.scatter(columns) for group in self.groups)
        return replace(self, free=free, numbers=numbers, linear=linear, _scatters=scatters)


def affine(group: Group, mask: Mask) -> bool:
    """Whether the outputs of a group are affine in the numbers that ``mask`` (N,) picks."""
    touched = np.asarray(mask[group.places].any(axis=0), dtype=bool)
    return group.kernel.affine_in(touched)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Binder:
    """Binds kernels to the tables of one solve."""

    problem: Problem
    layout: Layout
    tables: Mapping[str, Table]
    cache: EvaluationCache

    def equations(self, kernels: KernelSet) -> tuple[Group, ...]:
        """All observation and prior kernels with the rows in use."""
        groups = []
        masks = [used_rows(b, self.tables) for b in self.problem.blocks]
        first = 0
        for number, kernel in enumerate(kernels.kernels):
            if kernel.purpose is not Purpose.EQUATION:
                continue
            block = self.problem.blocks[kernel.owner]
            case = block.cases[kernel.case]
            table, positions = self._rows(block.table, case.static, masks[kernel.owner])
            group = self.bind(number, kernel, table, positions)
            whiteners, offset = [], 0
            for equation in case.equations:
                whiteners.append(whitener(equation, offset, table, positions, self.tables))
                offset += len(equation.components)
            groups.append(replace(group, whiteners=tuple(whiteners), first=first))
            first += group.count
        return tuple(groups)

    def derived(self, kernels: KernelSet, owner: int) -> tuple[Group, ...]:
        """The kernels of one derived quantity, for all rows of its table."""
        groups = []
        for number, kernel in enumerate(kernels.kernels):
            if kernel.purpose is Purpose.DERIVED and kernel.owner == owner:
                derived = self.problem.derived[owner]
                table, positions = self._rows(derived.table, derived.cases[kernel.case].static, None)
                groups.append(self.bind(number, kernel, table, positions))
        return tuple(groups)

    def _rows(self, name: str | None, static: Static, mask: Mask | None) -> tuple[Table | None, Positions | None]:
        if name is None:
            return None, None
        table = self.tables[name]
        positions = rows_of(static, table)
        return table, positions if mask is None else positions[mask[positions]]

    def bind(self, number: int, kernel: Kernel, table: Table | None, positions: Positions | None) -> Group:
        """A kernel for the rows at ``positions``."""
        rows = 1 if positions is None else len(positions)
        index = np.empty((rows, len(kernel.variables)), dtype=np.int64)
        members: dict[tuple[str, Member], Indices | int] = {}
        for j, slot in enumerate(kernel.variables):
            index[:, j] = self._places(slot, table, positions, members)
        shared = tuple(not _differs(slot) for slot in kernel.variables)
        parameters = np.empty((rows, len(kernel.parameters)))
        for j, parameter in enumerate(kernel.parameters):
            parameters[:, j] = self._parameter(parameter, table, positions)
        evaluation = self.cache.evaluation(number, kernel, rows)
        return Group(
            kernel=kernel,
            evaluation=evaluation,
            positions=positions,
            index=index,
            shared=shared,
            parameters=parameters,
        )

    def _parameter(self, parameter: Parameter, table: Table | None, positions: Positions | None) -> Floats | float:
        if isinstance(parameter, ConstantInput):
            return self._constants()[parameter.name]
        if parameter.row is RowChoice.EACH and table is not None and parameter.table == table.name:
            return column_numbers(table, parameter.name)[positions]
        return chosen_number(ColumnNode(parameter.table, parameter.name, parameter.row), self.tables)

    def _constants(self) -> Mapping[str, float]:
        values: dict[str, float] = {}
        for constant in self.problem.constants:
            values.update(zip(constant.elements, constant.values, strict=True))
        return values

    def _places(
        self,
        slot: Slot,
        table: Table | None,
        positions: Positions | None,
        members: dict[tuple[str, Member], Indices | int],
    ) -> Indices | int:
        """Places of one variable; ``members`` keeps what was found for the other components of the same member."""
        entry = self.layout.entry(slot.unknown)
        if slot.member is None:
            return entry.offset + slot.component
        found = members.get((slot.unknown, slot.member))
        if found is None:
            found = members[slot.unknown, slot.member] = self._members(entry, slot.member, table, positions)
        return entry.offset + found * entry.unknown.size + slot.component

    def _members(self, entry: Entry, member: Member, table: Table | None, positions: Positions | None) -> Indices | int:
        """Numbers (from 0) of the members that ``member`` names, for each row."""
        where = f"the family `{entry.unknown.name}`"
        if isinstance(member, LiteralMember):
            literal = entry.index.get(member.key)
            if literal is None:
                raise MbmError(problem_faults.dangling_key(entry.unknown.span, member.key, where, None, None))
            return literal
        cells = self._cells(member, table, positions)
        found = np.array([entry.index.get(cell, -1) for cell in cells], dtype=np.int64)
        if bool((found < 0).any()):
            row = int(np.argmax(found < 0))
            if table is None or positions is None or member.row is not RowChoice.EACH:
                raise MbmError(problem_faults.dangling_key(entry.unknown.span, cells[row], where, None, None))
            place = table.place(int(positions[row]), member.column)
            raise MbmError(problem_faults.dangling_key(place, cells[row], where, None, entry.unknown.span))
        return found

    def _cells(self, member: ColumnMember, table: Table | None, positions: Positions | None) -> list[CellKey]:
        if member.row is RowChoice.EACH and table is not None and positions is not None:
            if member.column == ROW and ROW not in table.columns:
                return [float(r) for r in table.rows[positions]]
            keys = table.keys(member.column)
            return [keys[i] for i in positions]
        if member.row is RowChoice.EACH:
            message = f"a key of `{member.table}.{member.column}` is wanted where there is no row"
            raise TypeError(message)
        other = self.tables[member.table]
        keys = other.keys(member.column)
        return [keys[0 if member.row is RowChoice.FIRST else -1]]


def _differs(slot: Slot) -> bool:
    """Whether the variable may be another member in each row."""
    return isinstance(slot.member, ColumnMember) and slot.member.row is RowChoice.EACH


def block_rows(groups: tuple[Group, ...], number: int) -> Indices:
    """Positions in the residual vector of the rows of block ``number``."""
    parts = [np.arange(g.first, g.first + g.count) for g in groups if g.kernel.owner == number]
    return np.concatenate(parts) if parts else np.empty(0, dtype=np.int64)


def mentioned(groups: tuple[Group, ...], size: int) -> Mask:
    """Which of all numbers (N,) some equation in use depends on."""
    used = np.zeros(size, dtype=bool)
    for group in groups:
        columns = np.unique(group.kernel.jacobian_columns)
        used[group.places[:, columns].ravel()] = True
    return used
