"""Tables: the measured values as they enter a problem, with where each of them came from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field, replace
from enum import StrEnum
from itertools import chain
from math import isfinite
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.problem.provenance import Provenance
from mbm.scales import Scale
from mbm.text.types import DataPlace, Diagnostic, MbmError, Span
from mbm.values import dataclass

Numbers: TypeAlias = NDArray[np.float64]
CellKey: TypeAlias = str | float
ROW = "row"
"""The name under which a row's number in its table, from 1, is known."""

EXTERNAL = "external"
"""The source of a table that the caller gives."""

UNION = "union"
"""The source of a table that is made of others, end to end."""

SOURCE = "source"
"""The column of such a table that says which of them a row is from."""

TIME = "t"
"""The column of times of a timed table, where none is named."""

POSITION = ("x", "y", "z")
"""The columns of a position, where none are named: as many of them as the table has."""

GAP_WORDS = frozenset({"", "NA"})
"""What stands in a cell without a value, blanks around it taken off; beside these ``nan`` is NaN in any case."""


def reads_as_number(cell: str) -> bool:
    """Whether the text of a cell is a decimal number, ``nan`` or ``inf``; digit groups such as ``1_000`` are not."""
    stripped = cell.strip()
    if "_" in stripped or not stripped.isascii():
        return False
    try:
        float(stripped)
    except ValueError:
        return False
    return True


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnGroup:
    """Columns that make a vector (shape (n,)) or matrix (shape (n, m)) in each row; ``columns`` has them row by row.

    A column may stand in several places, as in a symmetric matrix.
    """

    shape: tuple[int, ...]
    columns: tuple[str, ...]

    def renamed(self, names: Mapping[str, str]) -> ColumnGroup:
        """The group after its columns got other names."""
        return replace(self, columns=tuple(names.get(c, c) for c in self.columns))


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnDeclaration:
    """``(new old :unit u)`` of a data clause: the file's column ``old`` is called ``name`` and read in ``unit``."""

    name: str
    source: str
    unit: str | None
    scale: Scale
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class InlineTable:
    """``(table (col…) (value…)…)``: the cells as written (numbers already in SI), with the place of each row."""

    columns: tuple[str, ...]
    rows: tuple[tuple[float | str, ...], ...]
    spans: tuple[Span, ...]


class ArgumentKind(StrEnum):
    """What an argument of a source is: a whole number, a positive length in SI, a number, a word, or a path."""

    COUNT = "a whole number"
    LENGTH = "a length"
    NUMBER = "a number"
    WORD = "a word"
    FILE = "a path"


