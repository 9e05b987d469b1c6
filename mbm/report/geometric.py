"""Rotations, poses, similarities and directions as documents and tables show them.

Their numbers are those that `mbm.problem.manifold` describes; sigmas belong to tangent coordinates: rotation vector
(rad), translation, logarithm of the scale (CONTRACT §2).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mbm.equations.layout import half_turns
from mbm.problem.manifold import Manifold, Piece, manifold_of
from mbm.report.types import Floats, Kind, Quantity
from mbm.rotations import hamilton, matrix_of_quaternion, quaternion_of_matrix, vector_of_quaternion

CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])

GEOMETRIC = frozenset({Kind.DIRECTION, Kind.ROTATION, Kind.POSE, Kind.SIMILARITY})
"""Kinds whose sigmas belong to a tangent space."""


def manifold(quantity: Quantity) -> Manifold:
    """How the numbers of a geometric quantity vary."""
    return manifold_of(quantity.kind.value, quantity.dimension, 0)


def number_factors(quantity: Quantity) -> Floats:
    """SI per unit shown for each number; only translations have a unit."""
    return np.array([f for p, f in _pieces(quantity) for _ in range(p.size)])


def coordinate_factors(quantity: Quantity) -> Floats:
    """SI per unit shown for each tangent coordinate."""
    return np.array([f for p, f in _pieces(quantity) for _ in range(p.tangent)])


def _pieces(quantity: Quantity) -> list[tuple[Piece, float]]:
    found = manifold(quantity)
    moved = [p is Piece.NUMBER and not angle for p, angle in zip(found.pieces, found.angles, strict=True)]
    return [(p, quantity.scale.factor if m else 1.0) for p, m in zip(found.pieces, moved, strict=True)]


def coordinate_values(quantity: Quantity, numbers: Floats) -> Floats:
    """What a table shows for each tangent coordinate, SI, shape (…, tangent): rotation vector, translation, log c.

    Directions have no such coordinates of their own: zeros.
    """
    columns = []
    for piece, first, _ in manifold(quantity).spans():
        part = numbers[..., first : first + piece.size]
        if piece is Piece.QUATERNION:
            part = vector_of_quaternion(part)
        elif piece is Piece.SCALE:
            part = np.log(part)
        elif piece is Piece.SPHERE:
            part = np.zeros((*part.shape[:-1], piece.tangent))
        columns.append(part)
    return np.concatenate(columns, axis=-1)


@np.errstate(invalid="ignore")
def difference(quantity: Quantity, first: Floats, second: Floats) -> Floats:
    """What leads from one value of a quantity to another (…,), SI, with the shape of its sigmas; angles by half turns.

    Of rotations and the like the tangent coordinates at the first; NaN for directions, whose axes are not known here.
    """
    if quantity.kind not in GEOMETRIC:
        return np.asarray(half_turns(second - first) if quantity.kind is Kind.ANGLE else second - first)
    columns = []
    found = manifold(quantity)
    for (piece, start, _), angle in zip(found.spans(), found.angles, strict=True):
        mine, its = (each[..., start : start + piece.size] for each in (first, second))
        if piece is Piece.QUATERNION:
            columns.append(_turn(mine, its))
        elif piece is Piece.SCALE:
            columns.append(np.log(its / mine))
        elif piece is Piece.SPHERE:
            columns.append(np.full((*np.broadcast_shapes(mine.shape, its.shape)[:-1], piece.tangent), np.nan))
        else:
            columns.append(half_turns(its - mine) if angle else its - mine)
    return np.concatenate(columns, axis=-1)


def _turn(first: Floats, second: Floats) -> Floats:
    """The rotation vectors (…, 3) from one unit quaternion (…, 4) to another, about axes of the body."""
    back, forth = np.broadcast_arrays(first * CONJUGATE, second)
    flat = hamilton(back.reshape(-1, 4), forth.reshape(-1, 4))
    return np.asarray(vector_of_quaternion(flat).reshape(*forth.shape[:-1], 3))


def written(quantity: Quantity, numbers: Floats) -> Any:
    """One value (size,) as documents hold it; null where it is not finite. In the unit of the quantity."""
    shown = np.where(np.isfinite(numbers), numbers, np.nan) / number_factors(quantity)
    if not bool(np.isfinite(shown).all()):
        return None
    if quantity.kind is Kind.DIRECTION:
        return shown.tolist()
    found: dict[str, Any] = {}
    if quantity.dimension == 3:
        held = 4
        found["quaternion"] = shown[:4].tolist()
        found["matrix"] = matrix_of_quaternion(shown[:4]).tolist()
    else:
        held = 1
        angle = float(shown[0])
        c, s = float(np.cos(angle)), float(np.sin(angle))
        found["angle"] = float(angle - 2 * np.pi * np.ceil(angle / (2 * np.pi) - 0.5))
        found["matrix"] = [[c, -s], [s, c]]
    if quantity.kind in (Kind.POSE, Kind.SIMILARITY):
        found["translation"] = shown[held : held + quantity.dimension].tolist()
    if quantity.kind is Kind.SIMILARITY:
        found["scale"] = float(shown[-1])
    return found


def numbers_of_written(value: Mapping[str, Any]) -> list[float] | None:
    """The numbers of a rotation, pose or similarity as a document holds it; None if it is none."""
    translation, scale = value.get("translation", ()), value.get("scale")
    try:
        rest = [float(t) for t in translation] + ([] if scale is None else [float(scale)])
        if "angle" in value:
            return [float(value["angle"]), *rest]
        if "quaternion" in value and len(translation) != 2:
            return [*np.asarray(value["quaternion"], dtype=np.float64).tolist(), *rest]
        matrix = np.asarray(value["matrix"], dtype=np.float64)
        if bool(np.linalg.det(matrix) <= 0.0):
            return None
        if matrix.shape == (2, 2):
            return [float(np.arctan2(matrix[1, 0], matrix[0, 0])), *rest]
        return [*quaternion_of_matrix(matrix).tolist(), *rest] if matrix.shape == (3, 3) else None
    except (KeyError, TypeError, ValueError):  # np.linalg.LinAlgError, of what is not square, is a ValueError
        return None
