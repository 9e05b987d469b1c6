"""The data against the equations: gaps in what is used, keys without members, observations without rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from mbm.expression.nodes import Column, ColumnMember, Component, Expression, Leaf, leaves
from mbm.expression.rows import Row, RowChoice, chosen_place
from mbm.problem import faults
from mbm.problem.previous import column_before, has_before
from mbm.problem.requests import divided_by
from mbm.problem.rows import MAXIMUM_REPORTED, Positions, column_numbers, decided, keyed_rows, rows_of, timed_rows
from mbm.problem.tables import CellKey, PairDeclaration, Table
from mbm.problem.types import Block, BlockRole, Problem, Static
from mbm.text.suggest import closest
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass


def used_rows(block: Block, tables: Mapping[str, Table]) -> np.ndarray | None:
    """Mask of the rows of a block's table that its ``:when`` keeps; None for a block without a table."""
    if block.table is None:
        return None
    table = tables[block.table]
    kept = np.ones(len(table), dtype=bool) if block.when is None else decided(block.when, tables)[:, 0]
    kept = kept & has_before(table) if block.earlier else kept
    return kept & _first_of_kind(table, block.distinct) if block.distinct else kept


def _first_of_kind(table: Table, columns: tuple[str, ...]) -> np.ndarray:
    """Mask of the rows that are the first with their values in ``columns``."""
    mask = np.zeros(len(table), dtype=bool)
    seen: set[tuple[CellKey, ...]] = set()
    cells = [table.keys(c) if c in table.columns else [float(r) for r in table.rows] for c in columns]
    for row, values in enumerate(zip(*cells, strict=True)):
        if values not in seen:
            seen.add(values)
            mask[row] = True
    return mask


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mentioned:
    """The columns, and the members that cells name, that expressions mention for the rows of ``table``, each once.

    The rows are those that have the values ``static``, and are used in the block numbered ``block`` (None: all).
    """

    table: str | None
    static: Static
    block: int | None
    leaves: tuple[Leaf, ...]


def mentioned(problem: Problem) -> tuple[Mentioned, ...]:
    """What the equations of a problem and what is derived mention of any data."""
    found = [
        _mentioned(block.table, case.static, number, [e.stated for e in case.equations])
        for number, block in enumerate(problem.blocks)
        for case in block.cases
    ]
    for derived in problem.derived:
        found += [_mentioned(derived.table, case.static, None, [case.values]) for case in derived.cases]
    for each in problem.aggregates:
        found += [_mentioned(each.table, static, None, [(value,)]) for static, value in each.cases]
    for number, block in enumerate(problem.blocks):
        for sigma in (column.sigma for column in block.errors if column.sigma is not None):
            found += [_mentioned(block.table, case.static, number, [case.values]) for case in sigma.cases]
    return tuple(each for each in found if each.leaves)


def _mentioned(
    table: str | None, static: Static, block: int | None, expressions: list[tuple[Expression, ...]]
) -> Mentioned:
    found: dict[object, Leaf] = {}
    for nodes in expressions:
        for leaf in leaves(nodes):
            if isinstance(leaf, Column):
                found.setdefault(leaf.identity, leaf)
            elif isinstance(leaf, Component) and isinstance(leaf.member, ColumnMember):
                found.setdefault((leaf.unknown, leaf.member), leaf)
    return Mentioned(table=table, static=static, block=block, leaves=tuple(found.values()))


def check_data(
    problem: Problem, tables: Mapping[str, Table], known: tuple[Mentioned, ...] | None = None
) -> tuple[list[Diagnostic], list[Diagnostic]]:
    """Errors and warnings about the data as far as the problem uses them; ``known``: what `mentioned` found."""
    errors: list[Diagnostic] = []
    warnings: list[Diagnostic] = []
    families = {u.name: u.family.rows for u in problem.unknowns if u.family is not None}
    for plan in problem.plans:
        warnings.extend(tables[plan.name].provenance.remarks)
    masks = [used_rows(block, tables) for block in problem.blocks]
    for block, mask in zip(problem.blocks, masks, strict=True):
        if mask is not None and not mask.any():
            warnings.append(faults.no_rows(block.span, block.name))
    for pair in problem.pairs:
        warnings.extend(_without_common_key(pair, tables[pair.first], tables[pair.second]))
    for each in mentioned(problem) if known is None else known:
        table = tables[each.table] if each.table is not None else None
        positions = rows_of(each.static, table) if table is not None else None
        mask = masks[each.block] if each.block is not None else None
        if positions is not None and mask is not None:
            positions = positions[mask[positions]]
        observed = each.block is not None and problem.blocks[each.block].role is BlockRole.OBSERVATION
        errors.extend(_cells(each.leaves, table, positions, tables, families, observed))
    for block, mask in zip(problem.blocks, masks, strict=True):
        if block.table is not None and mask is not None:
            observed = block.role is BlockRole.OBSERVATION
            errors.extend(_undivided(problem, tables[block.table], np.flatnonzero(mask), observed))
    for derived in problem.derived:
        if derived.table is not None:
            table = tables[derived.table]
            errors.extend(_undivided(problem, table, np.arange(len(table)), False))
    return _first_of_each(errors), warnings


