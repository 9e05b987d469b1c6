"""``(charuco "left*.jpg" columns rows square marker)``: the corners of a chessboard with markers in photographs."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from mbm.data.images import faults
from mbm.data.images.header import EXTENSIONS
from mbm.data.images.markers import check_markers, dictionary_argument
from mbm.data.images.photographs import FEWEST_ALONG, LENGTHS, UNITS, Board, plane, read_boards
from mbm.data.types import ImageReader, RawTable
from mbm.problem.tables import Argument, ArgumentKind, Format
from mbm.text.types import DataPlace, MbmError


def read(paths: Mapping[str, Path], shown: str, arguments: Mapping[str, float | str]) -> RawTable:
    """The inner corners in all photographs.

    Raises MbmError as `read_boards` does, and bad-board.
    """
    from mbm.data.images.markers import chessboard_with_markers  # which loads SciPy
    from mbm.data.images.opencv import Charuco

    columns, rows = int(arguments["columns"]), int(arguments["rows"])
    square, marker, dictionary = float(arguments["square"]), float(arguments["marker"]), str(arguments["dictionary"])
    if marker >= square:
        raise MbmError(faults.bad_board(DataPlace(file=shown), "its markers are not smaller than its squares"))
    check_markers(shown, dictionary, 0, columns * rows // 2)
    legacy = arguments["legacy"] == "true"
    board = Charuco(columns=columns, rows=rows, marker=marker / square, dictionary=dictionary, legacy=legacy)
    words = f"chessboard of {columns} × {rows} squares with markers of `{dictionary}`"
    places = np.add(plane(columns - 1, rows - 1, square), [square, square, 0.0])
    find = partial(chessboard_with_markers, board=board)
    return read_boards(paths, shown, Board(words=words, places=places, find=find))


READER = ImageReader(
    name="charuco",
    extensions=EXTENSIONS,
    format=Format(
        arguments=(
            Argument(name="columns", kind=ArgumentKind.COUNT, least=FEWEST_ALONG),
            Argument(name="rows", kind=ArgumentKind.COUNT, least=FEWEST_ALONG),
            Argument(name="square", kind=ArgumentKind.LENGTH),
            Argument(name="marker", kind=ArgumentKind.LENGTH),
            dictionary_argument("DICT_4X4_50"),
            Argument(name="legacy", kind=ArgumentKind.WORD, required=False, default="false", choices=("true", "false")),
        ),
        units=UNITS,
        lengths=LENGTHS,
    ),
    read=read,
)
