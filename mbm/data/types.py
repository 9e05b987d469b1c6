"""Values of the data stage: what a reader is, and what it hands over."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import field
from pathlib import Path
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from mbm.problem.provenance import Part, Provenance
from mbm.problem.tables import Argument, Column, ColumnGroup, Format
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class RawTable:
    """A table as its origin has it: no column renamed, no unit applied, no row left out.

    ``path`` is what messages print, ``sha256`` the digest of the file's bytes in hexadecimal (None without a file).
    All columns have the length of ``file_rows``, which holds each row's number as in the origin (header = 1; formats
    without a header count their records from 1). ``key`` is the column that names the rows where the format says so,
    ``groups`` the columns that make a matrix or vector together, by its name; ``parts`` are the tables or
    files whose rows stand end to end, if there are several, ``remarks`` warnings about what was left out. ``inline``:
    it stands in the text of the problem.
    """

    path: str
    sha256: str | None
    columns: tuple[Column, ...]
    file_rows: NDArray[np.int64] = field(repr=False)
    key: str | None = None
    groups: Mapping[str, ColumnGroup] = field(default_factory=dict)
    parts: tuple[Part, ...] = field(default=(), repr=False)
    remarks: tuple[Diagnostic, ...] = field(default=(), repr=False)
    inline: bool = False

    def provenance(self, source_columns: Mapping[str, str] | None = None) -> Provenance:
        """Where its rows stand; ``source_columns`` are its names of columns that have others now."""
        return Provenance(
            path=self.path,
            sha256=self.sha256,
            rows=len(self.file_rows),
            file_rows=self.file_rows,
            source_columns=source_columns or {},
            parts=self.parts,
            remarks=self.remarks,
            inline=self.inline,
        )


class GivenColumns(dict[str, object]):
    """Columns by name as a caller may give them, with the key and the groups that a format said they have."""

    def __init__(self, columns: Mapping[str, object], key: str | None, groups: Mapping[str, ColumnGroup]) -> None:
        super().__init__(columns)
        self.key = key
        self.groups = groups


@dataclass(frozen=True, slots=True, kw_only=True)
class Reader:
    """A file format: its name in a data clause, the endings of its files (``.csv``, lower case) and how to read it.

    ``read`` takes the path as messages shall print it, reads the file once, and raises MbmError for whatever is wrong.
    """

    name: str
    extensions: tuple[str, ...]
    read: Callable[[Path], RawTable]


def untold(table: RawTable, _arguments: Mapping[str, float | str]) -> RawTable:
    """The table as it was read: the format takes no arguments."""
    return table


@dataclass(frozen=True, slots=True, kw_only=True)
class ManyReader:
    """A format whose files hold several tables: ``(g2o "path" :edges)`` asks for the one called ``edges``.

    ``read`` takes the path as messages shall print it, reads the file once, and gives all tables by the names
    ``parts``; an MbmError in the place of a table is raised when it is asked for. ``members`` are the files
    that it may open where the path is that of a folder, by their names; none where the path is that of a file.
    ``named``: a table is asked for by a text that the file decides, or none: ``(opencv "path" "node")``.
    ``of_part`` are the arguments that a data clause for a table takes, ``told`` what they make of it.
    """

    name: str
    extensions: tuple[str, ...]
    parts: tuple[str, ...]
    read: Callable[[Path], Mapping[str, RawTable | MbmError]]
    members: tuple[str, ...] = ()
    named: bool = False
    of_part: Mapping[str, tuple[Argument, ...]] = field(default_factory=dict)
    told: Callable[[RawTable, Mapping[str, float | str]], RawTable] = untold

    def part(self, name: str) -> Reader:
        """The reader of one of the tables alone."""

        def read(path: Path) -> RawTable:
            return asked(self.read(path)[name])

        return Reader(name=self.name, extensions=self.extensions, read=read)


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageReader:
    """A format of images: one image, or all that a pattern names, and what the data clause says of them, make a table.

    ``format`` says which arguments there are. ``read`` takes the paths as messages shall print them, in the order of
    their names, by what rows of each are told by; the path or pattern of the data clause; and the arguments by name.
    It raises MbmError for what is wrong.
    """

    name: str
    extensions: tuple[str, ...]
    format: Format
    read: Callable[[Mapping[str, Path], str, Mapping[str, float | str]], RawTable]


AnyReader: TypeAlias = Reader | ManyReader | ImageReader
"""How a format may be read."""


def asked(table: T | MbmError) -> T:
    """The table, or what else was to be read; raises what is in its place."""
    if isinstance(table, MbmError):
        raise table
    return table


class Formats(Mapping[str, Format]):
    """The formats that readers know: what a data clause may say of each."""

    def __init__(self, readers: Mapping[str, AnyReader]) -> None:
        self._readers = readers

    def __getitem__(self, name: str) -> Format:
        reader = self._readers[name]
        if isinstance(reader, ImageReader):
            return reader.format
        if isinstance(reader, ManyReader):
            return Format(parts=reader.parts, named=reader.named, of_part=reader.of_part)
        return Format()

    def __contains__(self, name: object) -> bool:
        return name in self._readers

    def __iter__(self) -> Iterator[str]:
        return iter(self._readers)

    def __len__(self) -> int:
        return len(self._readers)
