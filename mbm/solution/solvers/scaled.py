"""The linear algebra of one iteration: the column-scaled Jacobian, decomposed once, stepped along many times.

Never the normal equations: tall Jacobians are first reduced by one QR of ``[J r]``, the small rest by its SVD.
"""

from __future__ import annotations

from math import inf, sqrt

import numpy as np

from mbm.solution.triangle import triangle
from mbm.solution.types import Equations, Floats, Mask
from mbm.target.decisions import EPSILON, HUGE, TINY
from mbm.values import dataclass

TALL = 4
LARGE = 3000
"""From this ratio of rows to columns and this size on the QR reduction is cheaper than the whole SVD (measured)."""


def magnitudes(equations: Equations, coordinates: Floats) -> Floats:
    """The size (n,) of what rounds: ``|coordinates|``, 1 for rotations and directions, whose numbers are about 1."""
    size = np.abs(coordinates)
    curved = turning(equations)
    return size if curved is None else np.where(curved, 1.0, size)


def turning(equations: Equations) -> Mask | None:
    """Which coordinates (n,) are those of rotations, directions and scales; None where there is none.

    Only equations that have any need an attribute ``turning``; an instance check of a protocol would cost as much as
    the rest of a small step.
    """
    found: Mask | None = getattr(equations, "turning", None)
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scaled:
    """``J diag(1/scale) = U diag(singular) right`` and ``projected = Uᵀ r``; ``rank`` values are above rounding.

    ``right`` (k, n) with k = min(m, n); ``inside`` is ``‖Uᵀr‖²`` over the leading ``rank`` directions, what an undamped
    step would take off ``‖r‖²`` if the residuals were linear.
    """

    scale: Floats
    singular: Floats
    right: Floats
    projected: Floats
    rank: int
    inside: float

    def gauss_newton(self) -> Floats:
        """The minimum-norm least squares step in the scaled metric, in scaled coordinates (n,)."""
        k = self.rank
        return -((self.projected[:k] / self.singular[:k]) @ self.right[:k])

    def damped(self, radius: float, full: Floats) -> Floats:
        """Marquardt's step with the damping for which its length is ``radius`` (within 10 %), scaled coordinates (n,).

        ``full`` is the undamped step, longer than ``radius``. Moré (1978): Newton's iteration on ‖p(λ)‖ = Δ.
        """
        s = self.singular[: self.rank]
        squared = s * s
        weighted = s * self.projected[: self.rank]
        length = sqrt(float(full @ full))
        image = self.projected[: self.rank] / squared
        steepness = float(image @ image)
        ceiling = sqrt(float(weighted @ weighted)) / radius
        damping = length * (length - radius) / radius * length / steepness if 0.0 < steepness < inf else 1e-3 * ceiling
        damping = min(damping, ceiling)
        movement = weighted / (squared + damping)
        for _ in range(12):
            length = sqrt(float(movement @ movement))
            if abs(length - radius) <= 0.1 * radius:
                break
            slope = float(movement @ (movement / (squared + damping))) / length
            damping = max(damping + (length - radius) / radius * length / slope, 1e-3 * damping)
            movement = weighted / (squared + damping)
        return -(movement @ self.right[: self.rank])

    def bent(self, gradient: Floats, step: Floats) -> Floats:
        """The change of ``step`` that answers the curvature met along it, scaled coordinates (n,).

        ``gradient`` (n,) is ``(J/scale)ᵀ (r(x+step) - r - J step)``; the damping is the one that ``step`` itself obeys.
        Half the geodesic acceleration of Transtrum and Sethna (2012), from the trial point instead of an extra one.
        """
        s = self.singular[: self.rank]
        directions = self.right[: self.rank]
        along = directions @ step
        size = float(along @ along)
        image = s * along
        damping = max(-float(image @ (image + self.projected[: self.rank])) / size, 0.0) if size > 0.0 else 0.0
        return -(((directions @ gradient) / (s * s + damping)) @ directions)

    def steepest(self) -> tuple[Floats, float]:
        """The Cauchy step (to the minimum along the scaled gradient) in scaled coordinates, and its length."""
        k = self.rank
        weighted = self.singular[:k] * self.projected[:k]
        image = self.singular[:k] * weighted
        curvature = float(image @ image)
        if curvature == 0.0:
            return np.zeros(self.right.shape[1]), 0.0
        step = -(float(weighted @ weighted) / curvature) * (weighted @ self.right[:k])
        return step, sqrt(float(step @ step))

    def predicted(self, scaled_step: Floats) -> float:
        """Decrease of ``‖r‖²`` that the linear model promises for a step in scaled coordinates."""
        image = self.singular * (self.right @ scaled_step)
        return -float(image @ (image + 2.0 * self.projected))


def column_norms(jacobian: Floats) -> Floats:
    """Euclidean norm of each column (n,) without overflow or underflow on the way."""
    norms: Floats = np.sqrt(np.einsum("ij,ij->j", jacobian, jacobian))
    if norms.size and not (norms.min() > TINY and norms.max() < inf):
        largest = np.abs(jacobian).max(axis=0, initial=0.0)
        divisor = np.where(largest > 0.0, largest, 1.0)
        norms = np.minimum(divisor * np.sqrt(np.square(jacobian / divisor).sum(axis=0)), HUGE)
        norms[largest == 0.0] = 0.0
    return norms


def decompose(jacobian: Floats, residuals: Floats, scale: Floats) -> Scaled:
    """Decompose ``jacobian / scale``; jacobian (m, n), residuals (m,), scale (n,) > 0."""
    m, n = jacobian.shape
    if n == 0:
        none = np.zeros(0)
        return Scaled(scale=scale, singular=none, right=np.zeros((0, 0)), projected=none, rank=0, inside=0.0)
    if m > TALL * n and m * n > LARGE:
        stacked = np.empty((m, n + 1))
        np.divide(jacobian, scale, out=stacked[:, :n])
        stacked[:, n] = residuals
        reduced = triangle(stacked)
        matrix, head = reduced[:n, :n], reduced[:n, n]
    else:
        matrix, head = jacobian / scale, residuals
    left, singular, right = np.linalg.svd(matrix, full_matrices=False)
    projected = head @ left
    largest = float(singular[0])
    rank = int((singular > EPSILON * max(m, n) * largest).sum()) if largest > 0.0 else 0
    inside = float(projected[:rank] @ projected[:rank])
    return Scaled(scale=scale, singular=singular, right=right, projected=projected, rank=rank, inside=inside)
