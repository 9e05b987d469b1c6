"""The rows of one step, as a caller gives them → the tables that the equations of a sequence take."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np

from mbm import compiler
from mbm.api import arguments, faults
from mbm.compiler import Inputs
from mbm.equations.types import Floats
from mbm.estimation.sequences.run import Begun
from mbm.estimation.sequences.stepping import Arrived, Cells
from mbm.expression.nodes import Column as ColumnNode, leaves
from mbm.problem.checks import check_data
from mbm.problem.joining import prepare
from mbm.problem.provenance import Provenance
from mbm.problem.sequence.tables import transitions_table
from mbm.problem.sequence.types import INTERVAL, PREVIOUS
from mbm.problem.tables import Column, Table
from mbm.problem.types import Equation, Problem, TablePlan
from mbm.scales import SI, Scale
from mbm.symbolic.types import ColumnInput
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from mbm.api.compilation import Compilation, Origin

Given = Mapping[str, object]


class Arrivals:
    """What reads the rows of steps, for a problem with the data that it was compiled with."""

    def __init__(self, begun: Begun, compilation: Compilation, origin: Origin, inputs: Inputs) -> None:
        self._begun, self._compilation, self._origin, self._inputs = begun, compilation, origin, inputs
        problem, sequence = begun.problem, begun.sequence
        plans = {plan.name: plan for plan in problem.plans}
        self._sources = {table: _scale(plans[table], sequence.column) for table, _ in sequence.sources}
        self._plans = {name: plans[name] for name in self._sources}
        paired = {table for pair in problem.pairs for _, table in pair.sides}
        self._simple = {name for name, plan in self._plans.items() if _simple(plan) and name not in paired}
        column = sequence.column
        self._wanted = {name: begun.tables[name].columns.keys() - {column} for name in self._simple}
        self._used = _of_transitions(begun)

    def read(self, given: object, at: float | None, before: float | None) -> tuple[float, Arrived]:
        """The key of the step (SI), and its rows; ``before`` is the key of the step before.

        Raises:
            MbmError: the rows are none, of no step or of several, or of one that is over.

        """
        tables = arguments.by_name("tables", given)
        for name in tables:
            if name not in self._sources:
                raise MbmError(faults.not_of_a_step(name, self._begun.sequence.column, tuple(self._sources)))
        column = self._begun.sequence.column
        cells = self._cells(tables)
        read = None if cells is not None else self._read(tables, at)
        key = self._key(at, cells or {}, read or {})
        if before is not None and not key > before:
            raise MbmError(faults.step_is_over(column, key, before))
        if cells is not None:
            cells = {name: each if column in each else _keyed(each, column, key) for name, each in cells.items()}
            cells[self._begun.sequence.steps] = {column: np.array([key])}
        return key, Arrived(
            cells=cells,
            tables=lambda: self._tables(self._read(tables, key) if read is None else read, key, before),
            transition=None if cells is None or before is None else self._transition(cells, key, before),
        )

    def _cells(self, tables: Given) -> Cells | None:
        """The columns in SI; None where they are not all plain numbers of tables that are taken as they are."""
        found: dict[str, Mapping[str, Floats]] = {}
        for name, table in tables.items():
            if name not in self._simple or not (type(table) is dict or isinstance(table, Mapping)):
                return None
            own = {}
            try:
                for column, values in table.items():
                    own[column] = np.array(values, dtype=np.float64, ndmin=1)
            except (TypeError, ValueError, OverflowError):
                return None
            for declared in self._plans[name].declaration.columns:
                if declared.source in own:
                    own[declared.name] = declared.scale.to_si(own[declared.source])
            shapes = {each.shape for each in own.values()}
            if len(shapes) != 1 or len(next(iter(shapes))) != 1 or not self._wanted[name] <= own.keys():
                return None
            if not np.isfinite(list(own.values())).all():
                return None
            found[name] = own
        return found

    def _key(self, at: float | None, cells: Cells, read: Mapping[str, Table]) -> float:
        """The one key of all rows."""
        column = self._begun.sequence.column
        keys = set() if at is None else {arguments.step(at)}
        for each in cells.values():
            if column in each:
                keys.update(each[column].tolist())
        for table in read.values():
            keys.update(table.numbers(column).tolist())
        if len(keys) != 1 or not isfinite(min(keys)):
            raise MbmError(faults.not_one_step(column, sorted(keys)))
        return keys.pop()

    def _transition(self, cells: Cells, key: float, before: float) -> Mapping[str, float] | None:
        """The numbers that the transition takes, by column; None where some are to be read."""
        known = {INTERVAL: key - before, PREVIOUS: before, self._begun.sequence.column: key}
        found = {}
        for name in self._used:
            number = known.get(name)
            if number is None:
                table, _, column = name.partition(".")
                own = cells.get(table, {}).get(column)
                if own is None or len(own) != 1:
                    return None
                number = float(own[0])
            found[name] = number
        return found

    def _read(self, given: Given, key: float | None) -> dict[str, Table]:
        """The tables as the data of the problem are read; ``key`` (None: not known) is put where no column says it.

        Raises:
            MbmError: what is wrong with any of them.

        """
        named = {name: self._named(name, table, key) for name, table in given.items()}
        declarations = [self._plans[name].declaration for name in named]
        inputs = replace(self._inputs, tables=named, paths={})
        read = compiler.loaded(declarations, self._origin.reading.base, inputs, self._origin.registry)
        for name, table in read.items():
            known = self._compilation.elaborated.raw[name].columns
            lacking = [each for each in known if each not in table.columns]
            if lacking:
                raise MbmError(faults.lacks_columns(name, tuple(lacking)))
            other = [each for each in known if len(table) and known[each].is_text != table.columns[each].is_text]
            if other:
                table.columns[other[0]].check()
                raise MbmError(faults.other_cells(name, other[0], texts=known[other[0]].is_text))
        return read

    def _named(self, name: str, table: object, key: float | None) -> object:
        """A table as the reader takes it: numbers alone are columns of one row, and the key is in all rows."""
        if not isinstance(table, Mapping):
            return table
        columns: dict[str, object] = {}
        rows = 0
        for column, values in table.items():
            cells = [values] if isinstance(values, str) or np.ndim(values) == 0 else values
            columns[column] = cells
            rows = max(rows, len(cells))
        source = _source(self._plans[name], self._begun.sequence.column)
        if source not in columns and key is not None:
            columns[source] = np.full(rows, self._sources[name].from_si(key))
        return columns

    def _tables(self, read: Mapping[str, Table], key: float, before: float | None) -> dict[str, Table]:
        """All tables of the problem with the rows of this step alone.

        Raises:
            MbmError: they do not go with the problem.

        """
        found, sequence = self._compilation.elaborated, self._begun.sequence
        nothing = np.zeros(0, dtype=np.int64)
        raw = {name: table.take(nothing) if name in self._sources else table for name, table in found.raw.items()}
        for name, table in read.items():
            keys = Column(name=sequence.column, numbers=np.full(len(table), key))
            raw[name] = replace(table, columns={**table.columns, sequence.column: keys})
        tables = prepare(found.problem, raw)
        both = [key] if before is None else [before, key]
        tables[sequence.steps] = _steps(self._begun.tables[sequence.steps], sequence.column, both)
        tables[sequence.reached] = transitions_table(sequence, tables)
        errors, _ = check_data(found.problem, tables)
        if errors:
            raise MbmError(*errors)
        return {**tables, sequence.steps: tables[sequence.steps].take(np.array([len(both) - 1]))}


def _steps(table: Table, column: str, keys: list[float]) -> Table:
    """A table of steps."""
    count = len(keys)
    provenance = Provenance(path=table.provenance.path, sha256=None, rows=count, file_rows=np.arange(1, count + 1))
    columns = {column: Column(name=column, numbers=np.array(keys))}
    return replace(table, columns=columns, rows=np.arange(1, count + 1), provenance=provenance)


def _keyed(columns: Mapping[str, Floats], column: str, key: float) -> Mapping[str, Floats]:
    return {column: np.full(len(next(iter(columns.values()))), key), **columns}


def _simple(plan: TablePlan) -> bool:
    """Whether the rows of a table are those that are given."""
    declaration = plan.declaration
    return not (plan.joins or plan.where or declaration.members or declaration.skip_missing)


def _scale(plan: TablePlan, column: str) -> Scale:
    return next((declared.scale for declared in plan.declaration.columns if declared.name == column), SI)


def _source(plan: TablePlan, column: str) -> str:
    return next((declared.source for declared in plan.declaration.columns if declared.name == column), column)


def _equations(problem: Problem, owner: int) -> Iterator[Equation]:
    for case in problem.blocks[owner].cases:
        yield from case.equations


def _of_transitions(begun: Begun) -> tuple[str, ...]:
    """The columns of the table of transitions that these use."""
    found: dict[str, None] = {}
    for group in (*begun.chained.moving.equations.groups, *begun.chained.moving.equations.constraints):
        found.update(dict.fromkeys(p.name for p in group.kernel.parameters if isinstance(p, ColumnInput)))
        for equation in _equations(begun.problem, group.kernel.owner):
            found.update(dict.fromkeys(leaf.name for leaf in leaves(equation.noise) if isinstance(leaf, ColumnNode)))
    return tuple(found)
