"""Equations that depend on a motion only through the place of one point of each row: which point that is.

``h(T) = f(T x)`` or ``h(T) = f(T⁻¹ x)``: the derivatives of h by rotation and by translation determine x, whatever f
is, since ``∂h/∂ω = f' R [−x]×`` and ``∂h/∂t = f'``. Two probes give x; random motions then decide whether it is so.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Mask
from mbm.estimation.starts.closed_forms.frames import Frame, frames_of, some_rotation
from mbm.estimation.starts.closed_forms.rows import Rows
from mbm.estimation.starts.closed_forms.types import AGREEMENT, Candidate
from mbm.rotations import cross_matrix, inverse_motion
from mbm.values import dataclass

PROBES = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MovedPoints:
    """The points ``x`` (n, d) of rows that mention nothing of a motion but ``T x`` (``T⁻¹ x`` if ``inverse``)."""

    rows: Rows
    frame: Frame
    inverse: bool
    points: Floats

    def at_places(self, places: Floats) -> Floats:
        """Motions without rotation that put each row's point at its place (n, d): their numbers, row by row (n, s)."""
        shift = self.points - places if self.inverse else places - self.points
        R = np.broadcast_to(np.eye(self.frame.dimension), (len(places), self.frame.dimension, self.frame.dimension))
        return self.frame.numbers(np.ones(len(places)), R, shift)

    def numbers(self, R: Floats, t: Floats) -> Floats:
        """Those (…, s) of motions of which rotations R (…, d, d) and translations t (…, d) take points to places."""
        R, t = inverse_motion(R, t) if self.inverse else (R, t)
        return self.frame.numbers(np.ones(t.shape[:-1]), R, t)

    def values(self, places: Floats) -> Floats:
        """f (n, width) with each row's point at its place (n, d), or all at one (d,)."""
        return self.rows.values(self.at_places(np.broadcast_to(places, self.points.shape)))

    def slopes(self, places: Floats) -> Floats:
        """The derivative of f by the place (n, width, d)."""
        numbers = self.at_places(np.broadcast_to(places, self.points.shape))
        found = self.frame.slopes(self.rows.slopes(numbers), np.eye(self.frame.dimension)).translation
        if found is None:
            message = "a motion without a translation moves no point to a place"
            raise ValueError(message)
        return -found if self.inverse else found

    def picked(self, mask: Mask) -> MovedPoints:
        """Some of the rows."""
        return MovedPoints(
            rows=self.rows.picked(mask), frame=self.frame, inverse=self.inverse, points=self.points[mask]
        )


def moved_points(candidate: Candidate, rows: Rows) -> MovedPoints | None:
    """The points that a candidate moves in all of ``rows``, if that is all that they know of it."""
    if not len(rows):
        return None
    for frame in frames_of(candidate):
        if not frame.moves:
            continue
        for inverse in (False, True):
            generator = np.random.default_rng(0)
            points = points_of(rows, frame, inverse, generator)
            if points is None:
                continue
            found = MovedPoints(rows=rows, frame=frame, inverse=inverse, points=points)
            if _holds(found, generator):
                return found
    return None


def _motion(frame: Frame, generator: np.random.Generator, size: float) -> tuple[float, Floats, Floats]:
    c = float(np.exp(generator.uniform(-0.3, 0.3))) if frame.scales else 1.0
    t = size * generator.uniform(0.3, 1.0, size=frame.dimension) * generator.choice([-1.0, 1.0], size=frame.dimension)
    return c, some_rotation(frame.dimension, generator), t


def points_of(rows: Rows, frame: Frame, inverse: bool, generator: np.random.Generator) -> Floats | None:
    """What the derivatives say the points are, (n, d); None where they leave one open.

    ``v × a = w`` for each equation, with a = Rᵀ ∂h/∂t and w = ∂h/∂ω (the inverse motion: with its own signs).
    """
    d = frame.dimension
    normal, right = np.zeros((len(rows), d, d)), np.zeros((len(rows), d))
    for _ in range(PROBES):
        c, R, t = _motion(frame, generator, 1.0)
        slopes = frame.slopes(rows.slopes(frame.numbers(np.asarray(c), R, t)), R)
        if slopes.translation is None or not bool(np.isfinite(slopes.translation).all()):
            return None
        a, w = slopes.translation, slopes.rotation
        if inverse:  # h = f(Rᵀ(v − t)/c): w = Rᵀ((v − t) × a)
            w = _cross(np.broadcast_to(t, a.shape), a) + (w if d == 2 else w @ R.T)
        else:  # h = f(c R v + t): w = v × c Rᵀa
            a = c * a @ R
        size = np.maximum(np.linalg.norm(a, axis=(1, 2), keepdims=True), 1e-300)  # a point may be near an eye
        a, w = a / size, w / size
        operator = _cross_operator(a)
        normal += np.einsum("nkpi,nkpj->nij", operator, operator)
        right += np.einsum("nkpi,nkp->ni", operator, w)
    if not bool(np.isfinite(normal).all() and np.isfinite(right).all()):  # slopes whose squares are beyond numbers
        return None
    values = np.linalg.eigvalsh(normal)
    if bool((values[:, 0] <= 1e-10 * values[:, -1]).any()):
        return None
    return np.asarray(np.linalg.solve(normal, right[..., None])[..., 0])


def _cross(v: Floats, a: Floats) -> Floats:
    """V × a: (…, 3) in space, (…, 1) in the plane."""
    if v.shape[-1] == 3:
        return np.cross(v, a)
    return (v[..., 0] * a[..., 1] - v[..., 1] * a[..., 0])[..., None]


def _cross_operator(a: Floats) -> Floats:
    """The matrices (…, p, d) with ``A v = v × a``."""
    if a.shape[-1] == 3:
        return -cross_matrix(a)
    return np.stack([a[..., 1], -a[..., 0]], axis=-1)[..., None, :]


def _holds(found: MovedPoints, generator: np.random.Generator) -> bool:
    """Whether the equations do depend on the places of the points alone."""
    size = 1.0 + float(np.abs(found.points).max())
    frame = found.frame
    for _ in range(2):
        c, R, t = _motion(frame, generator, size)
        moved = ((found.points - t) @ R / c) if found.inverse else c * found.points @ R.T + t
        direct = found.rows.values(frame.numbers(np.asarray(c), R, t))
        shifted = found.values(moved)
        scale = np.abs(direct).max(axis=1) + np.abs(found.values(moved * 1.25)).max(axis=1)
        if not bool((np.abs(direct - shifted).max(axis=1) <= AGREEMENT * scale).all()):
            return False
    return True
