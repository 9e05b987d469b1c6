"""What the structure of the equations alone says about observability: no number is computed.

Each scalar unknown needs an equation of its own that mentions it. A matching of unknowns to equations (augmenting
paths, Kuhn 1955) finds the unknowns that are left over whatever the values are; the rank decision sees the rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field

import numpy as np

from mbm.expression.nodes import Column, ColumnMember, Component, External, LiteralMember, externals, leaves
from mbm.expression.rows import RowChoice, chosen_place
from mbm.problem import faults
from mbm.problem.bounded import percentages
from mbm.problem.checks import used_rows
from mbm.problem.kinds import Relation
from mbm.problem.rows import decided, row_values, rows_of
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import EquationCase, Problem, Unknown, UnknownKind
from mbm.text.faults import worth_reading
from mbm.text.types import Diagnostic
from mbm.values import dataclass

MAXIMUM_EQUATIONS = 20_000
"""Scalar equations that are looked at; with more rows the structure is rarely what is missing."""

Scalar = tuple[str, CellKey | None, tuple[int, ...]]
"""A number of an unknown: its name, its member's key, its index."""


def called_functions(problem: Problem) -> tuple[External, ...]:
    """The functions in Python that equations and derived quantities call, each once."""
    found: dict[str, External] = {}
    for block in problem.blocks:
        for external in externals(tuple(n for case in block.cases for e in case.equations for n in e.components)):
            if isinstance(external, External):
                found.setdefault(external.function, external)
    for derived in problem.derived:
        for external in externals(tuple(n for case in derived.cases for n in case.values)):
            if isinstance(external, External):
                found.setdefault(external.function, external)
    return tuple(found.values())


def structural_warnings(problem: Problem, tables: Mapping[str, Table]) -> list[Diagnostic]:
    """Unknowns that no equation mentions, whose condition ``:fixed`` holds nowhere or that begin outside their bounds,
    and those that are left without an equation of their own; and deviations that look as if they were relative.
    """
    mentions = list(_mentions(problem, tables))
    mentioned = {scalar for scalars in mentions for scalar in scalars}
    names = {scalar[0] for scalar in mentioned}
    found = list(worth_reading([faults.unmentioned(u.span, u.name) for u in problem.unknowns if u.name not in names]))
    found += worth_reading([warning for u in problem.unknowns for warning in _fixed_nowhere(u, tables)])
    found += worth_reading([warning for u in problem.unknowns for warning in _begins_outside(u, tables)])
    found += worth_reading(list(percentages(problem)))
    if len(mentions) >= MAXIMUM_EQUATIONS or any(u.fixed is not None for u in problem.unknowns):
        return found
    left = sorted({scalar[0] for scalar in _unmatched(mentions, sorted(mentioned, key=repr))})
    spans = {unknown.name: unknown.span for unknown in problem.unknowns}
    too_few = [faults.too_few_equations(spans[name], name, len(mentions), len(mentioned)) for name in left]
    return [*found, *worth_reading(too_few)]


def _begins_outside(unknown: Unknown, tables: Mapping[str, Table]) -> Iterator[Diagnostic]:
    """That a number begins beyond a bound; angles are taken by whole turns, and poses are not looked at."""
    start = unknown.start
    if start is None or unknown.dimension or unknown.kind is UnknownKind.ANGLE:
        return
    values = row_values(start, tables)
    found = [
        (bound, (side * values < side * row_values(bound, tables)).any(axis=1))
        for bound, side in ((unknown.lower, 1.0), (unknown.upper, -1.0))
        if bound is not None
    ]
    beyond = [bound for bound, outside in found if outside.any()]
    if beyond:
        members = int(np.any([outside for _, outside in found], axis=0).sum())
        yield faults.start_outside_bounds(start.span, beyond[0].span, unknown.name, members)


def _fixed_nowhere(unknown: Unknown, tables: Mapping[str, Table]) -> Iterator[Diagnostic]:
    """That a condition which depends on the member holds for none."""
    fixed = unknown.fixed
    if fixed is None or fixed.table is None:
        return
    if not any(case.static or any(isinstance(leaf, Column) for leaf in leaves(case.values)) for case in fixed.cases):
        return  # `false` for all
    held = decided(fixed, tables)
    if len(held) and not held.any():
        yield faults.fixed_nowhere(fixed.span, unknown.name, len(held))


