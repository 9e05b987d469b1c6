"""Tables of the same columns → one, end to end, with the column ``source`` that says where a row is from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace

import numpy as np
from numpy.typing import NDArray

from mbm.data.cells import frozen
from mbm.data.types import RawTable
from mbm.data.union import faults
from mbm.problem.tables import SOURCE, Column, ColumnGroup, Part, Provenance, Table
from mbm.text.types import DataPlace, Diagnostic, MbmError
from mbm.values import dataclass


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
