"""Points and steps: how numbers that hold rotations, directions and scales move along a step of the tangent space.

Conventions as `mbm.problem.manifold`: ``R Exp(ω)`` with unit quaternions (w, x, y, z), great circles, ``c exp(s)``.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.problem.manifold import Manifold, Piece
from mbm.problem.types import UnknownKind
from mbm.rotations import cross_matrix, hamilton, quaternion_of_matrix, quaternion_of_vector, tangents, unit
from mbm.solver.charts import SMALL_ANGLE
from mbm.solver.manifolds import SEAM
from mbm.values import dataclass


@cache
def of_arrays(formula: Callable[..., float]) -> Callable[..., Floats]:
    """A formula of the solver for arrays."""
    # Loaded where one is evaluated here: few solves need what the compiled solver does not do itself.
    from mbm.machine.elementwise import elementwise

    return elementwise(formula)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curved:
    """The pieces of one kind that do not vary by addition: places of their numbers and of their coordinates.

    ``numbers`` (k, size of the piece) in the vector of all numbers, ``coordinates`` (k, tangent) in that of all
    coordinates.
    """

    piece: Piece
    numbers: Indices
    coordinates: Indices


def moved(piece: Piece, numbers: Floats, step: Floats) -> Floats:
    """``numbers`` (k, size) after ``step`` (k, tangent); quaternions and directions have length 1 afterwards."""
    if piece is Piece.NUMBER:
        return numbers + step
    if piece is Piece.SCALE:
        return np.asarray(numbers * np.exp(step))
    if piece is Piece.QUATERNION:
        return unit(hamilton(numbers, quaternion_of_vector(step)))
    first, second = tangent_axes(numbers)
    along = step[:, :1] * first + step[:, 1:] * second
    angle = np.linalg.norm(step, axis=1, keepdims=True)
    return unit(np.cos(angle) * numbers + np.sinc(angle / np.pi) * along)


def chart_slopes(piece: Piece, numbers: Floats, step: Floats) -> Floats:
    """How a step at ``moved(piece, numbers, step)`` varies with ``step`` (k, tangent), shape (k, tangent, tangent).

    For rotations the right Jacobian of Exp (Solà, Deray and Atchuthan 2018, eq. 143).
    """
    count, size = step.shape
    if piece in (Piece.NUMBER, Piece.SCALE):
        return np.broadcast_to(np.eye(size), (count, size, size)).copy()
    angle = np.linalg.norm(step, axis=1)[:, None, None]
    small = angle < SMALL_ANGLE
    safe = np.where(small, 1.0, angle)
    if piece is Piece.QUATERNION:
        cross = cross_matrix(step)
        first = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2)
        second = np.where(small, 1 / 6 - angle**2 / 120, (safe - np.sin(safe)) / safe**3)
        return np.asarray(np.eye(3) - first * cross + second * cross @ cross)
    axes = np.stack(tangent_axes(numbers), axis=-1)
    along = axes @ step[:, :, None]
    bend = np.where(small, -1 / 3 + angle**2 / 30, (safe * np.cos(safe) - np.sin(safe)) / safe**3)
    sinc = np.sinc(angle / np.pi)
    slopes = (bend * along - sinc * numbers[:, :, None]) @ step[:, None, :] + sinc * axes
    there = np.stack(tangent_axes(moved(piece, numbers, step)), axis=-1)
    return np.asarray(there.transpose(0, 2, 1) @ slopes)


def tangent_axes(directions: Floats) -> tuple[Floats, Floats]:
    """Two orthonormal tangents (…, 3) at unit vectors (…, 3)."""
    x, y, z = np.moveaxis(directions, -1, 0)
    first, second = tangents(x, y, z, np.where(z < SEAM, -1.0, 1.0))
    return np.stack(first, axis=-1), np.stack(second, axis=-1)


def numbers_of_stated(kind: UnknownKind, dimension: int, stated: Floats) -> Floats:
    """What ``:init`` states, per member (k, …), as the numbers that hold it (k, size).

    Stated are: a vector of any length (direction), a rotation matrix row by row, then the translation, then the scale.
    """
    if not dimension:
        return stated
    if kind is UnknownKind.DIRECTION:
        length = np.linalg.norm(stated, axis=-1, keepdims=True)
        return np.asarray(stated / np.where(length > 0, length, np.nan))
    square = dimension * dimension
    matrices = stated[:, :square].reshape(-1, dimension, dimension)
    if dimension == 2:
        rotation = np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0])[:, None]
    else:
        rotation = np.full((len(stated), 4), np.nan)
        whole = np.isfinite(matrices).all(axis=(1, 2))
        rotation[whole] = quaternion_of_matrix(matrices[whole])
    return np.hstack([rotation, stated[:, square:]])


def held_numbers(manifold: Manifold, fixed: Mask) -> Mask:
    """Which numbers (k, size) are known with the coordinates (k, tangent): a rotation is, if one of its own is."""
    if manifold.flat:
        return fixed
    found = [
        np.repeat(fixed[:, first : first + piece.tangent].any(axis=1, keepdims=True), piece.size, axis=1)
        for piece, _, first in manifold.spans()
    ]
    return np.hstack(found)


def tangent_slopes(kind: UnknownKind, dimension: int, stated: Floats, slopes: Floats) -> Floats:
    """Slopes (k, tangent, n) of a rotation, pose or similarity from those of what is stated of it (k, width, n)."""
    count, _, n = slopes.shape
    square = dimension * dimension
    matrices = stated[:, :square].reshape(count, dimension, dimension)
    turning = np.einsum("kai,kajn->kijn", matrices, slopes[:, :square].reshape(count, dimension, dimension, n))
    pairs = ((1, 0),) if dimension == 2 else ((2, 1), (0, 2), (1, 0))
    turned = np.stack([(turning[:, i, j] - turning[:, j, i]) / 2 for i, j in pairs], axis=1)
    moved_ = slopes[:, square : square + dimension]
    if kind is not UnknownKind.SIMILARITY:
        return np.concatenate([turned, moved_], axis=1)
    return np.concatenate([turned, moved_, slopes[:, -1:] / stated[:, -1:, None]], axis=1)


def stated_width(kind: UnknownKind, dimension: int, size: int) -> int:
    """How many numbers ``:init`` states per member; ``size`` for plain numbers."""
    if not dimension:
        return size
    if kind is UnknownKind.DIRECTION:
        return 3
    square = dimension * dimension
    return square + {UnknownKind.ROTATION: 0, UnknownKind.POSE: dimension}.get(kind, dimension + 1)


def bounded_coordinates(manifold: Manifold) -> tuple[int, ...]:
    """The coordinates (from 0) that bounds are stated for: of plain numbers, but not the angle of a plane pose."""
    plain = tuple(c for piece, _, c in manifold.spans() if piece is Piece.NUMBER)
    if len(plain) > 1 and manifold.labels and plain[0] == 0:
        return plain[1:]
    return plain
