"""Kernels and the programs of data as Python functions of arrays.

NumPy expressions for cells of the tables: ``t`` has the tables, ``f`` what was found in them, ``row`` the rows.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from textwrap import wrap

from mbm.emit.c.cells import input_name
from mbm.emit.foreign import Foreign, Word, told
from mbm.emit.identifiers import RESERVED
from mbm.emit.python.text import WIDTH, docstring, literal, remark
from mbm.emit.statements import ARITHMETIC, Dialect, Shape, called, statements
from mbm.emit.types import BlockCase, Blueprint, Choice, ColumnValue, InputValue, Key, LiteralKey, RowPrograms
from mbm.machine.program import Operator, Program
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


def key(value: Key) -> str:
    """What a cell holds."""
    return literal(value) if isinstance(value, Foreign) else repr(value)


_COMPARED: Mapping[Operator, str] = {
    Operator.LESS: "<",
    Operator.LESS_EQUAL: "<=",
    Operator.EQUAL: "==",
    Operator.NOT_EQUAL: "!=",
}
_SHAPES: Mapping[Operator, Shape] = {
    **{o: called(f"np.{o.numpy}", o) for o in Operator},
    **ARITHMETIC,
    **{o: Shape(f"1.0 * ({{0}} {sign} {{1}})", 6, (5, 5)) for o, sign in _COMPARED.items()},
    Operator.NOT: Shape("1.0 * ({0} == 0.0)", 6, (5,)),
    Operator.AND: Shape("1.0 * (({0} != 0.0) & ({1} != 0.0))", 6, (5, 5)),
    Operator.OR: Shape("1.0 * (({0} != 0.0) | ({1} != 0.0))", 6, (5, 5)),
    Operator.SELECT: Shape("np.where({0} != 0.0, {1}, 0.0)", 9, (5, 0)),
    Operator.ERF: called("error_function", Operator.ERF),
    Operator.REMAINDER: Shape("{0} - {1} * np.rint({0} / {1})", 5, (7, 9)),
}


def function(name: str, program: Program, names: Sequence[Foreign], doc: Iterable[Word]) -> str:
    """``name(inputs, outputs)``: one array over the rows for each input; one line of ``outputs`` for each output."""
    made = statements(program, names, DIALECT)
    lines = [f"def {name}(inputs: Sequence[Array], outputs: Array) -> None:", *docstring(doc)]
    for identifier, position in made.inputs:
        shown = "" if names[position] == Foreign(identifier) else f"  {remark(names[position])}"
        lines.append(f"    {identifier} = inputs[{position}]{shown}")
    for left, right in made.assignments:
        lines += _wrapped(f"    {left} = {right}")
    for position, text in enumerate(made.outputs):
        lines += _wrapped(f"    outputs[{position}] = {text}")
    return "\n".join(lines)


def _wrapped(line: str) -> Iterator[str]:
    """A statement without strings or comments, a long one in parentheses over several lines."""
    if len(line) <= WIDTH:
        yield line
        return
    left, right = line.split(" = ", 1)
    yield from (
        f"{left} = (",
        *wrap(
            right,
            WIDTH,
            initial_indent=" " * 8,
            subsequent_indent=" " * 8,
            break_long_words=False,
            break_on_hyphens=False,
        ),
        "    )",
    )


def kernel_functions(case: BlockCase) -> str:
    """The values of a kernel, and the values with the nonzeros of their Jacobian behind them."""
    head: list[Word] = [f"{case.identifier}: what should be zero in each row.", ""]
    head += [told("    ", line) for line in case.text]
    slopes = [f"{case.identifier}: the same, and behind it the derivatives that are not zero everywhere."]
    values = function(f"{case.identifier}_values", case.kernel.value_program, case.input_names, head)
    jacobian = function(f"{case.identifier}_jacobian", case.kernel.jacobian_program, case.input_names, slopes)
    return f"{values}\n\n\n{jacobian}"


def derived_function(name: Foreign, case: BlockCase) -> str:
    """A quantity ``name`` that is computed from the estimates, and the nonzeros of its Jacobian behind it."""
    lines: list[Word] = [told(name, ", and behind it its derivatives that are not zero everywhere."), ""]
    lines += [told("    ", line) for line in case.text]
    return function(f"{case.identifier}_derived", case.kernel.jacobian_program, case.input_names, lines)


def rows_function(blueprint: Blueprint, programs: RowPrograms, words: Word) -> str:
    """The functions of programs of data, and one that computes them for rows: (width, rows)."""
    cells = Cells(blueprint)
    parts = []
    lines = [
        f"def {programs.identifier}(t: Tables, f: Found, row: Indices) -> Array:",
        *docstring([told(words, ".")]),
        f"    outputs = np.full(({programs.width}, len(row)), np.nan)",
    ]
    for position, case in enumerate(programs.cases):
        name = f"{programs.identifier}_{position + 1}"
        parts.append(function(name, case.program, [input_name(v) for v in case.inputs], [told(words, ".")]))
        tests = "".join(f" & ({cells.cell(value)} == {key(wanted)})" for value, wanted in case.static)
        lines += [
            f"    chosen = np.ones(len(row), dtype=bool){tests}",
            f"    part = np.empty(({programs.width}, int(chosen.sum())))",
        ]
        inputs = ", ".join(cells.input(v, "row[chosen]") for v in case.inputs)
        lines += [
            '    with np.errstate(all="ignore"):',
            f"        {name}([{inputs}], part)",
            "    outputs[:, chosen] = part",
        ]
    return "\n\n\n".join([*parts, "\n".join([*lines, "    return outputs"])])


def number(value: float) -> str:
    """A number with all its digits."""
    if value - value == 0.0:
        return repr(float(value))
    return "np.nan" if value != value else ("np.inf" if value > 0.0 else "-np.inf")


DIALECT = Dialect(shapes=_SHAPES, number=number, reserved=RESERVED | {"error_function"})
