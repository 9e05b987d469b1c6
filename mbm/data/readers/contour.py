"""``(contour "part*.png")``: points on the outline of an isolated object in photographs of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from mbm.data.images.header import EXTENSIONS
from mbm.data.images.photographs import UNITS
from mbm.data.types import ImageReader, RawTable
from mbm.problem.tables import Argument, ArgumentKind, Format

SPACING, LEAST_SPACING, MOST_SPACING = 4.0, 2.0, 1000.0
"""Pixels between points: of pixels nearer to each other there are too few to tell the noise."""


def read(paths: Mapping[str, Path], shown: str, arguments: Mapping[str, float | str]) -> RawTable:
    """The points on the outlines in all photographs.

    Raises MbmError as `read_outlines` does.
    """
    from mbm.data.images.edges import Choice  # which loads SciPy
    from mbm.data.images.outlines import Wanted, read_outlines

    threshold, side, background = (arguments.get(name) for name in ("threshold", "object", "background"))
    choice = Choice(
        threshold=None if threshold is None else float(threshold),
        side=None if side is None else str(side),
        holes=arguments["holes"] == "true",
    )
    path = None if background is None else Path(str(background))
    return read_outlines(paths, shown, Wanted(choice=choice, background=path, spacing=float(arguments["every"])))


READER = ImageReader(
    name="contour",
    extensions=EXTENSIONS,
    format=Format(
        arguments=(
            Argument(name="threshold", kind=ArgumentKind.NUMBER, required=False, most=255.0),
            Argument(name="object", kind=ArgumentKind.WORD, required=False, choices=("dark", "bright")),
            Argument(name="background", kind=ArgumentKind.FILE, required=False),
            Argument(name="holes", kind=ArgumentKind.WORD, required=False, default="true", choices=("true", "false")),
            Argument(
                name="every",
                kind=ArgumentKind.NUMBER,
                required=False,
                default=SPACING,
                least=LEAST_SPACING,
                most=MOST_SPACING,
            ),
        ),
        units=UNITS,
    ),
    read=read,
)
