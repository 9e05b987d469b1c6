"""Leaves of expressions and inputs of kernels → where their numbers stand in the tables that a solver is given."""

from __future__ import annotations

from dataclasses import field

from mbm.emit.foreign import Foreign, told
from mbm.emit.identifiers import FAMILY_FORMS, LINK_FORMS, Identifiers
from mbm.emit.types import (
    Choice,
    ColumnValue,
    ConstantValue,
    FamilyShape,
    InputValue,
    Key,
    Link,
    LiteralKey,
    RowPlace,
)
from mbm.expression.nodes import Column, ColumnMember, Constant, Leaf, LiteralMember, Member
from mbm.expression.rows import Row, RowChoice
from mbm.problem.elaborated import Elaborated
from mbm.problem.tables import ROW, CellKey
from mbm.problem.types import Family, Join, Static
from mbm.symbolic.types import ConstantInput, Parameter
from mbm.values import dataclass


@dataclass(slots=True)
class Places:
    """Finds places and numbers the links that lead to them; local to one blueprint.

    ``families`` are by the name of the table that has one row for each member.
    """

    found: Elaborated
    names: Identifiers
    links: dict[tuple[object, ...], Link] = field(default_factory=dict)
    families: dict[tuple[str, str | None], FamilyShape] = field(default_factory=dict)

    def own_table(self, name: str) -> str:
        """The table that holds the rows of ``name``: that of the column, for the distinct values of one."""
        return self._column_of(name)[0]

    def distinct(self, name: str) -> tuple[ColumnValue, ...]:
        """The column whose distinct values ``name`` has one row for, if it is made of them."""
        table, column = self._column_of(name)
        return () if column is None else (self.cell(table, column),)

    def _column_of(self, name: str) -> tuple[str, str | None]:
        families = (u.family for u in self.found.problem.unknowns if u.family is not None and u.family.rows == name)
        made = next((family for family in families if family.column is not None), None)
        return (name, None) if made is None else (made.table, made.column)

    def cell(self, table: str, name: str, choice: Choice = Choice.HERE) -> ColumnValue:
        """The cell of column ``name``, as the equations call it, in the chosen row of a table."""
        links: list[int] = []
        owner, rest = table, name
        while True:
            join = self._join(owner, rest)
            if join is None:
                break
            links.append(self._joined(owner, join).number)
            owner, rest = join.table, rest.removeprefix(f"{join.alias}.")
        numbered = rest == ROW and ROW not in self.found.raw[owner].columns
        place = RowPlace(table=Foreign(table), choice=choice, links=tuple(links))
        return ColumnValue(place=place, owner=Foreign(owner), column=None if numbered else Foreign(rest))

    def _join(self, table: str, name: str) -> Join | None:
        if name in self.found.raw[table].columns:
            return None
        plan = next(p for p in self.found.problem.plans if p.name == table)
        return next((j for j in plan.joins if name.startswith(f"{j.alias}.")), None)

    def _joined(self, table: str, join: Join) -> Link:
        cell = self.cell(table, join.column)
        return self._link(table, cell, Foreign(join.table), _key(self.found, join.table), None, join.alias)

    def _link(
        self,
        table: str | None,
        cell: ColumnValue | LiteralKey,
        target: Foreign,
        key: Foreign | None,
        family: int | None,
        name: str,
    ) -> Link:
        identity = (table, cell, target, key, family)
        if identity not in self.links:
            self.links[identity] = Link(
                number=len(self.links),
                identifier=self.names.made(told(name, "_of_", table) if table else _named(name, cell), *LINK_FORMS),
                table=None if table is None else Foreign(table),
                cell=cell,
                target=target,
                key=key,
                family=family,
            )
        return self.links[identity]

    def family(self, family: Family) -> FamilyShape:
        """A family's shape, numbered."""
        identity = (family.rows, family.key)
        if identity not in self.families:
            self.families[identity] = FamilyShape(
                number=len(self.families),
                identifier=self.names.made(f"{family.rows}_members", *FAMILY_FORMS),
                table=Foreign(family.table),
                key=_foreign(family.column if family.column is not None else family.key),
                distinct=family.column is not None,
            )
        return self.families[identity]

    def member(self, unknown: str, member: Member | None, table: str | None) -> int | None:
        """The link to the member of an unknown's family that the row at hand names."""
        family = self.found.problem.unknown(unknown).family
        if member is None or family is None:
            return None
        shape = self.family(family)
        if isinstance(member, LiteralMember):
            return self._link(None, _literal(member), shape.table, shape.key, shape.number, unknown).number
        own = table if member.row is RowChoice.EACH else None
        cell = self.cell(own or member.table, member.column, _choice(member.row))
        return self._link(own, cell, shape.table, shape.key, shape.number, unknown).number

    def static(self, table: str | None, static: Static) -> tuple[tuple[ColumnValue, Key], ...]:
        """The cells of the row at hand that decide which case it is, with their values."""
        if table is None:
            return ()
        return tuple((self.cell(table, name), _told_apart(value)) for name, value in static)

    def column(self, column: Column, table: str | None) -> InputValue:
        """Where a column of an expression or kernel stands, seen from a row of ``table``."""
        if column.row is RowChoice.KEYED and column.member is not None:
            return self._keyed(column.table, column.name, column.member, table)
        owner = self.own_table(column.table)
        here = column.row is RowChoice.EACH and table is not None and owner == table
        return self.cell(owner, column.name, Choice.HERE if here else _choice(column.row))

    def _keyed(self, owner: str, name: str, member: Member, table: str | None) -> ColumnValue:
        cell: ColumnValue | LiteralKey
        own: str | None = None
        if isinstance(member, LiteralMember):
            cell = _literal(member)
        elif isinstance(member, ColumnMember):
            own = table if member.row is RowChoice.EACH else None
            cell = self.cell(own or member.table, member.column, _choice(member.row))
        link = self._link(own, cell, Foreign(owner), _key(self.found, owner), None, owner)
        target = self.cell(owner, name)
        place = RowPlace(table=Foreign(own or owner), choice=Choice.HERE, links=(link.number, *target.place.links))
        return ColumnValue(place=place, owner=target.owner, column=target.column)

    def leaf(self, table: str | None) -> _LeafPlaces:
        """Where the leaves of expressions about the rows of ``table`` stand."""
        return _LeafPlaces(self, table)

    def parameter(self, parameter: Parameter, table: str | None) -> InputValue:
        """Where a parameter of a kernel stands."""
        if isinstance(parameter, ConstantInput):
            return ConstantValue(name=Foreign(parameter.name))
        node = Column(parameter.table, parameter.name, parameter.row, member=parameter.member)
        return self.column(node, table)