@dataclass(frozen=True, slots=True, kw_only=True)
class Argument:
    """What a source takes behind its path: by position, or as ``:name value`` where it is not ``required``.

    Numbers lie between ``least`` and ``most``; a word is one of ``choices``.
    """

    name: str
    kind: ArgumentKind
    required: bool = True
    default: float | str | None = None
    least: float = 0.0
    most: float = float("inf")
    choices: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """What a data clause may say of a format: the tables in a file of it, its arguments, the units of its columns.

    ``named``: the files of it call their tables as they like. ``of_part`` are the arguments that a data clause for one
    of the ``parts`` takes behind its name. Columns of ``lengths`` have the unit of the first argument that is a
    length, if it states one.
    """

    parts: tuple[str, ...] = ()
    of_part: Mapping[str, tuple[Argument, ...]] = field(default_factory=dict)
    named: bool = False
    arguments: tuple[Argument, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    lengths: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """A table that a union takes, and the place that names it."""

    name: str
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class TableDeclaration:
    """A ``data`` clause before anything is read. ``source`` names the reader (``csv``, ``external``, ``table`` …).

    ``part`` names the table of a format whose files hold several (``edges`` of a ``g2o``), ``arguments`` holds what
    the source says beside its path, by name, lengths in SI, ``members`` are the tables of a ``union``.
    """

    name: str
    source: str
    path: str | None
    part: str | None = None
    arguments: tuple[tuple[str, float | str], ...] = ()
    inline: InlineTable | None = None
    members: tuple[Member, ...] = ()
    key: str | None = None
    columns: tuple[ColumnDeclaration, ...] = ()
    skip_missing: bool = False
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class PairDeclaration:
    """A ``pair`` clause: rows of ``first`` and ``second`` at the same time of their columns ``by``.

    ``aliases`` begin the names of the columns of the two. ``tolerance`` in SI, None where the clause states none;
    ``interpolate``: the second table is taken at the first one's times. With ``steps`` both are one table, and rows are
    paired with later ones. No pair crosses a value of ``keys``, of which each table has some or none, nor one of
    ``passing`` (the columns of windows) with which the times of a table start anew. ``plain`` are names that the pair
    has for columns beside those with its aliases.
    """

    name: str
    first: str
    second: str
    aliases: tuple[str, str]
    by: str
    tolerance: float | None
    interpolate: bool
    steps: Steps | None = None
    keys: tuple[str, ...] = ()
    passing: tuple[str, ...] = ()
    plain: tuple[tuple[str, str], ...] = ()
    span: Span

    @property
    def sides(self) -> tuple[tuple[str, str], tuple[str, str]]:
        """The two aliases with their tables."""
        return (self.aliases[0], self.first), (self.aliases[1], self.second)

    @property
    def deciding(self) -> tuple[str, ...]:
        """The columns of the tables that decide which rows are paired."""
        timed = (self.by,) if self.steps is None or self.steps.kind is StepKind.TIME else ()
        return (*timed, *(() if self.steps is None else self.steps.along), *self.keys)


class StepKind(StrEnum):
    """What the step of a pair of a table with itself counts; the value is the word, for times any column's name."""

    ROWS = "row"
    TIME = "t"
    DISTANCE = "distance"


@dataclass(frozen=True, slots=True, kw_only=True)
class Steps:
    """How far a row stands behind the one it is paired with: ``step`` rows, or that much time or path, in SI.

    The path is that of the columns ``along``.
    """

    kind: StepKind
    step: float
    along: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """A column: float64 numbers in SI (``texts`` None) or texts (``numbers`` None).

    ``unit`` is the unit the data clause states, None if it states none. In a column of numbers NaN marks an empty cell;
    a NaN written in a file never gets this far unless the problem allows gaps. Where ``fault`` is set, the cells are
    neither numbers nor texts (empty texts stand for them): it is raised by whoever wants one of them.
    """

    name: str
    numbers: Numbers | None = field(default=None, repr=False)
    texts: tuple[str, ...] | None = field(default=None, repr=False)
    unit: str | None = None
    fault: Diagnostic | None = field(default=None, repr=False)

    @property
    def is_text(self) -> bool:
        """Whether the cells are texts."""
        return self.texts is not None

    @property
    def only_gaps(self) -> bool:
        """Whether no cell of a column of numbers holds one, of one at least."""
        held = self.numbers
        return held is not None and len(held) > 0 and bool(np.isnan(held[0])) and bool(np.isnan(held).all())

    def check(self) -> None:
        """Raise MbmError with the fault of the cells, if there is one."""
        if self.fault is not None:
            raise MbmError(self.fault)

    def cell(self, position: int) -> CellKey:
        """The cell at a position from 0."""
        self.check()
        if self.texts is not None:
            return self.texts[position]
        assert self.numbers is not None  # noqa: S101 - one of the two is always there
        return float(self.numbers[position])

    def first_text(self) -> int | None:
        """The position (from 0) of the cell that makes this a column of texts; None in a column of numbers.

        It is the first cell that neither is a gap nor reads as a number. Where there is none it is the first that reads
        as no finite one (the word ``nan`` in the text of a problem), else (texts such as ``"1"`` in a JSON file) the
        first cell.
        """
        self.check()
        if not self.texts:
            return None
        filled = [(i, t) for i, t in enumerate(self.texts) if t.strip() not in GAP_WORDS]
        culprits = (i for i, t in filled if not reads_as_number(t))
        infinite = (i for i, t in filled if reads_as_number(t) and not isfinite(float(t)))
        return next(chain(culprits, infinite), 0)

    def take(self, positions: NDArray[np.int64]) -> Column:
        """The column of the rows at ``positions`` (from 0)."""
        if self.texts is not None:
            texts = self.texts
            return replace(self, texts=tuple(texts[i] for i in positions))
        assert self.numbers is not None  # noqa: S101 - one of the two is always there
        return replace(self, numbers=self.numbers[positions])


def first_fault(columns: Iterable[Column]) -> Diagnostic | None:
    """Why one of several columns cannot be used."""
    return next((column.fault for column in columns if column.fault is not None), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table: columns of one length.

    ``rows`` holds, for each row kept, its number (from 1) in the unfiltered table; ``key`` is the name of the column
    whose cells name the rows. Columns that came in through ``:with`` are called ``alias.column``. ``groups`` are the
    columns that make a vector or matrix together, by its name. ``gaps`` has the rows that ``:missing skip`` left out.
    """

    name: str
    columns: Mapping[str, Column]
    rows: NDArray[np.int64] = field(repr=False)
    provenance: Provenance
    key: str | None = None
    groups: Mapping[str, ColumnGroup] = field(default_factory=dict)
    gaps: Table | None = field(default=None, repr=False)

    def __len__(self) -> int:
        return len(self.rows)

    def groups_called(self, alias: str) -> dict[str, ColumnGroup]:
        """The groups of columns where the columns are called ``alias.column``."""
        names = {name: f"{alias}.{name}" for name in self.columns}
        return {f"{alias}.{name}": group.renamed(names) for name, group in self.groups.items()}

    def take(self, positions: NDArray[np.int64]) -> Table:
        """The table of the rows at ``positions`` (from 0), in that order."""
        taken = {name: column.take(positions) for name, column in self.columns.items()}
        return replace(self, columns=taken, rows=self.rows[positions])

    def place(self, position: int, column: str | None = None) -> DataPlace:
        """Where the row at ``position`` (from 0) stands in its file."""
        return self.provenance.place(int(self.rows[position]), column)

    def source(self, position: int) -> Provenance:
        """The file that the row at ``position`` (from 0) was read from."""
        return self.provenance.source(int(self.rows[position]))

    def numbers(self, column: str) -> Numbers:
        """A column of numbers, shape (rows,)."""
        numbers = self.columns[column].numbers
        if numbers is None:
            raise KeyError(column)
        return numbers

    def keys_of_rows(self, rows: Iterable[int]) -> tuple[CellKey | None, ...] | None:
        """The keys of rows, which count as in the file; None: such a row is left out, or for all: there is no key."""
        if self.key is None:
            return None
        return tuple(map(dict(zip(self.rows.tolist(), self.keys(), strict=True)).get, rows))

    def keys(self, column: str | None = None) -> Sequence[CellKey]:
        """The cells of ``column`` (the key column if not named) as hashable values; rows' numbers if there is none."""
        name = column if column is not None else self.key
        if name is None:
            return [float(r) for r in self.rows]
        cells = self.columns[name]
        cells.check()
        return list(cells.texts) if cells.texts is not None else self.numbers(name).tolist()
