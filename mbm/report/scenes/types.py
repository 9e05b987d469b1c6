"""Values of the writers of scenes: cameras, images and points at the estimates.

Names and numbers as other programs take them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.report.types import Floats
from mbm.values import dataclass

Indices: TypeAlias = NDArray[np.int64]

Files: TypeAlias = dict[str, bytes]
"""What a writer gives: the contents of files by their names in the folder."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """A camera at the estimates: ``name`` with its key if it has one, numbers as mbm has them (pixel centres at whole
    numbers), ``size`` (width, height) in px as a table of its states it, None where nothing does.
    """

    name: str
    model: str
    focal: tuple[float, float]
    center: tuple[float, float]
    distortion: tuple[float, ...]
    size: tuple[int, int] | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """What was seen by which camera from where.

    Images have ``names``, ``files`` as other programs look for them, cameras ``camera_of`` (I,) among all,
    ``rotations`` (I, 3, 3) and ``translations`` (I, 3) from the world to the camera, which looks along +z with y down.
    ``points`` (P, 3) have ``point_names``. Point ``point`` (M,) was seen in image ``image`` (M,) at ``measured`` (M, 2)
    px, with the ``residual`` (M, 2).
    """

    cameras: tuple[Camera, ...]
    names: tuple[str, ...]
    files: tuple[str, ...]
    camera_of: Indices
    rotations: Floats
    translations: Floats
    points: Floats
    point_names: tuple[str, ...]
    image: Indices
    point: Indices
    measured: Floats
    residual: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory:
    """Poses by key, body to world: ``keys``, ``rotations`` (n, 3, 3), ``translations`` (n, 3)."""

    name: str
    keys: tuple[str | float, ...]
    rotations: Floats
    translations: Floats


LONGEST = 60
"""Characters of a name; each takes four bytes at most, and files may have 255."""


def ids(names: Sequence[str]) -> list[int]:
    """Numbers for things with these names: the names themselves where all are whole numbers, else 1, 2, …"""
    if all(name.isdecimal() and len(name) <= 9 for name in names):
        found = [int(name) for name in names]
        if len(set(found)) == len(found):
            return found
    return list(range(1, len(names) + 1))


def word(name: str) -> str:
    """A name without blanks and characters that end a field, a line, or a path, nor longer than files may be called."""
    return re.sub(r"[^\w.+-]+", "_", name[:LONGEST]).lstrip(".") or "_"


def words(names: Sequence[str]) -> list[str]:
    """Such names, no two alike, whatever case the file system keeps."""
    taken: set[str] = set()
    found = []
    for name in map(word, names):
        each, count = name, 1
        while each.casefold() in taken:
            count += 1
            each = f"{name}-{count}"
        taken.add(each.casefold())
        found.append(each)
    return found


def numbers(values: Iterable[float]) -> str:
    """Numbers between blanks, with the digits that give them back; no negative zeros."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def in_order(owners: Indices, count: int) -> list[list[int]]:
    """The places of what belongs to each of so many owners."""
    found: list[list[int]] = [[] for _ in range(count)]
    for place, owner in enumerate(owners.tolist()):
        found[owner].append(place)
    return found
