"""``(apriltag "left*.jpg" columns rows size gap)``: the corners of tags on a board as Kalibr prints it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from mbm.data.images.header import EXTENSIONS
from mbm.data.readers.aruco import grid_format, grid_of, read_grid
from mbm.data.types import ImageReader, RawTable


def read(paths: Mapping[str, Path], shown: str, arguments: Mapping[str, float | str]) -> RawTable:
    """The corners in all photographs.

    Raises MbmError as `read_boards` does, and bad-board.
    """
    return read_grid(paths, shown, grid_of(arguments, upward=True, joined=True))


READER = ImageReader(name="apriltag", extensions=EXTENSIONS, format=grid_format("DICT_APRILTAG_36h11", 2), read=read)
