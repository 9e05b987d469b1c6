"""How the numbers that hold a value vary: a value is a point, a small change a step in the tangent space there.

Rotations of space are unit quaternions ``(w, x, y, z)`` that vary as ``q ∘ exp(ω/2)`` (``R Exp(ω)``), directions unit
vectors that vary along great circles, scales vary as ``c exp(s)``; everything else varies by addition. Order: rotation,
translation, scale (CONTRACT §2).
"""

from __future__ import annotations

from enum import Enum
from functools import cache

from mbm.values import dataclass


class Piece(Enum):
    """A part of a value: how many numbers hold it, and how many coordinates its tangent space has."""

    NUMBER = ("number", 1, 1)
    SCALE = ("scale", 1, 1)
    QUATERNION = ("quaternion", 4, 3)
    SPHERE = ("sphere", 3, 2)

    def __init__(self, label: str, size: int, tangent: int) -> None:
        self.label = label
        self.size = size
        self.tangent = tangent


@dataclass(frozen=True, slots=True, kw_only=True)
class Manifold:
    """``pieces`` in the order of the numbers; ``angles`` says of each piece whether it is an angle."""

    pieces: tuple[Piece, ...]
    angles: tuple[bool, ...]
    labels: tuple[str, ...]

    @property
    def size(self) -> int:
        """Numbers that hold a value."""
        return sum(p.size for p in self.pieces)

    @property
    def tangent(self) -> int:
        """Coordinates of the tangent space."""
        return sum(p.tangent for p in self.pieces)

    @property
    def flat(self) -> bool:
        """Every number varies by addition, so that numbers and coordinates are the same."""
        return all(p is Piece.NUMBER for p in self.pieces)

    def number_angles(self) -> tuple[bool, ...]:
        """Of each number, whether it is an angle."""
        return tuple(a for p, a in zip(self.pieces, self.angles, strict=True) for _ in range(p.size))

    def translation(self) -> tuple[int, ...]:
        """The numbers (from 0) that hold lengths: those that vary by addition and are no angles."""
        places = zip(self.spans(), self.angles, strict=True)
        return tuple(number for (piece, number, _), angle in places if piece is Piece.NUMBER and not angle)

    def spans(self) -> tuple[tuple[Piece, int, int], ...]:
        """Each piece with its first number and its first coordinate, from 0."""
        found, number, coordinate = [], 0, 0
        for piece in self.pieces:
            found.append((piece, number, coordinate))
            number += piece.size
            coordinate += piece.tangent
        return tuple(found)


@cache
def manifold_of(kind: str, dimension: int, size: int) -> Manifold:
    """The manifold of a kind of unknown; ``size`` counts for those that are plain numbers.

    ``labels`` names the tangent coordinates of poses and the like as CONTRACT §2 does: ``.rot[1]``, ``.logscale``.
    """
    if not dimension:
        angle = kind == "angle"
        return Manifold(pieces=(Piece.NUMBER,) * size, angles=(angle,) * size, labels=())
    if kind == "direction":
        return Manifold(pieces=(Piece.SPHERE,), angles=(False,), labels=(".tangent[1]", ".tangent[2]"))
    rotation, turned = (Piece.QUATERNION, False) if dimension == 3 else (Piece.NUMBER, True)
    pieces, angles = [rotation], [turned]
    labels = [f".rot[{i + 1}]" for i in range(rotation.tangent)]
    if kind in ("pose", "similarity"):
        pieces += [Piece.NUMBER] * dimension
        angles += [False] * dimension
        labels += [f".trans[{i + 1}]" for i in range(dimension)]
    if kind == "similarity":
        pieces.append(Piece.SCALE)
        angles.append(False)
        labels.append(".logscale")
    return Manifold(pieces=tuple(pieces), angles=tuple(angles), labels=tuple(labels))
