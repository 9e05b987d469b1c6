"""COLMAP models (Schönberger and Frahm 2016): a folder with cameras, images and points, as texts or binary.

Read are the three ``.bin`` files if all of them are there, as COLMAP does, else the three ``.txt`` files. Poses go from
the world to the camera; the centre of the first pixel is (0.5, 0.5). Observations are the 2D points of images that
belong to a point (others have -1 for it). Parameters of cameras are columns of their names; where a folder has several
models, those that a model lacks are gaps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np

from mbm.data.cells import row_numbers
from mbm.data.readers import colmap_binary, colmap_text
from mbm.data.readers.colmap_records import (
    NO_POINT,
    PARAMETERS,
    Cameras,
    Images,
    Integers,
    Origin,
    Points,
    positions_of,
)
from mbm.data.readers.fields import LARGEST_DEVIATION, number_columns
from mbm.data.readers.scenes import PARTS, POSE
from mbm.data.types import ManyReader, RawTable, asked
from mbm.problem.tables import Column, Numbers
from mbm.text.types import MbmError

STEMS = ("cameras", "images", "points3D")

T = TypeVar("T")


def read(path: Path) -> Mapping[str, RawTable | MbmError]:
    """Read the model in the folder at ``path``.

    In the place of a table: MbmError as ``read_text`` and ``read_bytes`` raise it, and malformed-record; a table stands
    for all that it refers to.
    """
    binary = all((path / f"{stem}.bin").exists() for stem in STEMS)
    files = [path / f"{stem}.{'bin' if binary else 'txt'}" for stem in STEMS]
    made = colmap_binary if binary else colmap_text
    cameras = _tried(lambda: made.read_cameras(files[0]))
    images = _tried(lambda: _placed(made.read_images(files[1]), asked(cameras)))
    points = _tried(lambda: made.read_points(files[2]))
    return {
        "cameras": _tried(lambda: _cameras(asked(cameras))),
        "images": _tried(lambda: _images(asked(images))),
        "points": _tried(lambda: _points(asked(points))),
        "observations": _tried(lambda: _observations(asked(images), asked(points))),
    }


def _tried(make: Callable[[], T]) -> T | MbmError:
    try:
        return make()
    except MbmError as error:
        return error


def _placed(images: Images, cameras: Cameras) -> Images:
    """Images whose cameras there are, and whose quaternions are rotations."""
    dangling = np.flatnonzero(positions_of(images.cameras, cameras.ids) < 0)
    if dangling.size:
        row = int(dangling[0])
        reason = f"there is no camera {images.cameras[row]} in `{cameras.origin.path}`"
        raise images.origin.fault(int(images.rows[row]), reason)
    lengths = np.sqrt(np.square(images.poses[:, :4]).sum(axis=1))
    wrong = np.flatnonzero(~(np.abs(lengths - 1) < LARGEST_DEVIATION))
    if wrong.size:
        row = int(wrong[0])
        raise images.origin.fault(int(images.rows[row]), f"its quaternion has the length {lengths[row]:g}, not 1")
    return images


def _cameras(cameras: Cameras) -> RawTable:
    names = list(dict.fromkeys(name for model in cameras.models for name in PARAMETERS[model]))
    places = {name: i for i, name in enumerate(names)}
    numbers = np.full((len(cameras.ids), len(names)), np.nan)
    for row, (model, values) in enumerate(zip(cameras.models, cameras.parameters, strict=True)):
        numbers[row, [places[name] for name in PARAMETERS[model]]] = values
    columns = (
        *_id_column("camera", cameras.ids),
        Column(name="model", texts=cameras.models),
        *number_columns(("width", "height"), cameras.sizes),
        *number_columns(names, numbers),
    )
    return _table(cameras.origin, cameras.rows, columns, "camera")


def _images(images: Images) -> RawTable:
    columns = (
        *_id_column("image", images.ids),
        Column(name="name", texts=images.names),
        *_id_column("camera", images.cameras),
        *number_columns(POSE, images.poses),
    )
    return _table(images.origin, images.rows, columns, "image")


def _points(points: Points) -> RawTable:
    columns = (*_id_column("point", points.ids), *number_columns(("x", "y", "z"), points.positions))
    return _table(points.origin, points.rows, columns, "point")


def _observations(images: Images, points: Points) -> RawTable:
    """The 2D points that belong to points. What these say of their images has to agree."""
    owners = np.repeat(np.arange(len(images.ids)), np.diff(images.first))
    seen = images.seen != NO_POINT
    dangling = np.flatnonzero(seen & (positions_of(images.seen, points.ids) < 0))
    if dangling.size:
        at = int(dangling[0])
        image = int(owners[at])
        reason = (
            f"2D point {at - images.first[image]} of image {images.ids[image]} is that of point {images.seen[at]},"
            f" and there is none in `{points.origin.path}`"
        )
        raise images.origin.fault(int(images.rows[image]), reason)
    _check_tracks(images, points)
    columns = (
        *_id_column("image", images.ids[owners[seen]]),
        *_id_column("point", images.seen[seen]),
        *number_columns(("u", "v"), images.points[seen]),
    )
    return _table(images.origin, row_numbers(1, int(seen.sum())), columns, None)


def _check_tracks(images: Images, points: Points) -> None:
    """Each entry of a track names an image and a 2D point in it, and that names the point."""
    at = positions_of(points.images, images.ids)
    known = at >= 0
    counts = np.diff(images.first)
    inside = known & (points.indices < np.where(known, counts[at] if len(counts) else 0, 0))
    place = np.where(inside, images.first[at] + points.indices, 0)
    agrees = inside & (images.seen[place] == points.ids[points.owners]) if len(images.seen) else inside
    wrong = np.flatnonzero(~agrees)
    if not wrong.size:
        return
    k = int(wrong[0])
    image, index = points.images[k], points.indices[k]
    if not known[k]:
        reason = f"its track names image {image}, and there is none in `{images.origin.path}`"
    elif not inside[k]:
        reason = f"its track names 2D point {index} of image {image}, which has {counts[at[k]]}, counted from 0"
    else:
        reason = f"its track names 2D point {index} of image {image}, which belongs to point {images.seen[place[k]]}"
    raise points.origin.fault(int(points.rows[points.owners[k]]), reason)


def _id_column(name: str, ids: Integers) -> tuple[Column, ...]:
    numbers: Numbers = ids.astype(np.float64)[:, None]
    return number_columns((name,), numbers)


def _table(origin: Origin, rows: Integers, columns: tuple[Column, ...], key: str | None) -> RawTable:
    rows.setflags(write=False)
    return RawTable(path=origin.path, sha256=origin.sha256, columns=columns, file_rows=rows, key=key)


READER = ManyReader(
    name="colmap",
    extensions=(),
    parts=PARTS,
    read=read,
    members=tuple(f"{stem}.{ending}" for stem in STEMS for ending in ("bin", "txt")),
)
