"""Where rows of tables come from: the file and row of each cell, through renaming, joining and putting end to end."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace

import numpy as np
from numpy.typing import NDArray

from mbm.text.types import DataPlace, Diagnostic
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Where a table came from. ``file_rows[i]`` is the row of cell row i as in the file (header = 1).

    ``origins`` has the columns that came in from another table; ``parts`` are what the rows were taken from, in their
    order, where that was not the file at ``path`` alone. ``remarks`` are warnings of the reader. ``inline``: the table
    stands in the text of the problem. ``pixels`` are width and height if it is an image.
    """

    path: str
    sha256: str | None
    rows: int
    file_rows: NDArray[np.int64] = field(repr=False)
    source_columns: Mapping[str, str] = field(default_factory=dict)
    origins: Mapping[str, Origin] = field(default_factory=dict, repr=False)
    parts: tuple[Part, ...] = field(default=(), repr=False)
    remarks: tuple[Diagnostic, ...] = field(default=(), repr=False)
    inline: bool = False
    pixels: tuple[int, int] | None = None

    def taking(self, rows: NDArray[np.int64]) -> Provenance:
        """The provenance of a table that has these ``rows`` (n,) of this one, which count from 1."""
        return Provenance(
            path=self.path,
            sha256=self.sha256,
            rows=len(rows),
            file_rows=self.file_rows[rows - 1],
            parts=(Part(provenance=self, rows=rows),),
        )

    def origins_of_rows(self) -> tuple[Provenance, ...]:
        """What the rows were read from: the tables that were put end to end, or this one."""
        return tuple(part.provenance for part in self.parts) or (self,)

    def source(self, row: int) -> Provenance:
        """The file that a row, which counts from 1, was read from."""
        part = self._part(row)
        return self if part is None else part[0].source(part[1])

    def _part(self, row: int) -> tuple[Provenance, int] | None:
        """What a row was read from where several were put end to end, and its row (from 1) there."""
        before = 0
        for part in self.parts:
            if before < row <= before + len(part.rows):
                return part.provenance, int(part.rows[row - 1 - before])
            before += len(part.rows)
        return None

    def place(self, row: int, column: str | None = None) -> DataPlace:
        """The place of a cell; ``row`` counts the table's rows from 1, ``column`` is the name used in the problem."""
        origin = self.origins.get(column) if column is not None else None
        if origin is not None and 0 < row <= len(origin.rows):
            return origin.provenance.place(int(origin.rows[row - 1]), origin.column)
        name = self.source_columns.get(column, column) if column is not None else None
        part = self._part(row)
        if part is not None:
            found = part[0].place(part[1], name)
            return found if found.number is None else replace(found, number=row)
        in_file = int(self.file_rows[row - 1]) if 0 < row <= len(self.file_rows) else row
        return DataPlace(file=self.path, row=in_file, column=name, number=row if self.inline else None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """Rows that came from one place: for each its row (from 1) there."""

    provenance: Provenance
    rows: NDArray[np.int64] = field(repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """Where a column of another table came from: for each row its row (from 1) there, and its name there."""

    provenance: Provenance
    rows: NDArray[np.int64] = field(repr=False)
    column: str
