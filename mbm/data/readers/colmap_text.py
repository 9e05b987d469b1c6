"""COLMAP's text files: ``cameras.txt``, ``images.txt``, ``points3D.txt``; lines that begin with ``#`` are comments."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mbm.data.cells import numbers_of
from mbm.data.content import BLANKS, lines_in, read_text
from mbm.data.readers import faults as format_faults
from mbm.data.readers.colmap_records import (
    NAMES,
    NO_POINT,
    PARAMETERS,
    Cameras,
    Images,
    Origin,
    Points,
    refuse_twice,
    whole,
)
from mbm.data.readers.fields import Line, line_numbers, lines_of
from mbm.problem.tables import Numbers, reads_as_number

CAMERA_FIELDS, IMAGE_FIELDS, POINT_FIELDS = 4, 10, 8
"""Fields before the parameters of a camera and the track of a point, and of the first line of an image."""


def read_cameras(path: Path) -> Cameras:
    """``CAMERA_ID MODEL WIDTH HEIGHT PARAMS…`` in each line."""
    text, origin = _opened(path)
    lines = lines_of(text)
    for number, fields in lines:
        if len(fields) < CAMERA_FIELDS:
            raise origin.fault(number, "a camera has an id, a model, a width, a height and parameters")
        names = PARAMETERS.get(fields[1])
        if names is None:
            known = ", ".join(NAMES)
            raise origin.fault(number, f"{format_faults.shown(fields[1])} is no camera model; those are {known}")
        if len(fields) != CAMERA_FIELDS + len(names):
            said = f"{fields[1]} has the parameters {' '.join(names)}, and here are {len(fields) - CAMERA_FIELDS}"
            raise origin.fault(number, said)
    rows = line_numbers(number for number, _ in lines)
    heads = _numbers([(n, [f[0], *f[2:CAMERA_FIELDS]]) for n, f in lines], origin).reshape(-1, 3)
    ids = whole(heads[:, 0], origin, rows, "the id of the camera")
    refuse_twice(ids, origin, rows, "camera")
    parameters = _numbers([(n, f[CAMERA_FIELDS:]) for n, f in lines], origin).tolist()
    ends = np.cumsum([len(PARAMETERS[f[1]]) for _, f in lines], dtype=np.int64).tolist()
    return Cameras(
        origin=origin,
        rows=rows,
        ids=ids,
        models=tuple(fields[1] for _, fields in lines),
        sizes=heads[:, 1:],
        parameters=tuple(tuple(parameters[a:b]) for a, b in zip([0, *ends], ends, strict=False)),
    )


def read_images(path: Path) -> Images:
    """Two lines each: ``IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME``, then ``X Y POINT3D_ID`` of each 2D point."""
    text, origin = _opened(path)
    heads: list[Line] = []
    points: list[Line] = []
    names = []
    lines = enumerate(lines_in(text), start=1)
    for number, line in lines:
        stripped = line.strip()
        if not stripped or stripped.startswith("#"):
            continue
        fields = stripped.split(None, IMAGE_FIELDS - 1)
        if len(fields) != IMAGE_FIELDS:
            raise origin.fault(number, "an image has an id, a quaternion, a translation, a camera and a name")
        heads.append((number, fields[:-1]))
        names.append(fields[-1])
        second, seen = next(lines, (number, ""))
        points.append((second, seen.split()))
        if len(points[-1][1]) % 3:
            raise origin.fault(second, "the 2D points of an image are triples of x, y and the id of a point")
    rows = line_numbers(number for number, _ in heads)
    numbers = _numbers(heads, origin).reshape(-1, IMAGE_FIELDS - 1)
    ids = whole(numbers[:, 0], origin, rows, "the id of the image")
    refuse_twice(ids, origin, rows, "image")
    seen_numbers = _numbers(points, origin).reshape(-1, 3)
    counts = [len(fields) // 3 for _, fields in points]
    lines_of_points = np.repeat(line_numbers(number for number, _ in points), counts)
    return Images(
        origin=origin,
        rows=rows,
        ids=ids,
        poses=numbers[:, 1:8],
        cameras=whole(numbers[:, 8], origin, rows, "the id of its camera"),
        names=tuple(names),
        first=np.cumsum([0, *counts], dtype=np.int64),
        points=seen_numbers[:, :2],
        seen=whole(seen_numbers[:, 2], origin, lines_of_points, "the id of a point", least=NO_POINT),
    )


def read_points(path: Path) -> Points:
    """``POINT3D_ID X Y Z R G B ERROR``, then ``IMAGE_ID POINT2D_IDX`` of each image of its track, in each line."""
    text, origin = _opened(path)
    lines = lines_of(text)
    for number, fields in lines:
        if len(fields) < POINT_FIELDS or len(fields) % 2:
            said = "a point has an id, three coordinates, three colours, an error and pairs of an image and a 2D point"
            raise origin.fault(number, said)
    rows = line_numbers(number for number, _ in lines)
    heads = _numbers([(n, f[:POINT_FIELDS]) for n, f in lines], origin).reshape(-1, POINT_FIELDS)
    ids = whole(heads[:, 0], origin, rows, "the id of the point")
    refuse_twice(ids, origin, rows, "point")
    tracks = _numbers([(n, f[POINT_FIELDS:]) for n, f in lines], origin).reshape(-1, 2)
    owners = np.repeat(np.arange(len(lines)), [(len(f) - POINT_FIELDS) // 2 for _, f in lines])
    places = rows[owners]
    return Points(
        origin=origin,
        rows=rows,
        ids=ids,
        positions=heads[:, 1:4],
        owners=owners.astype(np.int64),
        images=whole(tracks[:, 0], origin, places, "the id of an image"),
        indices=whole(tracks[:, 1], origin, places, "the number of a 2D point"),
    )


def _opened(path: Path) -> tuple[str, Origin]:
    text, digest = read_text(path, between=BLANKS)
    return text, Origin(path=path.as_posix(), sha256=digest, unit="line")


def _numbers(lines: list[Line], origin: Origin) -> Numbers:
    """All fields of the lines as numbers, shape (n,)."""
    numbers = numbers_of([field for _, fields in lines for field in fields])
    if numbers is None:
        number, field = next((n, f) for n, fields in lines for f in fields if not reads_as_number(f))
        raise origin.fault(number, f"{format_faults.shown(field)} is no number")
    return numbers
