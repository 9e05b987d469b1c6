"""NumPy expressions for cells of the tables: ``t`` has the tables, ``f`` what was found in them, ``row`` the rows."""

from __future__ import annotations

from mbm.emit.foreign import Foreign
from mbm.emit.python.text import literal
from mbm.emit.types import Blueprint, Choice, ColumnValue, InputValue, Key, LiteralKey
from mbm.values import dataclass


@dataclass(frozen=True, slots=True)
class Cells:
    """Texts for the cells of one problem."""

    blueprint: Blueprint

    def row_of(self, value: ColumnValue, row: str) -> str:
        """The rows that cells stand in."""
        if value.place.choice is not Choice.HERE:
            row = f"f[{literal(value.place.choice.value, ' of ', value.place.table)}]"
        for number in value.place.links:
            row = self.linked(number, row)
        return row

    def linked(self, number: int, row: str) -> str:
        """What a link leads to."""
        link = self.blueprint.links[number]
        return f"f[{link.identifier!r}][{row if link.table is not None else 0}]"

    def cell(self, value: ColumnValue, row: str = "row") -> str:
        """The cells of the rows."""
        place = self.row_of(value, row)
        if value.column is None:
            return f"({place} + 1.0)"
        return f"t[{literal(value.owner)}][{literal(value.column)}][{place}]"

    def input(self, value: InputValue, row: str = "row") -> str:
        """What a kernel or program takes for the rows."""
        if isinstance(value, ColumnValue):
            return self.cell(value, row)
        constant = next(c for c in self.blueprint.constants if c.name == value.name)
        return f"CONSTANTS[{literal(constant.name)}]"

    def key(self, cell: ColumnValue | LiteralKey, row: str = "row") -> str:
        """The keys of the rows."""
        return f"[{key(cell.key)}]" if isinstance(cell, LiteralKey) else self.cell(cell, row)

    def is_text(self, value: ColumnValue) -> bool:
        """Whether cells are texts."""
        return value.column is not None and self.blueprint.table(value.owner).column(value.column).is_text


def key(value: Key) -> str:
    """What a cell holds."""
    return literal(value) if isinstance(value, Foreign) else repr(value)
