"""C expressions for cells of the tables, and calls of the programs of data."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.text import literal
from mbm.emit.foreign import Foreign
from mbm.emit.types import (
    BlockCase,
    Blueprint,
    CaseProgram,
    Choice,
    ColumnValue,
    InputValue,
    Key,
    LiteralKey,
    RowPrograms,
    SlotPlace,
)
from mbm.machine.c import number
from mbm.values import dataclass


@dataclass(frozen=True, slots=True)
class Cells:
    """Texts for the cells of one problem; the variable ``row`` holds the row at hand, ``f`` the frame."""

    blueprint: Blueprint

    def rows(self, table: Foreign) -> str:
        """The number of rows of a table."""
        return f"data->{self.blueprint.table(table).identifier}_rows"

    def row_of(self, value: ColumnValue, row: str = "row") -> str:
        """The row that a cell stands in."""
        table = self.blueprint.table(value.place.table)
        if value.place.choice is Choice.FIRST:
            row = f"f->first_of_{table.identifier}"
        elif value.place.choice is Choice.LAST:
            row = f"f->last_of_{table.identifier}"
        for link_number in value.place.links:
            link = self.blueprint.links[link_number]
            row = f"f->{link.identifier}[{row if link.table is not None else 0}]"
        return row

    def member(self, link_number: int) -> str:
        """The member that a link names for the row at hand."""
        link = self.blueprint.links[link_number]
        return f"f->{link.identifier}[{'row' if link.table is not None else 0}]"

    def slot(self, slot: SlotPlace, origin: str) -> str:
        """Where a number of an unknown stands, or with ``firsts`` as origin a coordinate of it."""
        unknown = self.blueprint.unknowns[slot.unknown]
        width = unknown.size if origin == "offsets" else unknown.freedom
        member = "" if slot.member is None else f" + {self.member(slot.member)} * {width}"
        component = f" + {slot.component}" if slot.component else ""
        return f"f->{origin}[{slot.unknown}]{member}{component}"

    def column(self, table: Foreign, name: Foreign) -> str:
        """The array of a column."""
        shape = self.blueprint.table(table)
        return f"data->{shape.identifier}_{shape.column(name).identifier}"

    def cell(self, value: ColumnValue, row: str = "row") -> str:
        """A cell: a number or a text."""
        place = self.row_of(value, row)
        if value.column is None:
            return f"(double)({place} + 1)"
        return f"{self.column(value.owner, value.column)}[{place}]"

    def moves(self, value: InputValue) -> bool:
        """Whether a number or text is that of the row at hand."""
        return isinstance(value, ColumnValue) and self.cell(value, "row") != self.cell(value, "another")

    def reads(self, case: BlockCase) -> bool:
        """Whether the parameters, the noise or the test of a case take something of the row at hand."""
        noise = () if case.noise is None else case.noise.inputs
        return any(map(self.moves, (*(value for value, _ in case.static), *case.parameters, *noise)))

    def is_text(self, value: ColumnValue) -> bool:
        """Whether a cell is a text."""
        return value.column is not None and self.blueprint.table(value.owner).column(value.column).is_text

    def equals(self, value: ColumnValue, key: Key) -> str:
        """The condition that a cell holds a key."""
        if isinstance(key, Foreign):
            return f"strcmp({self.cell(value)}, {literal(key)}) == 0"
        return f"{self.cell(value)} == {number(float(key))}"

    def input(self, value: InputValue) -> str:
        """A number that a kernel or program takes."""
        if isinstance(value, ColumnValue):
            return self.cell(value)
        constant = next(c for c in self.blueprint.constants if c.name == value.name)
        return f"constant_{constant.identifier}"

    def key(self, cell: ColumnValue | LiteralKey) -> tuple[str, bool]:
        """A key and whether it is a text."""
        if isinstance(cell, LiteralKey):
            if isinstance(cell.key, Foreign):
                return literal(cell.key), True
            return number(float(cell.key)), False
        return self.cell(cell), self.is_text(cell)

    def call(self, programs: RowPrograms, target: str, pad: str) -> Iterator[str]:
        """Statements that put what ``programs`` compute for the row at hand into ``target``."""
        many = len(programs.cases) > 1 or any(case.static for case in programs.cases)
        for position, case in enumerate(programs.cases):
            inner = pad
            if many:
                word = "if" if position == 0 else "} else if"
                tests = " && ".join(self.equals(v, key) for v, key in case.static) or "1"
                yield f"{pad}{word} ({tests}) {{"
                inner = pad + "    "
            yield from (
                *self.arguments(case, inner),
                f"{inner}{program_name(programs, position)}(inputs, {target});",
            )
        if many:
            yield from (
                f"{pad}}} else {{",
                f"{pad}    return {self.status('UNKNOWN_CASE')};",
                f"{pad}}}",
            )

    def arguments(self, case: CaseProgram, pad: str) -> Iterator[str]:
        """Statements that fill ``inputs``."""
        yield from (f"{pad}inputs[{position}] = {self.input(value)};" for position, value in enumerate(case.inputs))

    def status(self, word: str) -> str:
        """The name of a status."""
        return f"{self.blueprint.identifier.upper()}_{word}"

    def loop(self, table: Foreign | None) -> tuple[list[str], list[str]]:
        """What opens and closes a loop over the kept rows of a table; ``row`` is the row."""
        if table is None:
            return ["    {", "        const long row = 0;"], ["        (void)row;", "    }"]
        shape = self.blueprint.table(table)
        if shape.where is None:
            return [f"    for (row = 0; row < {self.rows(table)}; row++) {{"], ["    }"]
        return [
            f"    for (i = 0; i < f->kept_of_{shape.identifier}_count; i++) {{",
            f"        const long row = f->kept_of_{shape.identifier}[i];",
        ], ["    }"]


def program_name(programs: RowPrograms, position: int) -> str:
    """The function of a case."""
    return programs.identifier if len(programs.cases) == 1 else f"{programs.identifier}_{position + 1}"


def input_name(value: InputValue) -> Foreign:
    """What an input of a program of data is called."""
    if isinstance(value, ColumnValue):
        return value.column or Foreign("row")
    return value.name
