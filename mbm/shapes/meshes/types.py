"""What a file of a mesh holds, and what is wrong with one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbm.values import dataclass

MOST = 100_000
"""Vertices, and faces, of a mesh: as many as a list may hold."""

MOST_CORNERS = 1000
"""Corners of a face."""


class DamagedMeshError(Exception):
    """The content is no mesh of its format; the text says what is wrong, ``line`` where, if lines are counted."""

    def __init__(self, message: str, line: int | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.line = line


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mesh:
    """Points ``vertices`` (n, 3), finite, and ``faces``: the positions of their corners, from 0."""

    vertices: NDArray[np.float64]
    faces: tuple[tuple[int, ...], ...]


def mesh_of(vertices: NDArray[np.float64], faces: list[tuple[int, ...]]) -> Mesh:
    """A mesh whose numbers have been looked at.

    Raises:
        DamagedMeshError: no vertices, too many of something, a number that is not finite, a corner that is no vertex.

    """
    check_count(len(vertices), "vertices")
    check_count(len(faces), "faces")
    if len(vertices) == 0:
        raise DamagedMeshError("there are no vertices")
    wrong = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(wrong):
        raise DamagedMeshError(f"vertex {wrong[0] + 1} has a coordinate that is no finite number")
    for number, face in enumerate(faces, start=1):
        if len(face) < 3:
            raise DamagedMeshError(f"face {number} has {len(face)} corners")
        if min(face) < 0 or max(face) >= len(vertices):
            corner = next(c for c in face if not 0 <= c < len(vertices))
            raise DamagedMeshError(f"face {number} names vertex {corner + 1} of {len(vertices)}")
    return Mesh(vertices=vertices, faces=tuple(faces))


def check_count(count: int, what: str) -> None:
    """Refuse more than `MOST` of something before anything is made of it.

    Raises:
        DamagedMeshError: too many.

    """
    if count > MOST:
        raise DamagedMeshError(f"it has {count:,} {what}; {MOST:,} are read at most")


def text_of(content: bytes) -> str:
    """The characters of a text format.

    Raises:
        DamagedMeshError: it is not UTF-8.

    """
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise DamagedMeshError(f"the byte 0x{content[error.start]:02x} is no text", line) from None


def coordinates(words: list[str], line: int) -> tuple[float, float, float]:
    """Three numbers.

    Raises:
        DamagedMeshError: they are none, or not three.

    """
    found = numbers(words)
    if found is None or len(found) != 3:
        shown = " ".join(words)[:60]
        raise DamagedMeshError(f"three coordinates are wanted, not `{shown}`", line)
    return found[0], found[1], found[2]


def numbers(words: list[str]) -> list[float] | None:
    """What words say as numbers of a file; None if one says none."""
    try:
        return None if any("_" in word for word in words) else [float(word) for word in words]
    except ValueError:
        return None
