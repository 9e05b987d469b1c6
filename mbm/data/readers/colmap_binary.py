"""COLMAP's binary files: ``cameras.bin``, ``images.bin``, ``points3D.bin``; little endian, records count from 1.

What a count announces is compared with the bytes that are left before anything is made of it.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from mbm.data.content import check_table, read_bytes
from mbm.data.readers.colmap_records import (
    LARGEST_ID,
    NAMES,
    PARAMETERS,
    Cameras,
    Images,
    Integers,
    Origin,
    Points,
    refuse_twice,
    whole,
)
from mbm.problem.tables import Numbers

_COUNT = struct.Struct("<Q")
_CAMERA = struct.Struct("<iiQQ")
_IMAGE = struct.Struct("<i7di")
_POINT = struct.Struct("<Q3d3Bd")
_POINT_2D = np.dtype([("x", "<f8"), ("y", "<f8"), ("point", "<i8")])
_TRACK = np.dtype([("image", "<i4"), ("index", "<i4")])

PER_BYTE = 16
"""Bytes of memory for a byte of a file, about: a short record becomes some Python objects before it is a row."""


class _Stream:
    """The bytes of a file from the first one on; ``record`` is the one at hand, which faults name."""

    def __init__(self, path: Path) -> None:
        self.content, digest = read_bytes(path)
        self.origin = Origin(path=path.as_posix(), sha256=digest, unit="record")
        self.at = 0
        self.record: int | None = None
        check_table(path, len(self.content) // 8, PER_BYTE * len(self.content))

    def take(self, layout: struct.Struct) -> tuple[float, ...]:
        """The numbers of a fixed layout."""
        self._want(1, layout.size)
        found = layout.unpack_from(self.content, self.at)
        self.at += layout.size
        return found

    def count(self, size: int, what: str) -> int:
        """How many records follow, each of ``size`` bytes at least."""
        (number,) = _COUNT.unpack_from(self.content, self._want(1, _COUNT.size))
        self.at += _COUNT.size
        if number * size > len(self.content) - self.at:
            reason = f"it announces {number:,} {what}, more than the {len(self.content) - self.at:,} bytes left hold"
            raise self.origin.fault(self.record, reason)
        return int(number)

    def array(self, kind: np.dtype[np.void], count: int) -> np.ndarray:
        """``count`` records of numbers, which are there."""
        found = np.frombuffer(self.content, dtype=kind, count=count, offset=self.at)
        self.at += kind.itemsize * count
        return found

    def text(self) -> str:
        """A text up to the next NUL."""
        end = self.content.find(b"\0", self.at)
        if end < 0:
            raise self.origin.fault(self.record, "the name of the image does not end")
        try:
            found = self.content[self.at : end].decode("utf-8")
        except UnicodeDecodeError:
            raise self.origin.fault(self.record, "the name of the image is not UTF-8") from None
        self.at = end + 1
        return found

    def finish(self) -> None:
        """Nothing may follow."""
        if self.at != len(self.content):
            raise self.origin.fault(None, f"{len(self.content) - self.at:,} bytes follow the last record")

    def _want(self, count: int, size: int) -> int:
        if len(self.content) - self.at < count * size:
            raise self.origin.fault(self.record, "the file ends here: it is cut short")
        return self.at


def read_cameras(path: Path) -> Cameras:
    """Cameras: id, number of the model, width, height, parameters."""
    stream = _Stream(path)
    heads, parameters = [], []
    for record in range(1, stream.count(_CAMERA.size, "cameras") + 1):
        stream.record = record
        camera, model, width, height = stream.take(_CAMERA)
        if not 0 <= model < len(NAMES):
            raise stream.origin.fault(
                record, f"there is no camera model {model}: they count from 0 to {len(NAMES) - 1}"
            )
        heads.append((camera, model, width, height))
        parameters.append(stream.take(struct.Struct(f"<{len(PARAMETERS[NAMES[int(model)]])}d")))
    stream.finish()
    numbers = np.array(heads, dtype=np.float64).reshape(-1, 4)
    rows = _rows(len(heads))
    ids = whole(numbers[:, 0], stream.origin, rows, "the id of the camera")
    refuse_twice(ids, stream.origin, rows, "camera")
    return Cameras(
        origin=stream.origin,
        rows=rows,
        ids=ids,
        models=tuple(NAMES[int(model)] for _, model, _, _ in heads),
        sizes=numbers[:, 2:],
        parameters=tuple(parameters),
    )


def read_images(path: Path) -> Images:
    """Images: id, quaternion, translation, camera, name, 2D points."""
    stream = _Stream(path)
    heads, names, blocks = [], [], []
    for record in range(1, stream.count(_IMAGE.size + 1 + _COUNT.size, "images") + 1):
        stream.record = record
        heads.append(stream.take(_IMAGE))
        names.append(stream.text())
        blocks.append(stream.array(_POINT_2D, stream.count(_POINT_2D.itemsize, "2D points")))
    stream.finish()
    numbers = np.array(heads, dtype=np.float64).reshape(-1, 9)
    rows = _rows(len(heads))
    ids = whole(numbers[:, 0], stream.origin, rows, "the id of the image")
    refuse_twice(ids, stream.origin, rows, "image")
    points = np.concatenate([np.empty(0, dtype=_POINT_2D), *blocks])
    seen = points["point"].astype(np.int64)
    wrong = np.flatnonzero((seen < -1) | (seen >= LARGEST_ID))
    counts = [len(block) for block in blocks]
    if wrong.size:
        record = int(np.repeat(rows, counts)[wrong[0]])
        raise stream.origin.fault(record, f"the id of a point is {points['point'][wrong[0]]}")
    return Images(
        origin=stream.origin,
        rows=rows,
        ids=ids,
        poses=numbers[:, 1:8],
        cameras=whole(numbers[:, 8], stream.origin, rows, "the id of its camera"),
        names=tuple(names),
        first=np.cumsum([0, *counts], dtype=np.int64),
        points=_columns(points, "x", "y"),
        seen=seen,
    )


def read_points(path: Path) -> Points:
    """Points: id, coordinates, colour, error, track."""
    stream = _Stream(path)
    heads, blocks = [], []
    for record in range(1, stream.count(_POINT.size + _COUNT.size, "points") + 1):
        stream.record = record
        heads.append(stream.take(_POINT)[:4])
        blocks.append(stream.array(_TRACK, stream.count(_TRACK.itemsize, "images of its track")))
    stream.finish()
    numbers = np.array(heads, dtype=np.float64).reshape(-1, 4)
    rows = _rows(len(heads))
    ids = whole(numbers[:, 0], stream.origin, rows, "the id of the point")
    refuse_twice(ids, stream.origin, rows, "point")
    owners = np.repeat(np.arange(len(blocks)), [len(block) for block in blocks]).astype(np.int64)
    tracks = _columns(np.concatenate([np.empty(0, dtype=_TRACK), *blocks]), "image", "index")
    return Points(
        origin=stream.origin,
        rows=rows,
        ids=ids,
        positions=numbers[:, 1:],
        owners=owners,
        images=whole(tracks[:, 0], stream.origin, rows[owners], "the id of an image"),
        indices=whole(tracks[:, 1], stream.origin, rows[owners], "the number of a 2D point"),
    )


def _rows(count: int) -> Integers:
    return np.arange(1, count + 1, dtype=np.int64)


def _columns(records: np.ndarray, *names: str) -> Numbers:
    """Fields of records as numbers (n, names)."""
    return np.column_stack([records[name].astype(np.float64) for name in names])
