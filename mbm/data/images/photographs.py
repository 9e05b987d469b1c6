"""Photographs of a board → one table: a row for each point of the board that was found in one of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from mbm.data.cells import frozen, row_numbers
from mbm.data.content import read_bytes
from mbm.data.faults import EMPTY_FILE
from mbm.data.images import faults
from mbm.data.images.header import may_be_transparent, size_of
from mbm.data.images.opencv import decoded
from mbm.data.images.together import Room, in_threads
from mbm.data.types import RawTable
from mbm.data.union.tables import shot_of
from mbm.files.memory import check_memory
from mbm.problem.provenance import Part, Provenance
from mbm.problem.tables import Column, ColumnGroup
from mbm.text.types import DataPlace, Diagnostic, MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.data.images.boards import Found
    from mbm.data.images.fitting import Fitted, Floats, Grey

PHOTO = "photo"
"""The column that names the photograph: the name of its file without folder and ending."""

SHOT = "shot"
"""The column that names what several cameras have in common: what ``*`` and ``?`` stand for in the file's name."""

UNITS = MappingProxyType({"u": "px", "v": "px", "sigma": "px"})
LENGTHS = ("x", "y", "z")
COVARIANCE = ("covariance11", "covariance12", "covariance22")
GROUP = ColumnGroup(shape=(2, 2), columns=(COVARIANCE[0], COVARIANCE[1], COVARIANCE[1], COVARIANCE[2]))

FEWEST_ALONG = 3
"""Points, or squares, along a side of a board: of fewer, detectors make no grid."""

PER_PIXEL = 6
"""Bytes for a pixel: decoded, and in copies of half the size (measured: 3); a board is looked for in a small copy."""

PER_OPACITY = 8
"""Bytes for a pixel with an opacity while that is looked at: four channels of 16 bits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """What is looked for: words for messages, where its points are (n, 3) in the board's frame, and how to find them.

    ``find`` raises NoBoardError. ``more`` holds further columns: a number for each point, by the column's name.
    """

    words: str
    places: Floats
    find: Callable[[Grey], Found]
    more: Mapping[str, Floats] = field(default_factory=dict)


BLURRED = "it is there, but too blurred for most of its points to be measured"

WIDE_BLUR = 2.0
"""Standard deviation in px of a blur from which it may be what keeps points from being measured. Where few of them are
left then, these are those whose noise makes them look sharper: errors of twice what they state."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Seen:
    """What one photograph shows, or why it shows no board, if that is known."""

    name: str
    path: str
    sha256: str
    pixels: tuple[int, int]
    found: Found | None
    reason: str | None = None

    @property
    def rows(self) -> int:
        """Points that are to be relied on."""
        return 0 if self.found is None else int(self.found.fitted.good.sum())

    @property
    def left_out(self) -> int:
        """Points that were found but could not be refined."""
        return 0 if self.found is None else int((~self.found.fitted.good).sum())


def plane(columns: int, rows: int, size: float) -> Floats:
    """Places (rows·columns, 3) of a grid of points, row by row, the first at the origin."""
    y, x = np.mgrid[:rows, :columns].reshape(2, -1) * size
    return flat(np.column_stack([x, y]))


def flat(places: Floats) -> Floats:
    """Places (n, 2) of a plane in space (n, 3)."""
    return np.column_stack([places, np.zeros(len(places))])


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageFile:
    """The content of an image file, its digest, width and height, and the bytes that are needed to work on it."""

    place: DataPlace
    content: bytes = field(repr=False)
    sha256: str
    pixels: tuple[int, int]
    needed: int

    def decoded(self) -> Grey:
        """The image.

        Raises MbmError: damaged-image, transparent-image, missing-extra.
        """
        return decoded(self.content, self.place)


def image_file(path: Path, per_pixel: int = PER_PIXEL) -> ImageFile:
    """An image file; what it takes is worked out from its header, in bytes for a pixel.

    Raises MbmError as ``read_bytes`` does, but damaged-image for an empty file, and not-an-image, too-much-memory.
    """
    shown = path.as_posix()
    place = DataPlace(file=shown)
    try:
        content, digest = read_bytes(path)
    except MbmError as error:
        if error.diagnostics[0].code is not EMPTY_FILE:
            raise
        raise MbmError(faults.damaged_image(place, "the file is empty")) from None
    width, height = size_of(content, shown)
    needed = max(per_pixel, PER_OPACITY if may_be_transparent(content) else 0) * width * height
    check_memory(needed, faults.pixels_of(shown, width, height), place)
    return ImageFile(place=place, content=content, sha256=digest, pixels=(width, height), needed=needed)


def read_image(path: Path, per_pixel: int = PER_PIXEL) -> tuple[Grey, str]:
    """An image and the SHA-256 digest of its file.

    Raises MbmError as `image_file` does, and missing-extra.
    """
    file = image_file(path, per_pixel)
    return file.decoded(), file.sha256


