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
    if slopes.shape[1:] == (1, 2):
        found = _pairs(slopes[:, 0], curvature, noisy[:, 0], values[:, 0], at)
        if found is not None:
            return found
    return _whole(slopes, curvature, noisy, values, at)


def _pairs(slopes: Floats, curvature: Floats, noisy: Mask, values: Floats, at: Floats) -> tuple[Floats, Floats] | None:
    """One equation in two corrections, written out: what a curve in the plane asks for; None near a singular one."""
    a, b, c = 1.0 + curvature[:, 0, 0], curvature[:, 0, 1], 1.0 + curvature[:, 1, 1]
    determinant = a * c - b * b
    if not (len(at) and float(np.abs(determinant).min()) > LEAST_DETERMINANT):
        return None
    p, q = slopes[:, 0], slopes[:, 1]
    u, v = at[:, 0], at[:, 1]
    turned = ((c * p - b * q) / determinant, (a * q - b * p) / determinant)  # (I + W)⁻¹ Bᵀ
    kept = (u - (c * u - b * v) / determinant, v - (a * v - b * u) / determinant)  # (I + W)⁻¹ W u
    multipliers = (values + p * (kept[0] - u) + q * (kept[1] - v)) / (p * turned[0] + q * turned[1] + noisy)
    return (
        np.stack([kept[0] - turned[0] * multipliers, kept[1] - turned[1] * multipliers], axis=1),
        multipliers[:, None],
    )


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
    for i in np.flatnonzero(bent & asked):
        held = slopes[i].T @ (slopes[i] / np.where(noisy[i], 1.0, SOFTNESS)[:, None])
        try:
            np.linalg.cholesky(LEVEL * np.eye(slopes.shape[2]) + curvature[i] + held)
        except np.linalg.LinAlgError:
            continue
        result[i] = True
    return result


def solved(matrices: Floats, right: Floats) -> Floats:
    """Solutions (R, n) of the systems (R, n, n); NaN for those that are singular or not finite."""
    try:
        return np.asarray(np.linalg.solve(matrices, right[:, :, None])[:, :, 0])
    except np.linalg.LinAlgError:
        result = np.full(right.shape, np.nan)
        for i, (matrix, side) in enumerate(zip(matrices, right, strict=True)):
            try:
                result[i] = np.linalg.solve(matrix, side)
            except np.linalg.LinAlgError:
                continue
        return result
