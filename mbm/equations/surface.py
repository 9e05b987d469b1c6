"""Equations on the surface that curved constraints leave: every step is brought back to it.

Intervals along the tangent space of such constraints are as wrong as those of a bent model: a point of a circle that is
known to a tenth of its radius lies on an arc, not on a straight line.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import affine
from mbm.equations.metric import Forwarding
from mbm.equations.types import Floats, Indices, Mask, Minimum
from mbm.values import dataclass

MOST_ROUNDS = 30
RANK = 1e-15
"""Share of the largest singular value below which constraints depend on one another."""

CLOSE = 1e-9
"""Step back to the surface, in units in which the columns of the Jacobian have length 1, that counts as none."""

SHRINKING = 0.1
"""Part of the step before up to which slopes are kept: what a last step leaves is less than that part of it."""

NEAR = 0.01
"""The same where slopes are those of the point that steps begin at: then the way back is the shortest, or nearly so."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OnSurface(Forwarding):
    """The ``equations`` of a problem whose constraints ``holding`` (c,) keep steps on a surface.

    ``scale`` (n,) are the lengths of the columns of the Jacobian, in which the way back to the surface is shortest.
    """

    equations: Assembled
    holding: Indices
    scale: Floats

    @property
    def linear(self) -> bool:
        """Never along a curved surface."""
        return False

    def residuals_at(self, points: Floats) -> Floats:
        """Residuals (P, m) at points (P, N)."""
        return self.equations.residuals_at(points)

    def jacobian(self, x: Floats) -> Floats:
        """Derivatives (m, n) of the residuals by a step that is brought back."""
        jacobian = self.equations.jacobian(x)
        slopes = self.equations.constraint_jacobian(x)[self.holding]
        normals = slopes.T / np.square(self.scale)[:, None]
        return np.asarray(jacobian - (jacobian @ normals) @ np.linalg.pinv(slopes @ normals) @ slopes)

    def retract(self, x: Floats, step: Floats) -> Floats:
        """The points (…, N) of the surface near those after the steps (…, n); NaN where none is found."""
        moved = self.equations.retract(x, step)
        if moved.ndim == 1:
            return self._back(moved)
        found = self._all_back(x[0], moved)
        for k in np.flatnonzero(np.isnan(found).all(axis=1)):
            found[k] = self._back(moved[k])
        return found

    @np.errstate(all="ignore")
    def _all_back(self, start: Floats, points: Floats) -> Floats:
        """All points (P, N), brought back together by the slopes at the ``start``; NaN those too far from it."""
        slopes = self.equations.constraint_jacobian(start)[self.holding] / self.scale
        if not np.isfinite(slopes).all():
            return np.full(points.shape, np.nan)
        inverse = np.linalg.pinv(slopes, rcond=RANK).T
        last = np.full(len(points), np.inf)
        under_way = np.ones(len(points), dtype=bool)
        for _ in range(MOST_ROUNDS):
            steps = -self._values_at(points) @ inverse
            points = self.equations.retract(points, steps / self.scale)
            length = np.abs(steps).max(axis=1, initial=0.0)
            shrinking = length <= np.where(np.isinf(last), np.inf, np.maximum(NEAR * last, CLOSE))
            points[under_way & ~shrinking] = np.nan
            under_way &= shrinking & (length > CLOSE)
            last = length
            if not under_way.any():
                break
        points[under_way] = np.nan
        return points

    def _values_at(self, points: Floats) -> Floats:
        """Values (P, c) of the constraints at points (P, N)."""
        parts = [group.values_at(points).reshape(len(points), -1) for group in self.equations.constraints]
        return np.hstack(parts)[:, self.holding]

    @np.errstate(all="ignore")
    def _back(self, point: Floats) -> Floats:
        """Newton's method, each step the shortest to where the linearised constraints hold.

        While steps shrink fast the slopes are those of a point before: they cost more than some steps more.
        """
        slopes: Floats | None = None
        last = np.inf
        for _ in range(MOST_ROUNDS):
            values = self.equations.constraint_values(point)[self.holding]
            if slopes is None:
                slopes = self.equations.constraint_jacobian(point)[self.holding] / self.scale
            if not (np.isfinite(values).all() and np.isfinite(slopes).all()):
                break
            step = -_shortest(slopes, values)
            point = self.equations.retract(point, step / self.scale)
            length = float(np.abs(step).max(initial=0.0))
            if length <= CLOSE:
                return point
            slopes, last = (None if length > SHRINKING * last else slopes), length
        return np.full(len(point), np.nan)


def _shortest(slopes: Floats, values: Floats) -> Floats:
    """The shortest c (n,) with slopes (k, n) @ c = values; by least squares where these depend on one another.

    NaN where there is no slope to follow.
    """
    if len(values) == 1:
        length = float(slopes[0] @ slopes[0])
        far = np.nan if values[0] != 0.0 else 0.0
        return slopes[0] * (values[0] / length) if length > 0.0 else np.full(slopes.shape[1], far)
    return np.asarray(np.linalg.lstsq(slopes, values, rcond=RANK)[0])


def on_surface(equations: Assembled, minimum: Minimum) -> OnSurface | None:
    """The equations along the surface of the constraints that hold at a minimum; None where that is straight."""
    state = minimum.constraints
    if state is None or minimum.blocks is not None or not equations.constraints:
        return None
    holding = state.forcing
    if not bool((holding & ~exact_constraints(equations)).any()):
        return None
    scale = np.sqrt(np.square(minimum.jacobian).sum(axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    return OnSurface(equations=equations, holding=np.flatnonzero(holding), scale=scale)


def plainly_affine(equations: Assembled) -> bool:
    """Whether all equations are affine in the free coordinates, losses aside."""
    free = equations.is_free
    plain = equations.implicit is None and not equations.likely
    return equations.linear or (plain and all(affine(group, free) for group in equations.groups))


def affine_by_products(equations: Assembled) -> bool:
    """Whether derivatives are the same everywhere, and products of data: known to roundings of their own size.

    Of equations, losses aside, and constraints, in all coordinates, fixed ones too.
    """
    if equations.implicit is not None or equations.likely:
        return False
    groups = (*equations.groups, *equations.constraints)
    return all(group.gathered is None and not group.sampled and group.kernel.affine_by_products for group in groups)


def exact_constraints(equations: Assembled) -> Mask:
    """Which of the constraints (c,) are affine in the free coordinates, so that their limits stay where they are."""
    plain = equations.is_free
    found = np.zeros(len(equations.equality), dtype=bool)
    for group in equations.constraints:
        found[group.first : group.first + group.count] = affine(group, plain)
    return found
