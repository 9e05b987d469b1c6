"""Tables of the same columns → one, end to end, with the column ``source`` that says where a row is from. Paths with
``*`` or ``?`` in the name of the file: which files they mean, and what a row of each is told by.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from fnmatch import translate
from pathlib import Path
from re import compile as compiled

import numpy as np
from numpy.typing import NDArray

from mbm.data.cells import frozen, unreadable
from mbm.data.content import COMPRESSED
from mbm.data.types import RawTable
from mbm.data.union import faults
from mbm.files.faults import unreadable_file
from mbm.problem.provenance import Part, Provenance
from mbm.problem.tables import SOURCE, Column, ColumnGroup, Table, first_fault
from mbm.text.types import DataPlace, Diagnostic, MbmError, Place
from mbm.values import dataclass

WILD = "*?"

MOST_MATCHES = 1000
"""Files that one pattern may fit."""


def is_pattern(path: str) -> bool:
    """Whether a path, as it is written, names files by a pattern; brackets are characters of a name."""
    return any(wild in path for wild in WILD)


def matching(base: Path, path: str, place: Place) -> dict[str, Path]:
    """The files that fit, in the order of their names, by what their rows are told by; a path without pattern is one.

    ``path`` is relative to ``base``. A name that begins with a point fits only a pattern that does. Nothing is opened.

    Raises:
        MbmError: bad-pattern, no-match, too-many-matches, unreadable-file.

    """
    pattern = base / path
    shown = pattern.as_posix()
    if not is_pattern(path):
        return {source_of(pattern): pattern}
    if is_pattern(str(Path(path).parent)):
        raise MbmError(faults.pattern_in_folder(place, shown))
    fits = compiled(translate(pattern.name.replace("[", "[[]"))).match
    hidden = pattern.name.startswith(".")
    names = []
    try:
        with os.scandir(pattern.parent) as entries:
            for entry in entries:
                if fits(entry.name) and (hidden or not entry.name.startswith(".")):
                    names.append(entry.name)
                if len(names) > MOST_MATCHES:
                    raise MbmError(faults.too_many_matches(place, shown, MOST_MATCHES))
    except (FileNotFoundError, NotADirectoryError, ValueError):  # a NUL in the name of the folder
        raise MbmError(faults.no_match(place, shown, folder=False)) from None
    except OSError as error:
        raise MbmError(unreadable_file(pattern.parent, error.strerror or type(error).__name__, place)) from None
    if not names:
        raise MbmError(faults.no_match(place, shown, folder=True))
    found: dict[str, Path] = {}
    for name in sorted(names):
        file = pattern.with_name(name)
        source = source_of(file)
        if source in found:
            raise MbmError(faults.same_source(place, found[source].name, name, source))
        found[source] = file
    return found


def source_of(path: Path) -> str:
    """The name of a file without folder and ending, of a packed one without the ending before it either."""
    bare = path.stem if path.suffix.lower() in COMPRESSED else path.name
    return os.fsencode(Path(bare).stem).decode("utf-8", errors="replace")


def shot_of(pattern: str, path: Path) -> str:
    """What ``*`` and ``?`` of a pattern stand for in the name of a file that fits; without any, as `source_of`.

    So `left07.jpg` and `right07.jpg`, by the patterns `left*.jpg` and `right*.jpg`, are told by the same text `07`.
    """
    own = Path(pattern).name
    first = min((own.find(sign) for sign in "*?" if sign in own), default=len(own))
    last = max(own.rfind(sign) for sign in "*?") + 1
    stands = path.name[first : len(path.name) - (len(own) - last)] if last else ""
    return os.fsencode(stands).decode("utf-8", errors="replace") or source_of(path)


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """A table that goes into a union; its rows have ``sources`` (n,) in the column ``source``.

    ``rows`` (n,) are the numbers of its rows, from 1, by which ``provenance`` knows their places.
    """

    name: str
    sources: tuple[str, ...] = field(repr=False)
    columns: Mapping[str, Column]
    provenance: Provenance
    rows: NDArray[np.int64]
    groups: Mapping[str, ColumnGroup]

    @property
    def beginning(self) -> DataPlace:
        """The place of the table as a whole: of one in the text of a problem, its first row."""
        first = self.provenance.place(int(self.rows[0])) if len(self.rows) else None
        return first if first is not None and first.number else DataPlace(file=self.provenance.path)


def piece_of_file(name: str, raw: RawTable) -> Piece:
    """A file as it was read."""
    provenance = raw.provenance()
    columns = {column.name: column for column in raw.columns}
    rows = np.arange(1, len(raw.file_rows) + 1)
    sources = (name,) * len(rows)
    return Piece(name=name, sources=sources, columns=columns, provenance=provenance, rows=rows, groups=raw.groups)


def piece_of_table(table: Table) -> Piece:
    """A table with its own names and units. The rows of one that is put together already keep their sources."""
    columns, sources = dict(table.columns), (table.name,) * len(table.rows)
    if table.provenance.parts and (known := columns.pop(SOURCE, None)) is not None and known.texts is not None:
        sources = known.texts
    return Piece(
        name=table.name,
        sources=sources,
        columns=columns,
        provenance=table.provenance,
        rows=table.rows,
        groups=table.groups,
    )


def united(path: str, pieces: Sequence[Piece]) -> RawTable:
    """One table of all ``pieces`` (one at least), rows in their order; ``path`` is what messages call it.

    Columns stand as in the first piece. Whatever key a piece has, the rows of all have none.

    Raises:
        MbmError: source-column, different-columns, bad-pattern.

    """
    first = pieces[0]
    for piece in pieces:
        if SOURCE in piece.columns:
            raise MbmError(faults.source_column(piece.beginning, piece.name))
        if piece.columns.keys() != first.columns.keys() or piece.groups != first.groups:
            names = (piece.name, first.name)
            places = (piece.beginning, first.beginning)
            raise MbmError(faults.different_columns(places, names, piece.columns, first.columns))
    told: dict[str, Piece] = {}
    for piece in pieces:
        for name in dict.fromkeys(piece.sources):
            if told.setdefault(name, piece) is not piece:
                raise MbmError(faults.told_alike(piece.beginning, told[name].name, piece.name, name))
    columns = [_joined(name, pieces) for name in first.columns]
    sources = tuple(name for piece in pieces for name in piece.sources)
    file_rows = np.concatenate([piece.provenance.file_rows[piece.rows - 1] for piece in pieces])
    file_rows.setflags(write=False)
    return RawTable(
        path=path,
        sha256=None,
        columns=(*columns, Column(name=SOURCE, texts=sources)),
        file_rows=file_rows,
        groups=first.groups,
        parts=tuple(Part(provenance=piece.provenance, rows=piece.rows) for piece in pieces),
    )


def _joined(name: str, pieces: Sequence[Piece]) -> Column:
    """The cells of a column in all pieces. One that is empty in a piece is what it is in the others."""
    cells = [piece.columns[name] for piece in pieces]
    unit = next((column.unit for column in cells if column.unit is not None), None)
    fault = first_fault(cells)
    if fault is not None:
        return unreadable(name, sum(len(piece.rows) for piece in pieces), fault)
    if all(column.numbers is not None for column in cells):
        numbers = frozen(np.concatenate([column.numbers for column in cells if column.numbers is not None]))
        return replace(cells[0], numbers=numbers, unit=unit)
    texts: list[str] = []
    for column, piece in zip(cells, pieces, strict=True):
        if column.texts is not None:
            texts += column.texts
        elif column.numbers is not None:
            filled = np.flatnonzero(~np.isnan(column.numbers))
            if filled.size:
                raise MbmError(_mixed(name, piece, int(filled[0]), pieces))
            texts += [""] * len(column.numbers)
    return replace(cells[0], numbers=None, texts=tuple(texts), unit=unit)


def _mixed(name: str, piece: Piece, position: int, pieces: Sequence[Piece]) -> Diagnostic:
    """A column that is numeric in ``piece``, text in another: the places of a number and of the text."""
    other = next(each for each in pieces if each.columns[name].is_text)
    column = other.columns[name]
    at = column.first_text() or 0
    number = piece.provenance.place(int(piece.rows[position]), name)
    text = other.provenance.place(int(other.rows[at]), name)
    return faults.mixed_column(text, str(column.cell(at)), number, (other.name, piece.name))
