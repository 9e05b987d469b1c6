"""``(circles "left*.jpg" columns rows spacing)``: the centres of circles on a board in photographs of it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from mbm.data.images.header import EXTENSIONS
from mbm.data.images.photographs import FEWEST_ALONG, LENGTHS, UNITS, Board, flat, read_boards
from mbm.data.types import ImageReader, RawTable
from mbm.problem.tables import Argument, ArgumentKind, Format


def read(paths: Mapping[str, Path], shown: str, arguments: Mapping[str, float | str]) -> RawTable:
    """The centres in all photographs.

    Raises MbmError as `read_boards` does.
    """
    from mbm.data.images.discs import CircleGrid, grid_of_circles  # which loads SciPy

    grid = CircleGrid(
        columns=int(arguments["columns"]),
        rows=int(arguments["rows"]),
        asymmetric=arguments["asymmetric"] == "true",
    )
    words = f"{'asymmetric ' if grid.asymmetric else ''}grid of {grid.columns} × {grid.rows} circles"
    places = flat(grid.places() * float(arguments["spacing"]))
    return read_boards(paths, shown, Board(words=words, places=places, find=partial(grid_of_circles, board=grid)))


READER = ImageReader(
    name="circles",
    extensions=EXTENSIONS,
    format=Format(
        arguments=(
            Argument(name="columns", kind=ArgumentKind.COUNT, least=FEWEST_ALONG),
            Argument(name="rows", kind=ArgumentKind.COUNT, least=FEWEST_ALONG),
            Argument(name="spacing", kind=ArgumentKind.LENGTH),
            Argument(
                name="asymmetric",
                kind=ArgumentKind.WORD,
                required=False,
                default="false",
                choices=("true", "false"),
            ),
        ),
        units=UNITS,
        lengths=LENGTHS,
    ),
    read=read,
)
