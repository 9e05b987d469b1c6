"""Equations on the surface that curved constraints leave: every step is brought back to it.

Intervals along the tangent space of such constraints are as wrong as those of a bent model: a point of a circle that is
known to a tenth of its radius lies on an arc, not on a straight line.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import ALL, DENSE_PART, Group, affine
from mbm.equations.metric import Forwarding
from mbm.equations.types import Floats, Indices, Mask, Minimum
from mbm.values import dataclass

MOST_ROUNDS = 30
RANK = 1e-15
"""Share of the largest singular value below which constraints depend on one another."""

CLOSE = 1e-9
"""Step back to the surface, in units in which the columns of the Jacobian have length 1, that counts as none."""


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
            return np.asarray(self._back(moved[None])[0])
        size = len(self.equations.equality) * self.equations.dimension
        some = max(DENSE_PART // max(size, 1), 1)
        return np.concatenate([self._back(moved[i : i + some]) for i in range(0, max(len(moved), 1), some)])

    def _linearised(self, points: Floats) -> tuple[Floats, Floats]:
        """The constraints (P, c) at points (P, N), and their derivatives (P, c, n) in the units of ``scale``."""
        columns, width = self.equations.columns, self.equations.dimension
        parts = [_linearised(group, points, columns, width) for group in self.equations.constraints]
        values, slopes = (np.concatenate(each, axis=1) for each in zip(*parts, strict=True))
        return values[:, self.holding], slopes[:, self.holding] / self.scale

    @np.errstate(all="ignore")
    def _back(self, points: Floats) -> Floats:
        """Newton's method at points (P, N), each step the shortest to where the linearised constraints hold."""
        found = np.full(points.shape, np.nan)
        under_way = np.arange(len(points))
        for _ in range(MOST_ROUNDS):
            values, slopes = self._linearised(points)
            finite = np.isfinite(values).all(axis=1) & np.isfinite(slopes).all(axis=(1, 2))
            under_way, points = under_way[finite], points[finite]
            steps = -_shortest(slopes[finite], values[finite])
            points = self.equations.retract(points, steps / self.scale)
            there = np.abs(steps).max(axis=1, initial=0.0) <= CLOSE
            found[under_way[there]] = points[there]
            under_way, points = under_way[~there], points[~there]
            if not len(under_way):
                break
        return found


def _linearised(group: Group, points: Floats, columns: Indices, width: int) -> tuple[Floats, Floats]:
    """Outputs (P, rows · outputs) at points (P, N) and their derivatives (P, rows · outputs, ``width``)."""
    shape = (len(points), group.count)
    if group.gathered is not None:
        slopes = np.stack([group.dense_jacobian(point, columns, width) for point in points])
        return group.values_at(points).reshape(shape), slopes.reshape(*shape, width)
    inputs = group.inputs_at(points, ALL)
    values, nonzeros = group.cache.stream(group.number, group.kernel).values_and_jacobian(inputs)
    slopes = np.zeros((len(inputs), group.kernel.outputs, width))
    if not all(group.shared_columns):
        group = replace(group, columns=np.tile(group.columns, (len(points), 1)))
    group.scatter(columns).add(nonzeros, slopes)
    return values.reshape(shape), slopes.reshape(*shape, width)


def _shortest(slopes: Floats, values: Floats) -> Floats:
    """The shortest c (P, n) with slopes (P, k, n) @ c = values (P, k); by least squares where these depend on one
    another. NaN where there is no slope to follow.
    """
    if values.shape[1] == 1:
        lengths = np.square(slopes[:, 0]).sum(axis=1, keepdims=True)
        far = np.where(values != 0.0, np.nan, 0.0)
        return np.where(lengths > 0.0, slopes[:, 0] * (values / lengths), far)
    return np.asarray((np.linalg.pinv(slopes, rcond=RANK) @ values[:, :, None])[:, :, 0])


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
