"""``(chessboard "left*.jpg" columns rows size)``: the inner corners of a chessboard in photographs of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from mbm.data.images.header import EXTENSIONS
from mbm.data.images.photographs import FEWEST_ALONG, LENGTHS, UNITS, Board, plane, read_boards
from mbm.data.types import ImageReader, RawTable
from mbm.problem.tables import Argument, ArgumentKind, Format

if TYPE_CHECKING:
    from mbm.data.images.boards import Found
    from mbm.data.images.fitting import Grey


def read(paths: Mapping[str, Path], shown: str, arguments: Mapping[str, float | str]) -> RawTable:
    """The inner corners in all photographs.

    Raises MbmError as `read_boards` does.
    """
    columns, rows, size = int(arguments["columns"]), int(arguments["rows"]), float(arguments["size"])

    def find(image: Grey) -> Found:
        from mbm.data.images import boards  # which loads SciPy

        return boards.chessboard(image, columns, rows)

    words = f"chessboard of {columns} × {rows} inner corners"
    return read_boards(paths, shown, Board(words=words, places=plane(columns, rows, size), find=find))


READER = ImageReader(
    name="chessboard",
    extensions=EXTENSIONS,
    format=Format(
        arguments=(
            Argument(name="columns", kind=ArgumentKind.COUNT, least=FEWEST_ALONG),
            Argument(name="rows", kind=ArgumentKind.COUNT, least=FEWEST_ALONG),
            Argument(name="size", kind=ArgumentKind.LENGTH),
        ),
        units=UNITS,
        lengths=LENGTHS,
    ),
    read=read,
)