@dataclass(frozen=True, slots=True)
class _LeafPlaces:
    """`PlaceOf` for the rows of one table."""

    places: Places
    table: str | None

    def __call__(self, leaf: Leaf) -> InputValue:
        if isinstance(leaf, Constant):
            return ConstantValue(name=Foreign(leaf.name))
        if not isinstance(leaf, Column):
            raise TypeError(leaf)
        return self.places.column(leaf, self.table)


def _choice(row: Row) -> Choice:
    """Outside of a table of its own a column is that of the last row, unless the first is asked for."""
    return Choice.HERE if row is RowChoice.EACH else Choice.FIRST if row is RowChoice.FIRST else Choice.LAST


def _named(name: str, cell: ColumnValue | LiteralKey) -> Foreign:
    """What a link that holds for all rows is called: by what it looks for."""
    if isinstance(cell, ColumnValue):
        return told(name, f"_{cell.place.choice}_", cell.owner)
    return told(name, "_", cell.key if isinstance(cell.key, Foreign) else str(cell.key))


def _foreign(name: str | None) -> Foreign | None:
    return None if name is None else Foreign(name)


def _key(found: Elaborated, table: str) -> Foreign | None:
    """The column whose cells name the rows of a table."""
    return _foreign(found.raw[table].key)


def _literal(member: LiteralMember) -> LiteralKey:
    return LiteralKey(key=_told_apart(member.key))


def _told_apart(key: CellKey) -> Key:
    return Foreign(key) if isinstance(key, str) else key
