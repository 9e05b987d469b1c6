"""Which measured values are corrected: each is numbered once, however many equations use it.

Which rows use a measured value that others use too, and what hangs together by such values.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.scatter import tied_parts
from mbm.equations.types import Floats, Indices, Mask
from mbm.equations.whitening import whitener
from mbm.expression.nodes import Column, leaves
from mbm.expression.rows import RowChoice, chosen_place
from mbm.problem import faults
from mbm.problem.checks import used_rows
from mbm.problem.rows import row_values, rows_of
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Block, EquationCase, Problem, RowValues, UncertainColumn
from mbm.symbolic.types import ColumnInput
from mbm.text.types import MbmError
from mbm.values import dataclass

Some = tuple[tuple[int, Indices], ...]
"""Rows of several groups: the group's number with the positions of the rows in it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Division:
    """Rows that share no uncertain value with another, and those that do."""

    alone: Some
    shared: Some


def divided(measured: Measured, rows: Some) -> Division:
    """The rows divided by whether one of their values is used twice."""
    times = np.zeros(len(measured.sigma), dtype=np.int64)
    for number, chosen in rows:
        ids = measured.ids[number][chosen]
        times += np.bincount(ids[measured.sigma[ids] > 0.0], minlength=len(times))
    alone, shared = [], []
    for number, chosen in rows:
        ids = measured.ids[number][chosen]
        meets = ((measured.sigma[ids] > 0.0) & (times[ids] > 1)).any(axis=1)
        if not bool(meets.all()):
            alone.append((number, chosen[~meets]))
        if bool(meets.any()):
            shared.append((number, chosen[meets]))
    return Division(alone=tuple(alone), shared=tuple(shared))


def components(measured: Measured, shared: Some) -> Indices:
    """The component, from 0, of each shared row, group after group."""
    lines, values, offset = [], [], 0
    for number, rows in shared:
        ids = measured.ids[number][rows]
        real = measured.sigma[ids] > 0.0
        lines.append(np.broadcast_to(offset + np.arange(len(rows))[:, None], ids.shape)[real])
        values.append(ids[real])
        offset += len(rows)
    labels, _ = tied_parts(np.concatenate(lines), np.concatenate(values), offset, len(measured.sigma))
    return np.asarray(np.unique(labels, return_inverse=True)[1], dtype=np.int64)


def values_of(measured: Measured, shared: Some, component: Indices) -> tuple[Indices, Indices]:
    """The uncertain values of all components as sorted numbers ``value + component·P``, and their components."""
    count = len(measured.sigma)
    parts, offset = [], 0
    for number, rows in shared:
        ids = measured.ids[number][rows]
        owner = np.broadcast_to(component[offset : offset + len(rows)][:, None], ids.shape)
        real = measured.sigma[ids] > 0.0
        parts.append(ids[real] + owner[real] * count)
        offset += len(rows)
    found = np.unique(np.concatenate(parts))
    return found, found // count


def check_sharing(
    problem: Problem, tables: Mapping[str, Table], rows: Mapping[int, UncertainRows], measured: Measured
) -> None:
    """Whether corrections can meet the equations.

    Raises:
        MbmError: more exact equations than uncertain values hang together, or a loss acts on rows that share some.

    """
    division = divided(measured, tuple((number, np.arange(len(each.noisy))) for number, each in rows.items()))
    for number, chosen in division.alone:
        ids = measured.ids[number][chosen]
        exact = (~rows[number].noisy[chosen]).sum(axis=1)
        uncertain = (measured.sigma[ids] > 0.0).sum(axis=1)
        if bool((exact > uncertain).any()):
            row = int(np.argmax(exact > uncertain))
            counts = (int(exact[row]), int(uncertain[row]))
            raise _too_few(problem, tables, rows[number], int(chosen[row]), counts)
    if not division.shared:
        return
    for number, _ in division.shared:
        if rows[number].lossy:
            block = problem.blocks[rows[number].owner]
            raise MbmError(faults.errors_with_loss(block.span, block.name, rows[number].columns[0].name))
    component = components(measured, division.shared)
    size = int(component.max()) + 1
    owners = values_of(measured, division.shared, component)[1]
    each_exact = np.concatenate([(~rows[number].noisy[chosen]).sum(axis=1) for number, chosen in division.shared])
    exact = np.bincount(component, weights=each_exact, minlength=size)
    uncertain = np.bincount(owners, minlength=size)
    if not bool((exact > uncertain).any()):
        return
    worst = int(np.argmax(exact > uncertain))
    place = int(np.argmax(component == worst))
    for number, chosen in division.shared:
        if place < len(chosen):
            counts = (int(exact[worst]), int(uncertain[worst]))
            raise _too_few(problem, tables, rows[number], int(chosen[place]), counts)
        place -= len(chosen)


