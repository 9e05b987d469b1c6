"""``(union A B …)``: which tables may be put end to end, and what their units have to do with one another."""

from __future__ import annotations

from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter

from mbm.expression.dimension import Dimension
from mbm.expression.units import parse_unit
from mbm.language import faults as language_faults
from mbm.problem import faults
from mbm.problem.reading.sources import DataClause
from mbm.problem.tables import Member, Table
from mbm.text.types import Diagnostic, Label, MbmError, Span


def check_members(clauses: Mapping[str, DataClause]) -> None:
    """Check that unions take tables which there are, as they are read, and not themselves.

    Raises:
        MbmError: unknown-table, union-of-chosen-rows, circular-definition.

    """
    found: list[Diagnostic] = []
    for clause in clauses.values():
        for member in clause.declaration.members:
            other = clauses.get(member.name)
            if other is None:
                found.append(faults.unknown_table(member.span, member.name, tuple(clauses)))
            elif other.where is not None or other.joins:
                option = ":where" if other.where is not None else ":with"
                found.append(faults.union_of_chosen_rows(member, option, clause.declaration.name))
    if found:
        raise MbmError(*found)
    members = {name: [member.name for member in each.declaration.members] for name, each in clauses.items()}
    try:
        TopologicalSorter(members).prepare()
    except CycleError as error:
        circle = tuple(error.args[1])
        raise MbmError(language_faults.circular_definition(clauses[circle[0]].declaration.span, circle)) from None


def check_units(clauses: Mapping[str, DataClause], raw: Mapping[str, Table]) -> None:
    """Check that a column has one dimension in all tables of a union, and that only one clause states its unit.

    Raises:
        MbmError: unit-clash, mixed-units.

    """
    for clause in clauses.values():
        stated: dict[str, tuple[Dimension, str, Span]] = {}
        for member in clause.declaration.members:
            for name, column in raw[member.name].columns.items():
                unit = parse_unit(column.unit) if column.unit is not None else None
                if unit is None or column.unit is None:
                    continue
                place = _stated(clauses[member.name], name, member)
                first = stated.setdefault(name, (unit.dimension, column.unit, place))
                if first[0] != unit.dimension:
                    labels = (Label(first[2], f"in `{first[1]}` here"), Label(place, f"in `{column.unit}` here"))
                    what = f"column `{name}` of `{member.name}` in `{column.unit}`"
                    other = f"that of the tables before in `{first[1]}`"
                    raise MbmError(faults.unit_clash(member.span, what, other, labels))
        for declared in clause.declaration.columns:
            if declared.unit is not None and declared.source in stated:
                place = stated[declared.source][2]
                raise MbmError(faults.unit_given_twice(declared.span, declared.source, place, "a table of the union"))


def _stated(clause: DataClause, column: str, member: Member) -> Span:
    """Where the unit of a column of a member is stated: in its clause, or, of a union, wherever that takes it from."""
    declared = (each.span for each in clause.declaration.columns if each.name == column and each.unit is not None)
    return next(declared, member.span)
