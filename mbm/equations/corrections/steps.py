"""One step of the inner problem, for all components at once: the corrections of the linearised conditions.

The linearised problem: minimise ``½|u|² + ½|e|² + ½ dᵀ W d`` with ``h + B d = e`` (e = 0 where an equation has no noise
of its own), where ``d`` is the change of u and W the curvature ``∇²(λᵀh)``: Gauss-Helmert's step for W = 0, else
Newton's.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Mask

LEVEL = 1.0 + 1e-6
"""A singular reduced Hessian counts as positive definite: at the centre of a circle every point of it is nearest."""

SOFTNESS = 1e-8
"""Weight of a condition against the corrections, where the curvature along the conditions is asked for."""


LEAST_DETERMINANT = 0.1


def step(slopes: Floats, curvature: Floats | None, noisy: Mask, values: Floats, at: Floats) -> tuple[Floats, Floats]:
    """The next corrections (R, q) and the multipliers (R, k); not finite where a system has no solution.

    ``slopes`` (R, k, q), ``curvature`` (R, q, q) or None for none, ``noisy`` (R, k), ``values`` (R, k), ``at`` (R, q).
    """
    if slopes.shape[1] > slopes.shape[2] and bool(noisy.all()):
        return _by_corrections(slopes, curvature, values, at)
    if curvature is None:
        return _by_equations(slopes, noisy, values, at)
    if slopes.shape[1] > 1 or slopes.shape[2] > 2:
        return _whole(slopes, curvature, noisy, values, at)
    determinant, target, multipliers = _written_out(slopes[:, 0], curvature, noisy[:, 0], values[:, 0], at)
    left = np.flatnonzero(~(np.abs(determinant) > LEAST_DETERMINANT))
    if len(left):
        target[left], multipliers[left] = _whole(slopes[left], curvature[left], noisy[left], values[left], at[left])
    return target, multipliers


def _written_out(
    slopes: Floats, curvature: Floats, noisy: Mask, values: Floats, at: Floats
) -> tuple[Floats, Floats, Floats]:
    """One equation in one or two corrections: the determinant (R,) of I + W, the corrections and the multipliers."""
    a, p, u = 1.0 + curvature[:, 0, 0], slopes[:, 0], at[:, 0]
    if at.shape[1] == 1:
        turned, kept = p / a, u - u / a  # (I + W)⁻¹ Bᵀ and (I + W)⁻¹ W u
        multipliers = (values + p * (kept - u)) / (p * turned + noisy)
        return a, (kept - turned * multipliers)[:, None], multipliers[:, None]
    b, c, q, v = curvature[:, 0, 1], 1.0 + curvature[:, 1, 1], slopes[:, 1], at[:, 1]
    determinant = a * c - b * b
    turns = ((c * p - b * q) / determinant, (a * q - b * p) / determinant)
    stays = (u - (c * u - b * v) / determinant, v - (a * v - b * u) / determinant)
    multipliers = (values + p * (stays[0] - u) + q * (stays[1] - v)) / (p * turns[0] + q * turns[1] + noisy)
    target = np.stack([stays[0] - turns[0] * multipliers, stays[1] - turns[1] * multipliers], axis=1)
    return determinant, target, multipliers[:, None]


def _by_equations(slopes: Floats, noisy: Mask, values: Floats, at: Floats) -> tuple[Floats, Floats]:
    """``S λ = h − B u`` with ``S = B Bᵀ + Σ``; ``u = −Bᵀ λ``."""
    misclosures = values - np.einsum("rkq,rq->rk", slopes, at)
    if slopes.shape[1] == 1:
        weight = np.einsum("rkq,rkq->rk", slopes, slopes) + noisy
        with np.errstate(all="ignore"):
            multipliers = misclosures / weight
    else:
        multipliers = solved(spread(slopes, noisy), misclosures)
    return -np.einsum("rkq,rk->rq", slopes, multipliers), multipliers


def spread(slopes: Floats, noisy: Mask) -> Floats:
    """Covariance S (R, k, k) of the linearised conditions."""
    result: Floats = slopes @ slopes.transpose(0, 2, 1)
    index = np.arange(slopes.shape[1])
    result[:, index, index] += noisy
    return result


def _by_corrections(slopes: Floats, curvature: Floats | None, values: Floats, at: Floats) -> tuple[Floats, Floats]:
    """More equations than corrections, all with noise of their own: the normal equations of the corrections."""
    normal = slopes.transpose(0, 2, 1) @ slopes
    index = np.arange(slopes.shape[2])
    normal[:, index, index] += 1.0
    if curvature is not None:
        normal = normal + curvature
    change = solved(normal, -(at + np.einsum("rkq,rk->rq", slopes, values)))
    return at + change, values + np.einsum("rkq,rq->rk", slopes, change)


def _whole(slopes: Floats, curvature: Floats, noisy: Mask, values: Floats, at: Floats) -> tuple[Floats, Floats]:
    rows, k, q = slopes.shape
    matrix = np.zeros((rows, q + k, q + k))
    matrix[:, :q, :q] = curvature
    index = np.arange(q)
    matrix[:, index, index] += 1.0
    matrix[:, :q, q:] = slopes.transpose(0, 2, 1)
    matrix[:, q:, :q] = slopes
    index = np.arange(q, q + k)
    matrix[:, index, index] = -1.0 * noisy
    found = solved(matrix, np.concatenate([-at, -values], axis=1))
    return at + found[:, :q], found[:, q:]


def curved_up(slopes: Floats, curvature: Floats, noisy: Mask, asked: Mask) -> Mask:
    """Whether the cost grows along the conditions (R,), of those ``asked``: a foot is a nearest point, not a farthest.

    That is the case for sure where the curvature is below 1, the foot nearer than the radius of curvature.
    """
    bent = np.einsum("rij,rij->r", curvature, curvature) >= 1.0
    result = np.asarray(~bent, dtype=bool)
    looked_at = np.flatnonzero(bent & asked)
    along = slopes[looked_at]
    held = along.transpose(0, 2, 1) @ (along / np.where(noisy[looked_at], 1.0, SOFTNESS)[:, :, None])
    result[looked_at] = _positive_definite(LEVEL * np.eye(slopes.shape[2]) + curvature[looked_at] + held)
    return result


def _positive_definite(matrices: Floats) -> Mask:
    """Which symmetric matrices (R, n, n) have positive pivots only: elimination, of all R together."""
    rest, found = matrices, np.ones(len(matrices), dtype=bool)
    while rest.shape[1]:
        pivot = rest[:, 0, 0]
        found &= pivot > 0.0
        column = rest[:, 1:, 0] / np.where(found, pivot, 1.0)[:, None]
        rest = rest[:, 1:, 1:] - column[:, :, None] * rest[:, 0, None, 1:]
    return found


def solved(matrices: Floats, right: Floats) -> Floats:
    """Solutions (R, n) of the systems (R, n, n); NaN for those that are singular or not finite."""
    try:
        return np.asarray(np.linalg.solve(matrices, right[:, :, None])[:, :, 0])
    except np.linalg.LinAlgError:
        half = len(matrices) // 2
        if not half:
            return np.full(right.shape, np.nan)
        return np.concatenate([solved(matrices[:half], right[:half]), solved(matrices[half:], right[half:])])
