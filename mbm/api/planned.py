"""The tables of a planned experiment: what is measured may be missing, and candidates stand behind the rows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mbm import compiler
from mbm.compiler import Inputs
from mbm.language.session import Program
from mbm.problem.clauses import effective_clauses, select_problem
from mbm.problem.provenance import Provenance
from mbm.problem.tables import EXTERNAL, Column, Table, TableDeclaration, first_fault
from mbm.registry.standard import Registry
from mbm.report.designs import faults
from mbm.report.designs.design import Offered
from mbm.text.types import Form, MbmError, Sequence, Symbol
from mbm.values import dataclass

COST = "cost"
"""The column of candidates that says what measuring a row costs."""

_NAMED = ("unknowns", "constants", "define", "states")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """``tables`` as equations take them, ``measured`` whether all that is measured is there, and the candidates."""

    tables: Mapping[str, Table]
    measured: bool
    candidates: Offered | None


class Planner:
    """Reads the tables of a problem; ``candidates`` are a path, the name of a table, or a table (None: there are none).

    ``observation`` names the clause whose rows they are, where several could be meant.
    """

    def __init__(
        self, program: Program, name: str | None, inputs: Inputs, registry: Registry, candidates: object
    ) -> None:
        self._program = program
        self._inputs = inputs
        self._registry = registry
        self._candidates = candidates
        self._clauses = effective_clauses(program, select_problem(program, name))

    def plan(self, declarations: Iterable[TableDeclaration], observation: str | None) -> Plan:
        """The tables.

        Raises:
            MbmError: what is wrong with any of them; no-candidates.

        """
        declared = {each.name: each for each in declarations}
        observed = self._observed(tuple(declared))
        found: dict[str, Table] = {}
        absent: list[str] = []
        complete = True
        for name, declaration in declared.items():
            if self._missing(declaration):
                absent.append(name)
                continue
            found[name], there = self._table(declaration, self._inputs, _symbols(observed, name), found)
            complete &= there
        if self._candidates is None:
            if absent:
                self._load([declared[absent[0]]], self._inputs)
            return Plan(tables=found, measured=complete, candidates=None)
        name, rows = self._rows(declared, observed, found, observation)
        measured = _symbols(observed, name)
        own = found.get(name)
        cells = _cells(rows, measured if own is None else measured | (set(rows.columns) - set(own.columns)))
        rows, keyless = self._with_keys(rows, own)
        costs = _costs(rows) if own is None or COST not in own.columns else np.ones(len(rows))
        kept = {key: column for key, column in rows.columns.items() if own is None or key in own.columns}
        if own is None:
            kept.pop(COST, None)
            units = {each.name: each.unit for each in declared[name].columns}
            lacking = sorted(measured - set(kept))
            kept |= {each: Column(name=each, numbers=np.ones(len(rows)), unit=units.get(each)) for each in lacking}
            own = replace(rows, columns=kept).take(np.zeros(0, dtype=np.int64))
            complete = False
        found[name] = _behind(own, replace(rows, columns=kept), measured)
        for other in absent:
            if other != name:
                self._load([declared[other]], self._inputs)
        first = own.provenance.rows + 1
        ordered = {each: found[each] for each in declared}
        return Plan(
            tables=ordered,
            measured=complete,
            candidates=Offered(table=name, first=first, cells=cells, costs=costs, keyless=keyless),
        )

    def _keys(self) -> set[str]:
        """The columns that tell solves apart."""
        clauses = [clause for clause in self._clauses if clause.head == "for-each"]
        return {item.name for clause in clauses for item in clause.items[1:] if isinstance(item, Symbol)}

    def _with_keys(self, rows: Table, own: Table | None) -> tuple[Table, tuple[str, ...]]:
        """Candidates with the key of the first of their ``own`` table's rows where they have none, and the columns."""
        if own is None or not len(own):
            return rows, ()
        keyless = sorted(self._keys() & set(own.columns) - set(rows.columns))
        first = own.take(np.zeros(len(rows), dtype=np.int64)).columns
        return replace(rows, columns={**rows.columns, **{key: first[key] for key in keyless}}), tuple(keyless)

    def _missing(self, declaration: TableDeclaration) -> bool:
        given = declaration.name in self._inputs.tables or declaration.name in self._inputs.paths
        return declaration.source == EXTERNAL and not given

    def _load(
        self, declarations: list[TableDeclaration], inputs: Inputs, known: Mapping[str, Table] | None = None
    ) -> Mapping[str, Table]:
        names = {each.name for each in declarations}
        own = replace(
            inputs,
            tables={name: table for name, table in inputs.tables.items() if name in names},
            paths={name: path for name, path in inputs.paths.items() if name in names},
        )
        return compiler.loaded(declarations, self._program.base, own, self._registry, known or {})

    def _table(
        self, declaration: TableDeclaration, inputs: Inputs, measured: set[str], known: Mapping[str, Table]
    ) -> tuple[Table, bool]:
        """A table with columns for all that is measured, and whether that is there."""
        if declaration.members:
            return self._load([declaration], inputs, known)[declaration.name], True
        bare = self._load([replace(declaration, columns=(), key=None, skip_missing=False)], inputs)[declaration.name]
        kept = tuple(each for each in declaration.columns if each.source in bare.columns or each.name not in measured)
        table = self._load([replace(declaration, columns=kept)], inputs)[declaration.name]
        units = {each.name: each.unit for each in declaration.columns}
        columns, complete = dict(table.columns), True
        for name in sorted(measured):
            column = columns.get(name)
            if column is None:
                columns[name] = Column(name=name, numbers=np.ones(len(table)), unit=units.get(name))
                complete = False
            elif column.numbers is not None and not bool(np.isfinite(column.numbers).all()):
                columns[name] = replace(column, numbers=_filled(column.numbers))
                complete = False
        return replace(table, columns=columns), complete and len(table) > 0

    def _rows(
        self,
        declared: Mapping[str, TableDeclaration],
        observed: Mapping[str, tuple[str, set[str]]],
        found: Mapping[str, Table],
        observation: str | None,
    ) -> tuple[str, Table]:
        """The table that the candidates are rows of, and they."""
        if observation is not None and observation not in observed:
            raise MbmError(faults.unknown_clause(observation, tuple(observed)))
        clauses = [observation] if observation is not None else list(observed)
        tables = list(dict.fromkeys(observed[clause][0] for clause in clauses))
        fitting: dict[str, Table] = {}
        lacking: list[str] = []
        for name in tables:
            rows = self._as_rows(declared, name, _symbols(observed, name), found)
            wanted = set(found[name].columns) - _symbols(observed, name) - self._keys() if name in found else set()
            missing = sorted(wanted - set(rows.columns))
            if missing:
                lacking.append(f"those of `{name}` lack `{missing[0]}`")
            else:
                fitting[name] = rows
        if len(fitting) == 1:
            return next(iter(fitting.items()))
        if fitting:
            listed = ", ".join(f"`{name}`" for name in fitting)
            hint = "say with `--observation` which clause the candidates are rows of"
            raise MbmError(faults.no_candidates(f"the candidates could be rows of {listed}", hint))
        why = "the candidates are rows of no table of an observation" + (f": {lacking[0]}" if lacking else "")
        raise MbmError(faults.no_candidates(why, "give all columns but the measured one, called as in that table"))

    def _as_rows(
        self,
        declared: Mapping[str, TableDeclaration],
        name: str,
        measured: set[str],
        found: Mapping[str, Table],
    ) -> Table:
        """The candidates read as rows of a table."""
        given = self._candidates
        if isinstance(given, str) and given in declared:
            if given not in found:
                self._load([declared[given]], self._inputs)
            return found[given]
        declaration = replace(declared[name], inline=None, members=(), key=None)
        inputs = self._inputs
        if isinstance(given, str | Path):
            inputs = replace(inputs, paths={name: str(given)}, tables={})
        else:
            inputs = replace(inputs, tables={name: given}, paths={})
        try:
            bare = self._load([replace(declaration, columns=(), skip_missing=False)], inputs)[name]
        except MbmError as error:
            if not isinstance(given, str | Path):
                raise
            raise MbmError(*(faults.unread(each, str(given), tuple(declared)) for each in error.diagnostics)) from None
        kept = tuple(each for each in declaration.columns if each.source in bare.columns)
        return self._load([replace(declaration, columns=kept, skip_missing=False)], inputs)[name]

    def _observed(self, tables: tuple[str, ...]) -> dict[str, tuple[str, set[str]]]:
        """For each observation its table, and the names on its measured side that may be columns."""
        known = {"pi", "true", "false", *self._program.constants, *self._program.functions, *self._program.models}
        vocabulary = self._registry.vocabulary()
        known |= {*vocabulary.functions, *vocabulary.special_forms}
        for clause in self._clauses:
            if clause.head in _NAMED:
                known |= {name for each in clause.items[1:] for name in _entry(each)}
        found: dict[str, tuple[str, set[str]]] = {}
        for clause in self._clauses:
            names = [item.name for item in clause.items[1:] if isinstance(item, Symbol)]
            table = next((name for name in names if name in tables), None)
            if clause.head != "observe" or table is None:
                continue
            sides = [each.items[1] for each in clause.items[1:] if isinstance(each, Sequence) and _equation(each)]
            symbols = {name for side in sides for name in _names(side)} - known
            own = next((name for name in names if name not in tables), names[0])
            while own in found:
                own += "'"
            found[own] = (table, {name for name in symbols if "." not in name})
        return found