def _too_few(
    problem: Problem, tables: Mapping[str, Table], rows: UncertainRows, row: int, counts: tuple[int, int]
) -> MbmError:
    block = problem.blocks[rows.owner]
    place = tables[block.table].place(int(rows.positions[row])) if block.table is not None else None
    return MbmError(faults.too_few_errors(block.span, block.name, *counts, place))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UncertainRows:
    """Rows of one block with the same equations.

    ``owner`` is the block, ``positions`` (from 0) are those in its table, ``columns`` the uncertain inputs, ``noisy``
    (rows, outputs) says which equations have noise of their own, ``lossy`` that a loss acts on them.
    """

    owner: int
    positions: Indices
    columns: tuple[ColumnInput, ...]
    noisy: Mask
    lossy: bool


def rows_of_groups(groups: tuple[Group, ...]) -> dict[int, UncertainRows]:
    """The rows with uncertain values, by the number of their group."""
    found = {}
    for number, group in enumerate(groups):
        corrections = group.kernel.corrections
        if corrections is None:
            continue
        inputs = [group.kernel.parameters[column] for column in corrections.columns]
        found[number] = UncertainRows(
            owner=group.kernel.owner,
            positions=group.positions if group.positions is not None else np.zeros(1, dtype=np.int64),
            columns=tuple(each for each in inputs if isinstance(each, ColumnInput)),
            noisy=np.hstack([w.noisy for w in group.whiteners]),
            lossy=bool(group.losses),
        )
    return found


def rows_of_problem(problem: Problem, tables: Mapping[str, Table]) -> dict[int, UncertainRows]:
    """The same without kernels, numbered in the order of the blocks' cases.

    Raises:
        MbmError: noise that is none.

    """
    found: dict[int, UncertainRows] = {}
    for owner, block in enumerate(problem.blocks):
        if not block.errors or block.table is None:
            continue
        table, mask = tables[block.table], used_rows(block, tables)
        for case in block.cases:
            columns = uncertain_columns(block, case)
            positions = rows_of(case.static, table)
            positions = positions if mask is None else positions[mask[positions]]
            if not columns:
                continue
            parts = [
                whitener(equation, 0, table, positions, tables, may_be_exact=True).noisy for equation in case.equations
            ]
            found[len(found)] = UncertainRows(
                owner=owner, positions=positions, columns=columns, noisy=np.hstack(parts), lossy=block.loss is not None
            )
    return found


def uncertain_columns(block: Block, case: EquationCase) -> tuple[ColumnInput, ...]:
    """The inputs of a case that are uncertain columns of its block."""
    names = {error.name for error in block.errors}
    components = tuple(c for equation in case.equations for c in equation.components)
    return tuple(
        dict.fromkeys(
            ColumnInput(leaf.table, leaf.name, leaf.row)
            for leaf in leaves(components)
            if isinstance(leaf, Column) and leaf.table == block.table and leaf.name in names
        )
    )


