"""Programs as LLVM functions over tables: rows one behind the other, turned into vectors of rows and back in registers.

`blocks_of_rows` is for solvers, which gather their inputs anyway; this is for tables that NumPy holds.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from mbm.machine.blocks_of_rows import ALIGNMENT, close_function, close_loop, open_loop, place
from mbm.machine.kinds import LANES
from mbm.machine.program import Program
from mbm.machine.vector_text import VECTOR, Text, VectorLibrary
from mbm.machine.vectors import outputs_of
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A program whose first ``split`` outputs go to one table and the others to another."""

    program: Program
    split: int


def module_of(tables: Mapping[str, Table], library: VectorLibrary | None) -> str:
    """A module with a function for each program.

    ``void name(const double *inputs, double *first, double *second, int64 blocks)`` evaluates ``blocks`` times `LANES`
    rows: ``inputs`` (rows, inputs), ``first`` (rows, split), ``second`` (rows, outputs - split), row by row.

    Args:
        tables: by the names of their functions.
        library: the vector library to call, if any.
    """
    text = Text(library)
    for name, table in tables.items():
        _function(name, table, text)
    return text.module()


def _function(name: str, table: Table, text: Text) -> None:
    program = table.program
    arrays = "ptr noalias readonly %inputs, ptr noalias %first, ptr noalias %second"
    text.lines.append(f"define void @{name}({arrays}, i64 %blocks) nounwind {{")
    open_loop(text)
    inputs = _loaded(text, len(program.inputs))
    outputs = outputs_of(program, inputs, text)
    _store(text, "%first", outputs[: table.split])
    _store(text, "%second", outputs[table.split :])
    close_loop(text)
    close_function(text)


def _groups(width: int) -> Iterator[tuple[int, int]]:
    """Columns in groups that fill a vector: first column, and how many."""
    for first in range(0, width, LANES):
        yield first, min(LANES, width - first)


def _part(count: int) -> str:
    return "double" if count == 1 else f"<{count} x double>"


def _lanes(lanes: tuple[int, ...]) -> str:
    return f"<{len(lanes)} x i32> <{', '.join(f'i32 {lane}' for lane in lanes)}>"


def _loaded(text: Text, width: int) -> list[str]:
    """The columns of a block of rows as vectors."""
    source = place(text, "%inputs", f"mul i64 %block, {width * LANES}")
    columns: list[str] = []
    for first, count in _groups(width):
        rows = []
        for row in range(LANES):
            where = text.new(f"getelementptr inbounds double, ptr {source}, i64 {row * width + first}")
            part = text.new(f"load {_part(count)}, ptr {where}, align {ALIGNMENT}")
            rows.append(_widened(text, part, count))
        columns += _transposed(text, rows)[:count]
    return columns


def _widened(text: Text, part: str, count: int) -> str:
    if count == 1:
        return text.new(f"insertelement {VECTOR} undef, double {part}, i32 0")
    if count == LANES:
        return part
    lanes = _lanes(tuple(min(lane, count) for lane in range(LANES)))
    return text.new(f"shufflevector {_part(count)} {part}, {_part(count)} undef, {lanes}")


def _store(text: Text, array: str, columns: list[str]) -> None:
    """Vectors as the columns of a block of rows."""
    width = len(columns)
    target = place(text, array, f"mul i64 %block, {width * LANES}")
    for first, count in _groups(width):
        held = columns[first : first + count]
        rows = _transposed(text, held + ["undef"] * (LANES - count))
        for row in range(LANES):
            where = text.new(f"getelementptr inbounds double, ptr {target}, i64 {row * width + first}")
            part = _narrowed(text, rows[row], count)
            text.do(f"store {_part(count)} {part}, ptr {where}, align {ALIGNMENT}")


def _narrowed(text: Text, row: str, count: int) -> str:
    if count == 1:
        return text.new(f"extractelement {VECTOR} {row}, i32 0")
    if count == LANES:
        return row
    return text.new(f"shufflevector {VECTOR} {row}, {VECTOR} undef, {_lanes(tuple(range(count)))}")


def _transposed(text: Text, rows: list[str]) -> list[str]:
    """Four vectors of four, rows and columns exchanged: pairs first, then halves."""

    def mixed(a: str, b: str, lanes: tuple[int, ...]) -> str:
        return text.new(f"shufflevector {VECTOR} {a}, {VECTOR} {b}, {_lanes(lanes)}")

    low, high = (0, 1, 4, 5), (2, 3, 6, 7)
    even, odd = (0, 4, 2, 6), (1, 5, 3, 7)
    pairs = [mixed(rows[i], rows[i + 1], lanes) for i in (0, 2) for lanes in (even, odd)]
    return [
        mixed(pairs[0], pairs[2], low),
        mixed(pairs[1], pairs[3], low),
        mixed(pairs[0], pairs[2], high),
        mixed(pairs[1], pairs[3], high),
    ]