def _entry(form: Form) -> tuple[str, ...]:
    """The name that an entry of a clause declares."""
    if isinstance(form, Symbol):
        return (form.name,)
    first = form.items[0] if isinstance(form, Sequence) and form.items else None
    return (first.name,) if isinstance(first, Symbol) else ()


def _equation(form: Sequence) -> bool:
    return form.head == "=" and len(form.items) == 3


def _names(form: Form) -> Iterator[str]:
    """All names in a form."""
    if isinstance(form, Symbol):
        yield form.name
    elif isinstance(form, Sequence):
        for item in form.items:
            yield from _names(item)


def _symbols(observed: Mapping[str, tuple[str, set[str]]], table: str) -> set[str]:
    """What observations measure in a table."""
    return set().union(*(names for name, names in observed.values() if name == table))


def _filled(numbers: np.ndarray) -> np.ndarray:
    """Numbers in the place of gaps."""
    there = np.isfinite(numbers)
    return np.where(there, numbers, float(numbers[there].mean()) if bool(there.any()) else 1.0)


def _cells(rows: Table, hidden: set[str]) -> dict[str, Any]:
    """The columns of candidates in the units of their table."""
    from mbm.expression.units import scale_of

    found: dict[str, Any] = {}
    for name, column in rows.columns.items():
        if name in hidden:
            continue
        if column.texts is not None:
            found[name] = list(column.texts)
        else:
            found[name] = scale_of(column.unit).from_si(np.asarray(column.numbers)).tolist()
    return found