def _undivided(problem: Problem, table: Table, rows: Positions, observed: bool) -> Iterator[Diagnostic]:
    """The ``rows`` that belong to no data set: without a number in a column of ``for-each`` or ``window``."""
    window = problem.request.window
    for name in divided_by(problem.request.for_each, window):
        numbers = table.columns[name].numbers if name in table.columns else None
        if numbers is not None:
            used = window.span if window is not None and name == window.column else None
            wrong = rows[~np.isfinite(numbers[rows])][:MAXIMUM_REPORTED]
            leave = faults.Leave.OBSERVED if observed else faults.Leave.EVERYWHERE
            yield from (
                faults.not_finite_cell(table.place(int(i), name), name, float(numbers[i]), used, leave) for i in wrong
            )


def _without_common_key(pair: PairDeclaration, first: Table, second: Table) -> Iterator[Diagnostic]:
    """That two tables, which have rows, share no value of a key."""
    for key in pair.keys:
        if key in first.columns and key in second.columns and len(first) and len(second):
            held = {table.name: tuple(dict.fromkeys(table.keys(key))) for table in (first, second)}
            if set(held[first.name]).isdisjoint(held[second.name]):
                yield faults.no_common_key(pair.span, pair.name, key, held)


def _first_of_each(errors: list[Diagnostic]) -> list[Diagnostic]:
    found: dict[object, Diagnostic] = {}
    for error in errors:
        found.setdefault((error.code, error.place), error)
    return list(found.values())


def _cells(
    mentioned_leaves: tuple[Leaf, ...],
    table: Table | None,
    positions: Positions | None,
    tables: Mapping[str, Table],
    families: Mapping[str, str],
    observed: bool,
) -> list[Diagnostic]:
    found: list[Diagnostic] = []
    for leaf in mentioned_leaves:
        if isinstance(leaf, Column):
            found.extend(_finite(leaf, table, positions, tables, observed))
        elif isinstance(leaf, Component) and isinstance(leaf.member, ColumnMember):
            found.extend(_members(leaf, leaf.member, table, positions, tables, families))
    return found


def _finite(
    leaf: Column, table: Table | None, positions: Positions | None, tables: Mapping[str, Table], observed: bool
) -> list[Diagnostic]:
    if leaf.sampling is not None and leaf.name == leaf.sampling.by:
        try:
            timed_rows(leaf.sampling, tables[leaf.table])
        except MbmError as error:
            return list(error.diagnostics)
    owner, rows = _rows(leaf, leaf.row, table, positions, tables)
    numbers = column_numbers(owner, leaf.name)
    rows = rows[has_before(owner)[rows]] if column_before(leaf.name) is not None else rows
    wrong = rows[~np.isfinite(numbers[rows])][:MAXIMUM_REPORTED]
    leave = faults.Leave.OBSERVED if observed and owner is table else faults.Leave.EVERYWHERE
    return [
        faults.not_finite_cell(owner.place(int(i), leaf.name), leaf.name, float(numbers[i]), leaf.span, leave)
        for i in wrong
    ]


def _rows(
    leaf: Leaf, row: Row, table: Table | None, positions: Positions | None, tables: Mapping[str, Table]
) -> tuple[Table, Positions]:
    name = leaf.table if isinstance(leaf, Column) else ""
    if isinstance(leaf, Column) and row is RowChoice.KEYED:
        return tables[name], np.unique(keyed_rows(leaf, table, positions, tables))
    if isinstance(leaf, Column) and leaf.sampling is not None:  # which rows is known when the unknowns are
        return tables[name], np.arange(len(tables[name]))
    if row is RowChoice.EACH and table is not None and positions is not None:
        return table, positions
    owner = tables[name]
    if len(owner) == 0 or row is RowChoice.COUNT:
        return owner, np.empty(0, dtype=np.int64)
    if isinstance(row, int):  # in each part of the table, another one
        return owner, np.arange(len(owner))
    return owner, np.array([chosen_place(row, len(owner))])


def _members(
    leaf: Component,
    member: ColumnMember,
    table: Table | None,
    positions: Positions | None,
    tables: Mapping[str, Table],
    families: Mapping[str, str],
) -> list[Diagnostic]:
    family = tables[families[leaf.unknown]]
    keys = set(family.keys())
    if table is None or positions is None or member.table != table.name or member.row is not RowChoice.EACH:
        return []
    if member.column not in table.columns:
        return []
    cells = table.keys(member.column)
    if column_before(member.column) is not None:
        positions = positions[has_before(table)[positions]]
    found = []
    for i in positions:
        if cells[i] not in keys:
            cell = cells[i]
            near = closest(cell, sorted(str(k) for k in keys)) if isinstance(cell, str) else None
            place = table.place(int(i), member.column)
            where = f"the family `{leaf.unknown}`"
            found.append(faults.dangling_key(place, cell, where, near, leaf.span))
            if len(found) == MAXIMUM_REPORTED:
                break
    return found