SAME_SIGMAS = 1e-9
"""Relative difference up to which two statements of one standard deviation agree: far above rounding."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredColumn:
    """The corrected values of one column: those numbered ``first …``, in the rows ``rows`` (p,) of its table.

    Rows count from 1 in the unfiltered table; numbers below 0 stand for rows that a filter has left out.
    """

    table: str
    column: str
    first: int
    rows: Indices


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Measured:
    """All corrected values: their standard deviations ``sigma`` (P,), 0 where a value is exact.

    ``ids`` has, for each group with corrections by its position among all groups, the values that its equations use,
    shape (rows, columns of its kernel's corrections).
    """

    columns: tuple[MeasuredColumn, ...]
    sigma: Floats
    ids: Mapping[int, Indices]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Use:
    """One uncertain column in one group: the identity of each row's value, and its standard deviation if stated."""

    group: int
    place: int
    error: UncertainColumn
    rows: Indices
    sigma: Floats | None


def measured(problem: Problem, tables: Mapping[str, Table], rows: Mapping[int, UncertainRows]) -> Measured:
    """The values that the equations of ``rows`` correct.

    Raises:
        MbmError: a standard deviation that is none, or two different ones of one value.

    """
    uses: dict[tuple[str, str], list[_Use]] = {}
    strays: dict[tuple[str, CellKey], int] = {}
    sigmas: dict[tuple[int, str], Floats] = {}
    for number, each in rows.items():
        block = problem.blocks[each.owner]
        for place, column in enumerate(each.columns):
            error = next(e for e in block.errors if e.name == column.name)
            table = tables[column.table]
            positions = each.positions
            if column.row is not RowChoice.EACH:
                positions = np.full(len(positions), chosen_place(column.row, len(table)))
            sigma = None
            if error.sigma is not None:
                known = (each.owner, error.name)
                if known not in sigmas:
                    sigmas[known] = row_values(error.sigma, tables)[:, 0]
                sigma = sigmas[known][positions]
                refuse_bad_sigma(error, error.sigma, sigma, table, positions)
            use = _Use(
                group=number,
                place=place,
                error=error,
                rows=_identities(error, table, positions, tables, strays),
                sigma=sigma,
            )
            uses.setdefault((error.table, error.column), []).append(use)
    return _numbered(uses, rows, tables)


def refuse_bad_sigma(
    error: UncertainColumn, stated: RowValues, sigma: Floats, table: Table, positions: Indices
) -> None:
    """Refuse what is no standard deviation: ``sigma`` (rows,) of the rows at ``positions``, as ``stated``.

    Raises:
        MbmError: `bad-noise`.

    """
    wrong = np.flatnonzero(~(sigma >= 0) | ~np.isfinite(sigma))
    if wrong.size:
        what = f"a sigma of `{error.name}` is {sigma[wrong[0]]:g}"
        raise MbmError(faults.bad_noise(stated.span, what, table.place(int(positions[wrong[0]]))))


def _identities(
    error: UncertainColumn,
    table: Table,
    positions: Indices,
    tables: Mapping[str, Table],
    strays: dict[tuple[str, CellKey], int],
) -> Indices:
    """The row (from 1) of the column's own table that each value stands in; below 0 where that row was left out."""
    if error.key is None:
        return np.asarray(table.rows[positions], dtype=np.int64)
    own = tables[error.table]
    row_of = {key: int(row) for key, row in zip(own.keys(), own.rows, strict=True)}
    cells = table.keys(error.key)
    found = np.empty(len(positions), dtype=np.int64)
    for i, position in enumerate(positions):
        cell = cells[position]
        row = row_of.get(cell)
        found[i] = strays.setdefault((error.table, cell), -1 - len(strays)) if row is None else row
    return found


def _numbered(
    uses: Mapping[tuple[str, str], list[_Use]], rows_of: Mapping[int, UncertainRows], tables: Mapping[str, Table]
) -> Measured:
    columns: list[MeasuredColumn] = []
    ids = {n: np.zeros((len(each.noisy), len(each.columns)), dtype=np.int64) for n, each in rows_of.items()}
    parts: list[Floats] = []
    first = 0
    for (table, column), found in uses.items():
        rows, inverse = np.unique(np.concatenate([use.rows for use in found]), return_inverse=True)
        columns.append(MeasuredColumn(table=table, column=column, first=first, rows=rows))
        sigma = np.full(len(rows), np.nan)
        offset = 0
        for use in found:
            places = inverse[offset : offset + len(use.rows)]
            offset += len(use.rows)
            ids[use.group][:, use.place] = first + places
            if use.sigma is not None:
                _state(sigma, places, use, rows, tables)
        parts.append(np.where(np.isnan(sigma), 0.0, sigma))
        first += len(rows)
    return Measured(columns=tuple(columns), sigma=np.concatenate(parts) if parts else np.empty(0), ids=ids)


def _state(sigma: Floats, places: Indices, use: _Use, rows: Indices, tables: Mapping[str, Table]) -> None:
    """Enter the standard deviations of one use; one value has one."""
    if use.sigma is None:
        return
    known = ~np.isnan(sigma[places])
    sigma[places[~known]] = use.sigma[~known]
    differs = np.abs(sigma[places] - use.sigma) > SAME_SIGMAS * np.maximum(sigma[places], use.sigma)
    if bool(differs.any()):
        i = int(np.argmax(differs))
        row = int(rows[places[i]])
        own = tables[use.error.table]
        place = own.provenance.place(row, use.error.column) if row > 0 else None
        pair = (float(sigma[places[i]]), float(use.sigma[i]))
        raise MbmError(faults.errors_differ(use.error.span, use.error.name, pair, place))
