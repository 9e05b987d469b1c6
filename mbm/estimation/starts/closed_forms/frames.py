"""Unknowns that hold a motion of the plane or of space: how its parts are written into their numbers."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations
from typing import Protocol

import numpy as np

from mbm.equations.types import Floats
from mbm.estimation.starts.closed_forms.rows import finite
from mbm.estimation.starts.closed_forms.types import Candidate
from mbm.problem.types import UnknownKind
from mbm.rotations import cross_matrix, euler_angles, from_euler, planar, quaternion_of_matrix, vector_of_quaternion
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Slopes:
    """Derivatives of equations (…, width, ·) by ``ω`` in ``R Exp(ω)``, and by t in ``t + v``."""

    rotation: Floats
    translation: Floats | None


class Frame(Protocol):
    """A motion ``x → c R x + t`` as numbers; ``moves`` and ``scales`` say whether it has t and c."""

    @property
    def dimension(self) -> int:
        """2 or 3."""
        ...

    @property
    def moves(self) -> bool:
        """It has a translation."""
        ...

    @property
    def scales(self) -> bool:
        """It has a scale."""
        ...

    def numbers(self, c: Floats, R: Floats, t: Floats) -> Floats:
        """The numbers (…, s) of scales (…), rotations (…, d, d) and translations (…, d)."""
        ...

    def slopes(self, derivatives: Floats, R: Floats) -> Slopes:
        """Derivatives (…, width, q) by the candidate's coordinates at rotation R, sorted by what they turn and move."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class WholeFrame:
    """One unknown of kind rotation, pose or similarity; or a rotation and a position that is an unknown of its own.

    ``before``: so many coordinates of the position stand before the rotation.
    """

    dimension: int
    moves: bool
    scales: bool
    before: int = 0

    def numbers(self, c: Floats, R: Floats, t: Floats) -> Floats:
        """Quaternion or angle, translation, scale."""
        parts = [_rotation_numbers(R, self.dimension)]
        if self.moves:
            parts = [t[..., : self.before], *parts, t[..., self.before :]]
        if self.scales:
            parts.append(c[..., None])
        return np.concatenate(parts, axis=-1)

    def slopes(self, derivatives: Floats, R: Floats) -> Slopes:
        """The coordinates are those of ``Slopes``, in this order."""
        turns = 3 if self.dimension == 3 else 1
        turned = np.arange(self.before, self.before + turns)
        others = np.delete(derivatives, turned, axis=-1)
        return Slopes(
            rotation=derivatives[..., turned],
            translation=others[..., : self.dimension] if self.moves else None,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SeparateFrame:
    """Angles and a position as plain numbers: Euler angles ``Rz(ψ) Ry(θ) Rx(φ)`` in space, one angle in the plane.

    ``angles`` are the columns of φ, θ, ψ (or of the angle), ``position`` those of the coordinates of t, ``scale`` that
    of c or None.
    """

    angles: tuple[int, ...]
    position: tuple[int, ...]
    scale: int | None = None

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return len(self.position)

    @property
    def moves(self) -> bool:
        """It has a translation."""
        return True

    @property
    def scales(self) -> bool:
        """It has a scale."""
        return self.scale is not None

    def numbers(self, c: Floats, R: Floats, t: Floats) -> Floats:
        """Angles and coordinates, each in its column."""
        size = len(self.angles) + len(self.position) + self.scales
        found = np.full((*t.shape[:-1], size), np.nan)
        found[..., list(self.position)] = t
        if self.scale is not None:
            found[..., self.scale] = c
        if self.dimension == 2:
            found[..., self.angles[0]] = np.arctan2(R[..., 1, 0], R[..., 0, 0])
        else:
            found[..., list(self.angles)] = euler_angles(R)
        return found

    def slopes(self, derivatives: Floats, R: Floats) -> Slopes:
        """Rates of Euler angles turned into those of the rotation vector: ``ω = E (φ', θ', ψ')``."""
        by_angle = derivatives[..., list(self.angles)]
        if self.dimension == 3:
            f, t, _ = np.moveaxis(euler_angles(R), -1, 0)
            zero, one = np.zeros_like(f), np.ones_like(f)
            rates = np.stack(
                [
                    np.stack([one, zero, -np.sin(t)], axis=-1),
                    np.stack([zero, np.cos(f), np.cos(t) * np.sin(f)], axis=-1),
                    np.stack([zero, -np.sin(f), np.cos(t) * np.cos(f)], axis=-1),
                ],
                axis=-2,
            )
            by_angle = by_angle @ np.linalg.inv(rates)
        return Slopes(
            rotation=by_angle,
            translation=derivatives[..., list(self.position)],
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class RotationVectorFrame:
    """A rotation vector and a position in space as six plain numbers, in this order of columns."""

    vector: tuple[int, ...]
    position: tuple[int, ...]
    dimension: int = 3
    moves: bool = True
    scales: bool = False

    def numbers(self, c: Floats, R: Floats, t: Floats) -> Floats:
        """The rotation vector, no longer than π, and the position, each in its columns."""
        del c
        found = np.full((*t.shape[:-1], 6), np.nan)
        found[..., list(self.vector)] = vector_of_quaternion(_rotation_numbers(R, 3))
        found[..., list(self.position)] = t
        return found

    def slopes(self, derivatives: Floats, R: Floats) -> Slopes:
        """By ω in ``Exp(r) Exp(ω)``: the inverse of the right Jacobian of SO(3)."""
        r = vector_of_quaternion(quaternion_of_matrix(R))
        angle, K = float(np.linalg.norm(r)), cross_matrix(r)
        factor = 1 / 12 if angle < 1e-4 else 1 / angle**2 - (1 + np.cos(angle)) / (2 * angle * np.sin(angle))
        inverse = np.eye(3) + 0.5 * K + factor * (K @ K)
        return Slopes(
            rotation=derivatives[..., list(self.vector)] @ inverse,
            translation=derivatives[..., list(self.position)],
        )


def frames_of(candidate: Candidate) -> Iterator[Frame]:
    """The motions that a candidate's numbers may hold, likelier ones first."""
    kinds = [entry.unknown.kind for entry in candidate.entries]
    if len(kinds) == 1 and kinds[0] in (UnknownKind.ROTATION, UnknownKind.POSE, UnknownKind.SIMILARITY):
        yield WholeFrame(
            dimension=candidate.entries[0].unknown.dimension,
            moves=kinds[0] is not UnknownKind.ROTATION,
            scales=kinds[0] is UnknownKind.SIMILARITY,
        )
    elif UnknownKind.ROTATION in kinds:
        yield from _rotation_and_position(candidate)
    if not candidate.flat or any(candidate.entries[i].unknown.dimension for i in range(len(kinds))):
        return
    angles = [int(i) for i in np.flatnonzero(candidate.angles)]
    others = [int(i) for i in np.flatnonzero(~candidate.angles)]
    if len(angles) == 1 and len(others) == 2:
        yield SeparateFrame(angles=tuple(angles), position=tuple(others))
    if len(angles) == 1 and len(others) == 3:
        for scale in others:
            yield SeparateFrame(angles=tuple(angles), position=tuple(i for i in others if i != scale), scale=scale)
    if not angles and len(others) == 6:
        yield RotationVectorFrame(vector=tuple(others[:3]), position=tuple(others[3:]))
        yield RotationVectorFrame(vector=tuple(others[3:]), position=tuple(others[:3]))
    if len(angles) == 3 and len(others) == 3:
        for order in permutations(angles):
            yield SeparateFrame(angles=order, position=tuple(others))


def _rotation_and_position(candidate: Candidate) -> Iterator[WholeFrame]:
    """A rotation, and as many plain numbers as make a position, of one other unknown or several."""
    turned = [entry for entry in candidate.entries if entry.unknown.kind is UnknownKind.ROTATION]
    others = [entry for entry in candidate.entries if entry not in turned]
    if len(turned) > 1 or not all(entry.unknown.manifold.flat and not entry.unknown.dimension for entry in others):
        return
    unknown, places = turned[0].unknown, candidate.places[0]
    if candidate.places.shape[1] == unknown.size + unknown.dimension:
        before = int((places < turned[0].range.start).sum())
        yield WholeFrame(dimension=unknown.dimension, moves=True, scales=False, before=before)


def _rotation_numbers(R: Floats, dimension: int) -> Floats:
    if dimension == 2:
        return np.arctan2(R[..., 1, 0], R[..., 0, 0])[..., None]
    known = finite(R, (-2, -1))
    safe = np.where(known[..., None, None], R, np.eye(3))
    return np.where(known[..., None], quaternion_of_matrix(safe), np.nan)


def some_rotation(dimension: int, generator: np.random.Generator) -> Floats:
    """A random rotation (d, d), away from where Euler angles lock."""
    angles = generator.uniform(-1.2, 1.2, size=3)
    return planar(2 * angles[0]) if dimension == 2 else from_euler(angles)
