"""Estimates and derived values → their scalars, named and in the unit that is shown.

The numbers of rotations, poses, similarities and directions are those that `mbm.problem.manifold` describes; sigmas
belong to tangent coordinates: rotation vector (rad), translation, logarithm of the scale (CONTRACT §2).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from mbm.equations.layout import half_turns
from mbm.problem.manifold import Manifold, Piece, manifold_of
from mbm.problem.naming import member_name, scalar_name
from mbm.report.digits import Measured, enclosed, measured
from mbm.report.types import DerivedValue, Estimate, Floats, Key, Kind, Mask, Quantity, SolveReport
from mbm.rotations import CONJUGATE, hamilton, matrix_of_quaternion, quaternion_of_matrix, signed, vector_of_quaternion
from mbm.scales import SI
from mbm.text.printer import plain_number
from mbm.values import dataclass

NO_ROTATION = 1e-3
"""Largest entry of R Rᵀ − 1 of a matrix that is a rotation, written with four digits."""

GEOMETRIC = frozenset({Kind.DIRECTION, Kind.ROTATION, Kind.POSE, Kind.SIMILARITY})
"""Kinds whose sigmas belong to a tangent space."""


def manifold(quantity: Quantity) -> Manifold:
    """How the numbers of a geometric quantity vary."""
    return manifold_of(quantity.kind.value, quantity.dimension, 0)


def number_factors(quantity: Quantity) -> Floats:
    """SI per unit shown for each number; only translations have a unit."""
    return np.array([f for p, f in _pieces(quantity) for _ in range(p.size)])


def quaternion_places(quantity: Quantity, size: int) -> list[int]:
    """Where quaternions begin among the numbers (size,) of a quantity, of all its members one after the other."""
    if quantity.kind not in GEOMETRIC:
        return []
    found = manifold(quantity)
    own = [first for piece, first, _ in found.spans() if piece is Piece.QUATERNION]
    return [member + first for member in range(0, size, found.size) for first in own]


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


def shown_numbers(quantity: Quantity, numbers: Floats) -> Floats:
    """The numbers (…, size) of rotations, poses, similarities or directions in the unit of the quantity; quaternions
    have the sign that is reported.
    """
    shown = numbers / number_factors(quantity)
    for first in quaternion_places(quantity, shown.shape[-1]):
        shown[..., first : first + 4] = signed(shown[..., first : first + 4])
    return np.asarray(shown)


def written(quantity: Quantity, numbers: Floats) -> Any:
    """One value (size,) as documents hold it; null where it is not finite. In the unit of the quantity."""
    shown = shown_numbers(quantity, np.where(np.isfinite(numbers), numbers, np.nan))
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
        turned = bool(np.abs(matrix @ matrix.T - np.eye(len(matrix))).max() > NO_ROTATION)
        if turned or bool(np.linalg.det(matrix) <= 0.0):
            return None
        if matrix.shape == (2, 2):
            return [float(np.arctan2(matrix[1, 0], matrix[0, 0])), *rest]
        return [*quaternion_of_matrix(matrix).tolist(), *rest] if matrix.shape == (3, 3) else None
    except (KeyError, TypeError, ValueError):  # np.linalg.LinAlgError, of what is not square, is a ValueError
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Scalar:
    """One number of an estimate, in the quantity's unit; ``sigma`` is NaN where there is none, 0 where ``fixed``.

    ``quantity`` and ``estimate`` tell where it comes from; ``derived`` values are computed from the estimates.
    ``bounds`` are guaranteed ones, if it has any.
    """

    name: str
    value: float
    sigma: float
    quantity: Quantity
    fixed: bool = False
    at_bound: bool = False
    derived: bool = False
    reason: str | None = None
    bounds: tuple[float, float] | None = None


def plain_key(key: Key) -> str | int | float | None:
    """A key as JSON has it: whole numbers as integers, None in place of NaN and infinity."""
    if isinstance(key, str):
        return key
    return plain_number(key) if math.isfinite(key) else None


def element_names(quantity: Quantity, keys: tuple[Key, ...] | None = None) -> tuple[str, ...]:
    """``p``, ``p[1]``, ``theta[2,1]``, ``q["waist"]``, ``w@12[1]``: the names of all scalars, row by row."""
    if quantity.kind in GEOMETRIC:
        places = list(manifold(quantity).labels)
    else:
        indices = product(*(range(1, n + 1) for n in quantity.shape))
        places = [scalar_name("", None, index) for index in indices]
    names = (own_name(quantity, key) for key in ((None,) if keys is None else keys))
    return tuple(name + place for name in names for place in places)


def own_name(quantity: Quantity, key: Key | None) -> str:
    """A quantity, or its member: ``q["waist"]``, ``w@12``."""
    return member_name(quantity.name, key, at_step=quantity.over is not None)


def shown_sigma(item: Estimate | DerivedValue) -> Floats:
    """The standard deviations in the unit of the quantity, with the shape of ``value``, as every output gives them.

    Fixed elements have 0; NaN stands for those held at a bound, those without a value, and where none was computed.
    """
    value = _coordinates(item)
    if item.sigma is None:
        sigma = np.full(np.shape(value), math.nan)
    else:
        sigma = np.where(np.isfinite(value), item.sigma, math.nan)
    if isinstance(item, Estimate):
        if item.at_bound is not None:
            sigma = np.where(item.at_bound, math.nan, sigma)
        sigma = np.where(item.fixed, 0.0, sigma)
    return np.asarray(sigma / factors(item.quantity), dtype=np.float64)


def shown_bounds(item: Estimate | DerivedValue) -> Floats | None:
    """Guaranteed bounds in the unit of the quantity, (…, 2) behind the shape of ``sigma``, rounded outwards; None: the
    item has standard deviations.
    """
    if item.bounds is None:
        return None
    found = np.moveaxis(in_unit(item.quantity, np.moveaxis(np.asarray(item.bounds), -1, 0)), 0, -1)
    if not item.quantity.scale.is_si:
        outward = np.nextafter(found, np.array([-np.inf, np.inf]))
        found = np.where(found == 0.0, 0.0, outward)
    return np.asarray(found, dtype=np.float64)


def shown_values(item: Estimate | DerivedValue) -> Floats:
    """The values of the scalars in the unit of the quantity: of rotations and the like, the tangent coordinates."""
    return np.asarray(in_unit(item.quantity, _coordinates(item)), dtype=np.float64)


def factors(quantity: Quantity) -> Floats | float:
    """SI per unit shown of differences, along the last axis of sigmas."""
    return coordinate_factors(quantity) if quantity.kind in GEOMETRIC else quantity.scale.factor


def in_unit(quantity: Quantity, values: Floats) -> Floats:
    """Values with the shape of sigmas, SI, in the unit of the quantity."""
    if quantity.kind in GEOMETRIC:
        return np.asarray(values / coordinate_factors(quantity))
    return quantity.scale.from_si(values)


def scalars(item: Estimate | DerivedValue) -> Iterator[Scalar]:
    """The scalars of an estimate or a derived value, in the order of `element_names`."""
    quantity = item.quantity
    names = element_names(quantity, item.keys)
    values = np.ravel(shown_values(item))
    sigmas = np.ravel(shown_sigma(item))
    estimate = item if isinstance(item, Estimate) else None
    fixed = _flags(estimate.fixed if estimate else None, len(names))
    held = _flags(estimate.at_bound if estimate else None, len(names))
    bounds = shown_bounds(item)
    ends = None if bounds is None else bounds.reshape(-1, 2).tolist()
    for i, name in enumerate(names):
        yield Scalar(
            name=name,
            value=float(values[i]),
            sigma=float(sigmas[i]),
            quantity=coordinate_quantity(quantity, i),
            fixed=fixed[i],
            at_bound=held[i],
            derived=estimate is None,
            reason=item.reason,
            bounds=None if ends is None else (ends[i][0], ends[i][1]),
        )


def _coordinates(item: Estimate | DerivedValue) -> Floats:
    """The values that scalars show, SI: those of the tangent coordinates for rotations and the like."""
    if item.quantity.kind in GEOMETRIC:
        return coordinate_values(item.quantity, np.asarray(item.value))
    return np.asarray(item.value)


def coordinate_quantity(quantity: Quantity, place: int) -> Quantity:
    """The quantity of one scalar: coordinates of rotations are angles, those of scales pure numbers."""
    if quantity.kind not in GEOMETRIC:
        return quantity
    found = manifold(quantity)
    label = found.labels[place % found.tangent]
    if label.startswith(".trans"):
        return replace(quantity, kind=Kind.REAL)
    return replace(quantity, kind=Kind.REAL if label == ".logscale" else Kind.ANGLE, unit=None, scale=SI)


def solve_scalars(solve: SolveReport) -> Iterator[Scalar]:
    """The scalars of all estimates of a solve, then those of its derived values."""
    for estimate in solve.estimates:
        yield from scalars(estimate)
    for value in solve.derived:
        yield from scalars(value)


def number_text(scalar: Scalar) -> Measured:
    """The value with its standard deviation, or the bounds."""
    if scalar.bounds is not None and not scalar.fixed:
        return Measured(enclosed(*scalar.bounds))
    return measured(scalar.value, scalar.sigma, exact=scalar.fixed or scalar.at_bound)


def unit_text(quantity: Quantity) -> str:
    """The unit as people read it: ``rad`` for an angle that states none, empty where none is known."""
    return quantity.unit or ("rad" if quantity.kind is Kind.ANGLE else "")


def _flags(mask: Mask | None, size: int) -> list[bool]:
    return [False] * size if mask is None else [bool(flag) for flag in np.ravel(mask)]
