"""``(aruco "left*.jpg" columns rows size gap)``: the corners of markers in rows, in photographs of them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mbm.data.images.header import EXTENSIONS
from mbm.data.images.markers import check_markers, dictionary_argument
from mbm.data.images.photographs import LENGTHS, UNITS, Board, flat, read_boards
from mbm.data.types import ImageReader, RawTable
from mbm.problem.tables import Argument, ArgumentKind, Format

if TYPE_CHECKING:
    from mbm.data.images.markers import MarkerGrid

MOST_BORDER = 4
"""Squares of the pattern that a marker's black border is wide."""


def read(paths: Mapping[str, Path], shown: str, arguments: Mapping[str, float | str]) -> RawTable:
    """The corners in all photographs.

    Raises MbmError as `read_boards` does, and bad-board.
    """
    return read_grid(paths, shown, grid_of(arguments, upward=False, joined=False))


def grid_of(arguments: Mapping[str, float | str], *, upward: bool, joined: bool) -> MarkerGrid:
    """The board that a data clause describes."""
    from mbm.data.images.markers import MarkerGrid  # which loads SciPy

    return MarkerGrid(
        columns=int(arguments["columns"]),
        rows=int(arguments["rows"]),
        side=float(arguments["size"]),
        gap=float(arguments["gap"]),
        dictionary=str(arguments["dictionary"]),
        first=int(arguments["first"]),
        border=int(arguments["border"]),
        upward=upward,
        joined=joined,
    )


def read_grid(paths: Mapping[str, Path], shown: str, board: MarkerGrid) -> RawTable:
    """The corners of a grid of markers in all photographs; ``marker`` is the number of the marker that has them.

    Raises MbmError as `read_boards` does, and bad-board.
    """
    from mbm.data.images.markers import grid_of_markers

    check_markers(shown, board.dictionary, board.first, board.count)
    words = f"grid of {board.columns} × {board.rows} markers of `{board.dictionary}`"
    more = {"marker": np.repeat(np.arange(board.count, dtype=np.float64) + board.first, 4)}
    find = partial(grid_of_markers, board=board)
    return read_boards(paths, shown, Board(words=words, places=flat(board.places()), find=find, more=more))


def grid_format(dictionary: str, border: int) -> Format:
    """What a data clause says of a grid of markers, and what is usual."""
    return Format(
        arguments=(
            Argument(name="columns", kind=ArgumentKind.COUNT, least=1),
            Argument(name="rows", kind=ArgumentKind.COUNT, least=1),
            Argument(name="size", kind=ArgumentKind.LENGTH),
            Argument(name="gap", kind=ArgumentKind.LENGTH),
            dictionary_argument(dictionary),
            Argument(name="first", kind=ArgumentKind.COUNT, required=False, default=0),
            Argument(name="border", kind=ArgumentKind.COUNT, required=False, default=border, least=1, most=MOST_BORDER),
        ),
        units=UNITS,
        lengths=LENGTHS,
    )


READER = ImageReader(name="aruco", extensions=EXTENSIONS, format=grid_format("DICT_4X4_50", 1), read=read)
