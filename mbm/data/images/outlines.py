"""Photographs of an isolated object → one table: a row for each point of its outline that was measured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mbm.data.cells import frozen
from mbm.data.images import faults
from mbm.data.images.photographs import PER_PIXEL, ImageFile, image_file, named, part_of, read_image, table_of
from mbm.data.images.together import Room, in_threads
from mbm.data.types import RawTable
from mbm.problem.tables import Column
from mbm.text.types import DataPlace, MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.data.images.edges import Choice
    from mbm.data.images.fitting import Fitted, Grey, Image

PER_DIFFERENCE = 2 * PER_PIXEL
"""Bytes for a pixel of an image, its background, and their difference."""

SHARP = 0.25
"""Part of the points on the outside that must look like an edge: of fewer, some do by chance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """How an object is told from its surroundings, and how far points on its outline are apart in px."""

    choice: Choice
    background: Path | None
    spacing: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Seen:
    """The closed edges of the object in one image, that of its outside first, or why there are none."""

    name: str
    path: str
    sha256: str
    pixels: tuple[int, int]
    edges: tuple[Fitted, ...]
    reason: str | None = None

    @property
    def rows(self) -> int:
        """Points that are to be relied on."""
        return sum(int(edge.good.sum()) for edge in self.edges)


def read_outlines(paths: Mapping[str, Path], shown: str, wanted: Wanted) -> RawTable:
    """The table of all points on outlines in images by their names; ``shown`` is the pattern that means them.

    Raises MbmError as `read_image` does, and no-object, other-size.
    """
    place = DataPlace(file=shown)
    parts = []
    background = None
    if wanted.background is not None:
        background, digest = read_image(wanted.background, PER_DIFFERENCE)
        parts.append(part_of(wanted.background.as_posix(), digest, 0, (background.shape[1], background.shape[0])))
    room = Room()
    seen = in_threads(lambda item: _seen(*item, background, wanted, room), list(paths.items()))
    without = [(each.name, each.reason) for each in seen if each.reason is not None]
    if len(without) == len(seen):
        raise MbmError(faults.no_object(place, without))
    parts = [part_of(each.path, each.sha256, each.rows, each.pixels) for each in seen] + parts
    remarks = (faults.object_left_out(place, without, len(seen)),) if without else ()
    return table_of(shown, _columns(shown, seen), parts, remarks)


def _seen(name: str, path: Path, background: Grey | None, wanted: Wanted, room: Room) -> _Seen:
    from mbm.data.images.edges import NoObjectError  # which loads SciPy

    file = image_file(path, PER_PIXEL if background is None else PER_DIFFERENCE)
    edges: tuple[Fitted, ...] = ()
    reason = None
    with room.of(file.needed):
        try:
            edges = _edges(_levels(file, background, wanted), wanted)
        except NoObjectError as error:
            reason = str(error)
    if edges and edges[0].good.mean() < SHARP:
        edges, reason = (), "its edge is too blurred or too rough to be measured"
    return _Seen(name=name, path=file.place.file, sha256=file.sha256, pixels=file.pixels, edges=edges, reason=reason)


def _levels(file: ImageFile, background: Grey | None, wanted: Wanted) -> Sequence[Image]:
    """The image, or its difference to the background, in sizes from the largest to the smallest."""
    from mbm.data.images import opencv

    image = file.decoded()
    if background is None:
        return opencv.pyramid(image)
    return opencv.pyramid(_difference(image, background, file.place.file, wanted))


def _edges(levels: Sequence[Image], wanted: Wanted) -> tuple[Fitted, ...]:
    from mbm.data.images.edges import object_outlines, refined, smoothed  # which loads SciPy

    lines = object_outlines(levels[-1], wanted.choice)
    return refined(levels, [smoothed(line) for line in lines], wanted.spacing)


def _difference(image: Grey, background: Grey, path: str, wanted: Wanted) -> NDArray[np.int16]:
    if image.shape != background.shape:
        other = "" if wanted.background is None else wanted.background.as_posix()
        raise MbmError(faults.other_size(DataPlace(file=path), image.shape, other, background.shape))
    return np.subtract(image, background, dtype=np.int16)


def _columns(shown: str, seen: Sequence[_Seen]) -> Iterator[Column]:
    """``n`` counts all points of an image, those that were left out too: so neighbours have neighbouring numbers."""
    shows = [each for each in seen if each.edges]
    kept = [np.concatenate([edge.good for edge in each.edges]) for each in shows]
    good = np.concatenate(kept)
    edges = [edge for each in shows for edge in each.edges]
    places = [i for each in shows for i, edge in enumerate(each.edges, 1) for _ in range(len(edge.good))]
    points = np.concatenate([edge.points for edge in edges])[good]
    variances = np.concatenate([edge.covariances[:, 0, 0] for edge in edges])[good]
    numbers = np.concatenate([np.arange(1.0, len(each) + 1) for each in kept])[good]
    yield from named(shown, ((each.name, each.path, each.rows) for each in seen))
    yield Column(name="contour", numbers=frozen(np.array(places, dtype=np.float64)[good]))
    yield Column(name="n", numbers=frozen(numbers))
    for name, values in zip(("u", "v"), points.T, strict=True):
        yield Column(name=name, numbers=frozen(values))
    yield Column(name="sigma", numbers=frozen(np.sqrt(variances)))
