"""Columns that a stream of data sets may replace: those that stand in equations as numbers and decide nothing else."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from mbm.api import faults
from mbm.equations.binding import Group
from mbm.equations.types import Floats, Indices
from mbm.expression.nodes import Column, ColumnMember, Component, Expression, leaves
from mbm.expression.rows import RowChoice
from mbm.problem.previous import column_before
from mbm.problem.tables import Table
from mbm.problem.types import Block, Problem, RowValues
from mbm.scales import SI, Scale
from mbm.symbolic.types import ColumnInput
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass

Name = tuple[str, str]
"""A table and a column of it."""

_NAMES, _JOINS = "the names of rows", "which row is joined"
_NAMING = (_NAMES, _JOINS)
"""What decides nothing more where inputs give all values that equations use."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Varied:
    """A column whose cells are given anew for each data set.

    ``rows`` is the length of the table. The cell at ``positions[i]``, in SI by the ``scale`` of the data clause, is
    number ``cells[i]`` of the parameters of a data set: those of its groups one after the other, each row by row.
    Either is a slice where its places are evenly spaced.
    """

    table: str
    name: str
    rows: int
    scale: Scale
    positions: Indices | slice
    cells: Indices | slice

    def enter(self, given: Floats, parameters: Floats) -> None:
        """Put columns (…, rows) into the parameters (…, P)."""
        chosen = given[..., self.positions]
        parameters[..., self.cells] = self.scale.to_si(chosen)

    def entry(self, parameters: Floats) -> Callable[[Floats], None]:
        """What puts columns (rows,) into these very parameters (P,): `enter` in a third of the time."""
        every = isinstance(self.positions, slice) and self.positions == slice(0, self.rows, 1)
        if not every or not isinstance(self.cells, slice) or not self.scale.is_si:
            return lambda given: self.enter(given, parameters)
        target = parameters[self.cells]

        def entered(given: Floats) -> None:
            target[...] = given

        return entered


def varied(
    problem: Problem, tables: Mapping[str, Table], groups: tuple[Group, ...], names: tuple[str, ...]
) -> tuple[Varied, ...]:
    """The columns called ``names`` (``column`` or ``table.column``); without any, all measured ones.

    Raises:
        MbmError: no equation uses such a column, several tables have one, it decides more than a value, or is repeated.

    """
    used = _used(groups)
    if not names:
        measured = _measured(problem)
        names = tuple(f"{table}.{column}" for table, column in used if (table, column) in measured)
    deciding = _deciding(problem, groups)
    found: list[Varied] = []
    wrong: list[Diagnostic] = []
    for name in names:
        known = dict.fromkeys((*used, *deciding))
        meant = [each for each in known if name in (each[1], ".".join(each))]
        if len(meant) != 1:
            wrong.append(faults.no_such_input(name, tuple(f"{t}.{c}" for t, c in meant or used), several=bool(meant)))
        elif meant[0] in deciding:
            wrong.append(faults.deciding_input(".".join(meant[0]), deciding[meant[0]]))
        elif any((each.table, each.name) == meant[0] for each in found):
            wrong.append(faults.repeated_input(".".join(meant[0])))
        else:
            found.append(_placed(problem, tables, groups, meant[0]))
    if wrong:
        raise MbmError(*wrong)
    return tuple(found)


def held_tables(problem: Problem, groups: tuple[Group, ...], inputs: tuple[Varied, ...]) -> dict[str, str]:
    """The tables of which data sets have the rows that were compiled, no others, with what to do about it in words.

    Of the other tables inputs give all that equations ask of a row: they may have any number of rows.
    """
    found: dict[str, str] = {}
    for (table, column), what in (*_of_tables(problem), *_of_options(problem), *_of_inputs(groups)):
        if what not in _NAMING:
            found.setdefault(table, faults.held_by(table, column, what))
    for unknown in problem.unknowns:
        if unknown.family is not None:
            found.setdefault(
                unknown.family.table, faults.held_by(unknown.family.table, None, "the members of a family")
            )
    given = {(each.table, each.name) for each in inputs}
    lacking: dict[str, list[str]] = {}
    for table, column in _used(groups):
        if (table, column) not in given:
            lacking.setdefault(table, []).append(column)
    return {table: faults.lacking_inputs(table, tuple(columns)) for table, columns in lacking.items()} | found


def _used(groups: tuple[Group, ...]) -> tuple[Name, ...]:
    """All columns that are inputs of some equation, in the order in which they are met."""
    inputs = (p for group in groups for p in group.kernel.parameters if isinstance(p, ColumnInput))
    return tuple(dict.fromkeys((p.table, p.name) for p in inputs))


def _measured(problem: Problem) -> set[Name]:
    """Columns on the measured side of an equation, and those of its rows that have errors of their own."""
    uncertain = {(e.table, e.column) for block in problem.blocks for e in block.errors if e.key is None}
    return uncertain | {
        (block.table, column)
        for block in problem.blocks
        if block.table is not None
        for case in block.cases
        for equation in case.equations
        for column in equation.measured_columns
    }


def _placed(problem: Problem, tables: Mapping[str, Table], groups: tuple[Group, ...], name: Name) -> Varied:
    """Where the cells of a column stand among the parameters."""
    positions, cells = [], []
    first = 0
    for group in groups:
        rows, width = group.parameters.shape
        for j, parameter in enumerate(group.kernel.parameters):
            if isinstance(parameter, ColumnInput) and (parameter.table, parameter.name) == name:
                if group.positions is None:
                    raise TypeError(name)
                positions.append(group.positions)
                cells.append(first + width * np.arange(rows) + j)
        first += rows * width
    table, column = name
    return Varied(
        table=table,
        name=column,
        rows=len(tables[table]),
        scale=_scale(problem, table, column),
        positions=_spaced(np.concatenate(positions)),
        cells=_spaced(np.concatenate(cells)),
    )