def _mentions(problem: Problem, tables: Mapping[str, Table]) -> Iterator[frozenset[Scalar]]:
    """The numbers that each scalar equation in use mentions."""
    count = 0
    for block in problem.blocks:
        mask = used_rows(block, tables)
        table = tables[block.table] if block.table is not None else None
        for case in block.cases:
            for scalars in _of_case(case, table, mask, tables):
                yield scalars
                count += 1
                if count >= MAXIMUM_EQUATIONS:
                    return


def _of_case(
    case: EquationCase, table: Table | None, mask: np.ndarray | None, tables: Mapping[str, Table]
) -> Iterator[frozenset[Scalar]]:
    positions = [0]
    if table is not None and mask is not None:
        found = rows_of(case.static, table)
        positions = found[mask[found]][:MAXIMUM_EQUATIONS].tolist()
    for equation in case.equations:
        if equation.relation is Relation.NOT_ABOVE_ZERO:
            continue  # it bounds, but determines nothing
        for node in equation.components:
            components = [leaf for leaf in leaves((node,)) if isinstance(leaf, Component)]
            members = {c.member for c in components if isinstance(c.member, ColumnMember)}
            columns = {m: _keys(tables[m.table], m.column) for m in members}
            for position in positions:
                yield frozenset(_scalar(c, columns, position) for c in components)


def _keys(table: Table, column: str) -> Sequence[CellKey]:
    return table.keys(column) if column in table.columns else [float(r) for r in table.rows]


def _scalar(component: Component, columns: Mapping[ColumnMember, Sequence[CellKey]], position: int) -> Scalar:
    member = component.member
    key: CellKey | None = None
    if isinstance(member, LiteralMember):
        key = member.key
    elif isinstance(member, ColumnMember):
        cells = columns[member]
        key = cells[position if member.row is RowChoice.EACH else chosen_place(member.row, len(cells))]
    return component.unknown, key, component.index


def _unmatched(mentions: list[frozenset[Scalar]], scalars: list[Scalar]) -> list[Scalar]:
    """Numbers that no maximum matching gives an equation of its own."""
    of_scalar: dict[Scalar, list[int]] = {s: [] for s in scalars}
    for number, each in enumerate(mentions):
        for scalar in each:
            of_scalar[scalar].append(number)
    matching = _Matching()
    return [s for s in scalars if not _augment(s, of_scalar, matching)]


@dataclass(frozen=True, slots=True)
class _Matching:
    """Which scalar owns an equation, and the other way; ``closed`` equations can be freed by no path any more."""

    owner: dict[int, Scalar] = field(default_factory=dict)
    owned: dict[Scalar, int] = field(default_factory=dict)
    closed: set[int] = field(default_factory=set)


def _augment(start: Scalar, of_scalar: Mapping[Scalar, list[int]], matching: _Matching) -> bool:
    """Find an equation for ``start``, moving others along an augmenting path; breadth first.

    What a search in vain has seen stays out of reach whatever is matched later (Kuhn's Hungarian tree): it is closed,
    so that all searches in vain together look at each equation once.
    """
    came_from: dict[int, Scalar] = {}
    queue = [start]
    for scalar in queue:
        for equation in of_scalar[scalar]:
            if equation in came_from or equation in matching.closed:
                continue
            came_from[equation] = scalar
            if equation not in matching.owner:
                _shift(equation, start, came_from, matching)
                return True
            queue.append(matching.owner[equation])
    matching.closed.update(came_from)
    return False


def _shift(equation: int, start: Scalar, came_from: Mapping[int, Scalar], matching: _Matching) -> None:
    """Give each equation of the path to the scalar from which it was reached."""
    while True:
        scalar = came_from[equation]
        before = matching.owned.get(scalar)
        matching.owner[equation], matching.owned[scalar] = scalar, equation
        if scalar == start or before is None:
            return
        equation = before