def part_of(path: str, digest: str, rows: int, pixels: tuple[int, int]) -> Part:
    """The rows of a table that are from one image, none if it was only looked at."""
    numbers = row_numbers(1, rows)
    return Part(
        provenance=Provenance(path=path, sha256=digest, rows=rows, file_rows=numbers, pixels=pixels), rows=numbers
    )


def named(shown: str, images: Iterable[tuple[str, str, int]]) -> Iterator[Column]:
    """The columns that tell rows by their images: of each its name, its path, and how many rows it has."""
    found = [(name, shot_of(shown, Path(path)), rows) for name, path, rows in images]
    yield Column(name=PHOTO, texts=tuple(name for name, _, rows in found for _ in range(rows)))
    yield Column(name=SHOT, texts=tuple(shot for _, shot, rows in found for _ in range(rows)))


def table_of(
    shown: str, columns: Iterable[Column], parts: Sequence[Part], remarks: tuple[Diagnostic, ...] = ()
) -> RawTable:
    """A table whose rows are from images, in this order; ``shown`` is the path or pattern that means them."""
    file_rows = np.concatenate([part.rows for part in parts])
    file_rows.setflags(write=False)
    return RawTable(
        path=shown,
        sha256=None,
        columns=tuple(columns),
        file_rows=file_rows,
        parts=tuple(parts),
        remarks=remarks,
    )


def read_boards(paths: Mapping[str, Path], shown: str, board: Board) -> RawTable:
    """The table of all points of a board in photographs by their names; ``shown`` is the pattern that means them.

    Raises MbmError as `read_image` does, and no-board.
    """
    place = DataPlace(file=shown)
    room = Room()
    seen = in_threads(lambda item: _seen(*item, board, room), list(paths.items()))
    without = [(each.name, each.reason) for each in seen if each.found is None]
    if len(without) == len(seen):
        raise MbmError(faults.no_board(place, board.words, without))
    parts = [part_of(each.path, each.sha256, each.rows, each.pixels) for each in seen]
    table = table_of(shown, _columns(shown, seen, board), parts, tuple(_remarks(seen, without, board, place)))
    return replace(table, groups={"covariance": GROUP})


def _seen(name: str, path: Path, board: Board, room: Room) -> _Seen:
    file = image_file(path)
    found, reason = None, None
    with room.of(file.needed):
        try:
            found = board.find(file.decoded())
        except faults.NoBoardError as error:
            reason = error.reason
    whole = None if found is None or _blurred(found.fitted) else found
    if found is not None and whole is None:
        reason = BLURRED
    return _Seen(name=name, path=path.as_posix(), sha256=file.sha256, pixels=file.pixels, found=whole, reason=reason)


def _blurred(fitted: Fitted) -> bool:
    """Whether no point could be measured, or most could not and the others are much blurred, as patterns tell last."""
    good = fitted.good
    return not good.any() or bool(good.mean() < 0.5 and np.median(fitted.parameters[good, -1]) > np.log(WIDE_BLUR))


def _columns(shown: str, seen: Sequence[_Seen], board: Board) -> Iterator[Column]:
    shows = [each.found for each in seen if each.found is not None]
    good = [found.fitted.good for found in shows]
    numbers = np.concatenate([found.numbers[kept] for found, kept in zip(shows, good, strict=True)])
    points = np.concatenate([found.fitted.points[kept] for found, kept in zip(shows, good, strict=True)])
    spread = np.concatenate([found.fitted.covariances[kept] for found, kept in zip(shows, good, strict=True)])
    yield from named(shown, ((each.name, each.path, each.rows) for each in seen))
    yield Column(name="corner", numbers=frozen(numbers))
    for name, values in board.more.items():
        yield Column(name=name, numbers=frozen(values[numbers - 1]))
    for name, values in zip(LENGTHS, board.places[numbers - 1].T, strict=True):
        yield Column(name=name, numbers=frozen(values))
    for name, values in zip(("u", "v"), points.T, strict=True):
        yield Column(name=name, numbers=frozen(values))
    yield Column(name="sigma", numbers=frozen(np.sqrt((spread[:, 0, 0] + spread[:, 1, 1]) / 2)))
    for name, (i, j) in zip(COVARIANCE, ((0, 0), (0, 1), (1, 1)), strict=True):
        yield Column(name=name, numbers=frozen(spread[:, i, j]))


def _remarks(
    seen: Sequence[_Seen], without: Sequence[tuple[str, str | None]], board: Board, place: DataPlace
) -> Iterator[Diagnostic]:
    if without:
        yield faults.board_left_out(place, board.words, without, len(seen))
    counts = [(each.name, each.left_out) for each in seen if each.left_out]
    if counts:
        yield faults.points_left_out(place, counts)