def _spaced(places: Indices) -> Indices | slice:
    """The places as a slice if they are evenly spaced: that is entered in a tenth of the time."""
    steps = np.diff(places)
    if not len(places) or (steps != steps[:1]).any() or (len(steps) and steps[0] <= 0):
        return places
    step = int(steps[0]) if len(steps) else 1
    return slice(int(places[0]), int(places[-1]) + 1, step)


def _scale(problem: Problem, table: str, column: str) -> Scale:
    """The scale in which the data clause wants the column; columns of pairs and joins follow those they came from."""
    for pair in problem.pairs:
        if pair.name == table:
            alias, _, column = column.partition(".")
            return _scale(problem, dict(pair.sides)[alias], column)
    plan = next((p for p in problem.plans if p.name == table), None)
    if plan is None:
        return SI
    for declared in plan.declaration.columns:
        if declared.name == column:
            return declared.scale
    for join in plan.joins:
        if column.startswith(f"{join.alias}."):
            return _scale(problem, join.table, column.removeprefix(f"{join.alias}."))
    return SI


def _deciding(problem: Problem, groups: tuple[Group, ...]) -> dict[Name, str]:
    """Columns that decide more than the value of an equation in their own row, and what they decide."""
    found: dict[Name, str] = {}
    for name, what in (*_of_tables(problem), *_of_options(problem), *_of_inputs(groups)):
        found.setdefault(name, what)
    return found


def _of_tables(problem: Problem) -> Iterator[tuple[Name, str]]:
    """Keys, joins, pairs, families, filters."""
    for plan in problem.plans:
        if plan.declaration.key is not None:
            yield (plan.name, plan.declaration.key), _NAMES
        for join in plan.joins:
            yield (plan.name, join.column), _JOINS
        yield from _columns(plan.where, "which rows there are")
    for pair in problem.pairs:
        for alias, table in pair.sides:
            for deciding in pair.deciding:
                yield (table, deciding), "which rows are paired"
                yield (pair.name, f"{alias}.{deciding}"), "which rows are paired"
    for unknown in problem.unknowns:
        family = unknown.family
        if family is not None:
            for table, column in family.sources or ((family.table, family.column), (family.table, family.key)):
                if column is not None:
                    yield (table, column), "the members of a family"


def _of_options(problem: Problem) -> Iterator[tuple[Name, str]]:
    """Noise, starts and bounds, the kinds of equations."""
    for unknown in problem.unknowns:
        for values in (unknown.start, unknown.at, unknown.start_lower, unknown.start_upper):
            yield from _columns(values, "the start")
        for values in (unknown.lower, unknown.upper, unknown.fixed):
            yield from _columns(values, "what an unknown may be")
    for block in problem.blocks:
        yield from _columns(block.when, "which rows count")
        yield from _columns(block.trust, "which rows are trusted")
        yield from _of_block(block)


def _of_block(block: Block) -> Iterator[tuple[Name, str]]:
    table = block.table or ""
    for column in block.distinct:
        yield (table, column), "which rows count"
    for error in block.errors:
        if error.key is not None:
            yield (table, error.name), "a correction"
            yield (error.table, error.column), "a correction"
        yield from _columns(error.sigma, "the noise")
    yield from (((table, column), "the noise") for column in block.structure.per)
    for form in block.shared:
        yield from _columns(form, "the noise")
    for case in block.cases:
        for column, _ in case.static:
            yield (table, column), "what the equation is"
        for equation in case.equations:
            yield from _of_expressions(equation.noise, "the noise")


def _of_inputs(groups: tuple[Group, ...]) -> Iterator[tuple[Name, str]]:
    """What is read from another row than the one at hand, and what names that row or the member of a family."""
    for group in groups:
        kernel = group.kernel
        for slot in (*kernel.variables, *kernel.tangents):
            if isinstance(slot.member, ColumnMember):
                yield (slot.member.table, slot.member.column), "the member of a family"
        for parameter in kernel.parameters:
            if not isinstance(parameter, ColumnInput):
                continue
            earlier = column_before(parameter.name)
            if parameter.row is not RowChoice.EACH or group.positions is None or earlier is not None:
                yield (parameter.table, earlier or parameter.name), "equations of other rows"
            if isinstance(parameter.member, ColumnMember):
                yield (parameter.member.table, parameter.member.column), "which row is looked up"
            if parameter.sampling is not None:
                yield (parameter.sampling.table, parameter.sampling.by), "where a table is sampled"
                yield from _of_expressions((parameter.sampling.at,), "where a table is sampled")


def _columns(values: RowValues | None, what: str) -> Iterator[tuple[Name, str]]:
    if values is None:
        return
    for case in values.cases:
        yield from (((values.table or "", column), what) for column, _ in case.static)
        yield from _of_expressions(case.values, what)


def _of_expressions(expressions: tuple[Expression, ...], what: str) -> Iterator[tuple[Name, str]]:
    for leaf in leaves(expressions):
        if isinstance(leaf, Column):
            yield (leaf.table, leaf.name), what
        if isinstance(leaf, Column | Component) and isinstance(leaf.member, ColumnMember):
            yield (leaf.member.table, leaf.member.column), what
