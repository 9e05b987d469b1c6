"""Starts from outside → a problem that states them, for solvers that begin where their problem says.

So that these take other members with other data, a member that is a row of a table begins where that row says: the
table gets columns for it. Members that are the values of a column begin where is said of each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mbm.emit import faults
from mbm.equations.selection import selections
from mbm.expression.nodes import Column as ColumnNode, Number
from mbm.problem.elaborated import Elaborated
from mbm.problem.naming import key_text
from mbm.problem.tables import CellKey, Column, Table
from mbm.problem.types import Family, RowValues, Unknown, UnknownKind, ValueCase
from mbm.report.given_starts import given_starts, member_of_row, rows_of_solve
from mbm.report.types import Floats
from mbm.rotations import matrix_of_quaternion, planar
from mbm.text.types import Diagnostic, MbmError


def with_beginnings(found: Elaborated, init: Mapping[str, object]) -> Elaborated:
    """The problem with starts from ``init``, values by name or a result document.

    Raises:
        MbmError: as `given_starts`; a member of a family has no start; numbers differ from solve to solve.

    """
    problem = found.problem
    starts = given_starts(problem, found.tables, init)
    _, picked = selections(problem, found.tables)
    given = [(selection.key, starts(selection.key)) for selection in picked]
    whole, unknowns, raw, tables = dict(found.starts), list(problem.unknowns), dict(found.raw), dict(found.tables)
    for i, unknown in enumerate(problem.unknowns):
        own = [(key, values[unknown.name]) for key, values in given if unknown.name in values]
        if own and unknown.family is None:
            whole[unknown.name] = _alike(unknown, own)
        elif own and unknown.family is not None:
            numbers = _by_row(unknown, unknown.family, tables[unknown.family.table], own)
            unknowns[i] = _stated(unknown, unknown.family, numbers, raw, tables)
    return replace(found, problem=replace(problem, unknowns=tuple(unknowns)), raw=raw, tables=tables, starts=whole)


def _alike(unknown: Unknown, own: list[tuple[Mapping[str, CellKey], Floats]]) -> tuple[float, ...]:
    """The numbers of an unknown, which all solves begin at."""
    first = np.ravel(own[0][1])
    if any(not np.array_equal(np.ravel(values), first) for _, values in own[1:]):
        raise MbmError(_differs(unknown, None))
    return tuple(first.tolist())


def _by_row(unknown: Unknown, family: Family, table: Table, own: list[tuple[Mapping[str, CellKey], Floats]]) -> Floats:
    """What is stated of the member that each row of the family's table belongs to (rows, width)."""
    member = member_of_row(family, table)
    found = np.full((len(table), stated_of_numbers(unknown, np.zeros((1, unknown.size))).shape[1]), np.nan)
    for key, values in own:
        rows = rows_of_solve(table, key)
        place = {each: number for number, each in enumerate(dict.fromkeys(member[row] for row in rows))}
        numbers = np.reshape(values, (len(place), -1))[[place[member[row]] for row in rows]]
        found[rows] = stated_of_numbers(unknown, numbers)
    lacking = np.flatnonzero(~np.isfinite(found).all(axis=1))
    if len(lacking):
        what = f"`--init` without `{unknown.name}[{key_text(member[lacking[0]])}]`"
        why = "members begin where their table says, and it says nothing of this one"
        raise MbmError(faults.not_emitted(unknown.span, what, why, "give a value for every member, or for none"))
    return found


def _stated(
    unknown: Unknown, family: Family, numbers: Floats, raw: dict[str, Table], tables: dict[str, Table]
) -> Unknown:
    """The unknown with a start for each member: in columns that its table gets, or for each value of its column."""
    table, width = tables[family.table], numbers.shape[1]
    if family.column is None:
        title = f"{unknown.name} start"
        taken = {*raw[family.table].columns, *raw[family.table].provenance.source_columns.values()}
        while any(name.startswith(title) for name in taken):
            title = f"the {title}"  # a column of the file is called so
        titles = [f"{title} {i + 1}" if width > 1 else title for i in range(width)]
        every = np.zeros((len(raw[family.table]), width))  # rows that do not count have a start, too
        every[table.rows - 1] = numbers
        raw[family.table] = _with(raw[family.table], titles, every)
        tables[family.table] = _with(table, titles, numbers)
        cases = [ValueCase(static=(), values=tuple(ColumnNode(family.rows, title) for title in titles))]
    else:
        found: dict[CellKey, Floats] = {}
        for key, line in zip(table.keys(family.column), numbers, strict=True):
            if not np.array_equal(found.setdefault(key, line), line):
                raise MbmError(_differs(unknown, key_text(key)))
        cases = [
            ValueCase(static=((family.column, key),), values=tuple(Number(float(x)) for x in line))
            for key, line in found.items()
        ]
    start = RowValues(table=family.rows, cases=tuple(cases), span=unknown.span)
    return replace(unknown, start=start, at=None, start_lower=None, start_upper=None)


def _differs(unknown: Unknown, member: str | None) -> Diagnostic:
    name = unknown.name if member is None else f"{unknown.name}[{member}]"
    why = "the solves of `for-each` begin at different values"
    return faults.not_emitted(unknown.span, f"`--init` of `{name}`", why, "give one value for all of them")


def _with(table: Table, titles: list[str], numbers: Floats) -> Table:
    """The table with further columns."""
    new = {title: Column(name=title, numbers=numbers[:, i].copy()) for i, title in enumerate(titles)}
    return replace(table, columns={**table.columns, **new})


def stated_of_numbers(unknown: Unknown, numbers: Floats) -> Floats:
    """Numbers of members (k, size) as an ``:init`` would state them (k, width): `numbers_of_stated`, backwards."""
    if not unknown.dimension or unknown.kind is UnknownKind.DIRECTION:
        return numbers
    held = 1 if unknown.dimension == 2 else 4
    matrices = planar(numbers[:, 0]) if unknown.dimension == 2 else matrix_of_quaternion(numbers[:, :4])
    return np.hstack([matrices.reshape(len(numbers), -1), numbers[:, held:]])
