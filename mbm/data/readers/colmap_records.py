"""What the three files of a COLMAP model hold, be they texts or binary: cameras, images, points.

The camera models of COLMAP (Schönberger and Frahm 2016): number, name, parameters as documented.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from mbm.data.readers import faults as format_faults
from mbm.problem.tables import Numbers
from mbm.text.types import DataPlace, MbmError
from mbm.values import dataclass

_PARAMETERS = (
    ("SIMPLE_PINHOLE", "f cx cy"),
    ("PINHOLE", "fx fy cx cy"),
    ("SIMPLE_RADIAL", "f cx cy k"),
    ("RADIAL", "f cx cy k1 k2"),
    ("OPENCV", "fx fy cx cy k1 k2 p1 p2"),
    ("OPENCV_FISHEYE", "fx fy cx cy k1 k2 k3 k4"),
    ("FULL_OPENCV", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    ("FOV", "fx fy cx cy omega"),
    ("SIMPLE_RADIAL_FISHEYE", "f cx cy k"),
    ("RADIAL_FISHEYE", "f cx cy k1 k2"),
    ("THIN_PRISM_FISHEYE", "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1"),
    ("RAD_TAN_THIN_PRISM_FISHEYE", "fx fy cx cy k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3"),
    ("SIMPLE_DIVISION", "f cx cy k"),
    ("DIVISION", "fx fy cx cy k"),
    ("SIMPLE_FISHEYE", "f cx cy"),
    ("FISHEYE", "fx fy cx cy"),
    ("EUCM", "fx fy cx cy alpha beta"),
    ("EQUIRECTANGULAR", "w h"),
)
"""In the order of the numbers that binary files have for them, from 0."""

PARAMETERS: Mapping[str, tuple[str, ...]] = MappingProxyType({name: tuple(p.split()) for name, p in _PARAMETERS})
"""The parameters of a model by its name, in the order of files."""

NAMES = tuple(PARAMETERS)
"""The names of the models by their numbers."""


Integers = NDArray[np.int64]

LARGEST_ID = 2**53
"""A column of numbers holds whole numbers up to here."""

NO_POINT = -1
"""What stands for the point of a 2D point that is the image of none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """A file that was read: its path as messages print it, its digest, and what its records are counted in."""

    path: str
    sha256: str
    unit: str

    def fault(self, row: int | None, reason: str) -> MbmError:
        """What is wrong with the record that stands in ``row``."""
        return MbmError(format_faults.malformed_record(DataPlace(file=self.path, row=row), reason, self.unit))


@dataclass(frozen=True, slots=True, kw_only=True)
class Cameras:
    """Cameras (n): rows of the file, ids, names of models, sizes (n, 2) in pixels, parameters of each."""

    origin: Origin
    rows: Integers = field(repr=False)
    ids: Integers
    models: tuple[str, ...]
    sizes: Numbers
    parameters: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Images:
    """Images (n): rows of the file, ids, poses (n, 7) from the world to the camera (qw qx qy qz x y z), camera, name.

    ``first`` (n + 1) says where the 2D points of each begin in ``points`` (m, 2), whose 3D points are ``seen`` (m).
    """

    origin: Origin
    rows: Integers = field(repr=False)
    ids: Integers
    poses: Numbers
    cameras: Integers
    names: tuple[str, ...]
    first: Integers
    points: Numbers
    seen: Integers


@dataclass(frozen=True, slots=True, kw_only=True)
class Points:
    """Points (n): rows of the file, ids, coordinates (n, 3).

    Tracks: entry ``k`` belongs to the point at position ``owners[k]`` and names an image and a 2D point in it, from 0.
    """

    origin: Origin
    rows: Integers = field(repr=False)
    ids: Integers
    positions: Numbers
    owners: Integers
    images: Integers
    indices: Integers


def whole(numbers: Numbers, origin: Origin, rows: Integers, what: str, *, least: int = 0) -> Integers:
    """Ids (n,) as whole numbers from ``least`` on; ``rows`` (n,) are where they stand."""
    fine = (numbers >= least) & (numbers < LARGEST_ID) & (numbers == np.floor(numbers))
    wrong = np.flatnonzero(~fine)
    if wrong.size:
        raise origin.fault(int(rows[wrong[0]]), f"{what} is {numbers[wrong[0]]:.17g}, no whole number from {least} on")
    return numbers.astype(np.int64)


def refuse_twice(ids: Integers, origin: Origin, rows: Integers, what: str) -> None:
    """No two records have one id."""
    order = np.argsort(ids, kind="stable")
    twice = np.flatnonzero(np.diff(ids[order]) == 0)
    if twice.size:
        row = int(order[twice[0] + 1])
        raise origin.fault(int(rows[row]), f"there is a second {what} {ids[row]}")


def positions_of(ids: Integers, known: Integers) -> Integers:
    """Where each of ``ids`` (n,) stands among ``known`` (m,), all different; -1 where it does not."""
    if not len(known):
        return np.full(len(ids), -1, dtype=np.int64)
    order = np.argsort(known, kind="stable")
    at = np.minimum(np.searchsorted(known, ids, sorter=order), len(known) - 1)
    return np.where(known[order[at]] == ids, order[at], -1).astype(np.int64)