def _costs(rows: Table) -> np.ndarray:
    """What each row costs: 1 where nothing is said."""
    column = rows.columns.get(COST)
    if column is None:
        return np.ones(len(rows))
    if column.numbers is None or not bool((column.numbers >= 0).all() & np.isfinite(column.numbers).all()):
        why = "a cost of a candidate is no number from 0 on"
        raise MbmError(faults.no_candidates(why, f"correct the column `{COST}`"))
    return np.asarray(column.numbers)


def _behind(own: Table, rows: Table, measured: set[str]) -> Table:
    """A table with further rows; columns that these lack are filled with what stands for a measured value."""
    columns = {}
    for name in dict.fromkeys((*own.columns, *rows.columns)):
        first, more = own.columns.get(name), rows.columns.get(name)
        told = first if first is not None else more
        if told is None:
            continue
        if told.texts is not None:
            texts = ((), ("",) * len(rows)) if more is None else ((), more.texts or ())
            before = first.texts if first is not None and first.texts is not None else texts[0]
            fault = first_fault(each for each in (first, more) if each is not None)
            columns[name] = Column(name=name, texts=(*before, *texts[1]), unit=told.unit, fault=fault)
            continue
        if more is not None and more.numbers is None and name not in measured:
            why = f"the column `{name}` of the candidates holds no numbers"
            raise MbmError(faults.no_candidates(why, f"correct its cells: `{(more.texts or ('',))[0]}` is the first"))
        before_numbers = np.zeros(0) if first is None or first.numbers is None else first.numbers
        filling = float(before_numbers.mean()) if len(before_numbers) else 1.0
        numbers = None if more is None or name in measured else more.numbers
        after = np.full(len(rows), filling) if numbers is None else numbers
        columns[name] = Column(name=name, numbers=np.concatenate([before_numbers, after]), unit=told.unit)
    count = own.provenance.rows
    numbers_of_rows = np.concatenate([own.rows, count + 1 + np.arange(len(rows))])
    lines = np.concatenate([own.provenance.file_rows, rows.provenance.file_rows])
    provenance = Provenance(path=own.provenance.path, sha256=None, rows=count + len(rows), file_rows=lines)
    return replace(own, columns=columns, rows=numbers_of_rows, provenance=provenance)
