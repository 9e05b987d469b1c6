"""Rotations of space for many problems at once: matrices, rotation vectors, Euler angles."""

from __future__ import annotations

import numpy as np

from mbm.solution.types import Floats


def cross_matrix(v: Floats) -> Floats:
    """[v]× for vectors (…, 3): shape (…, 3, 3), so that ``[v]× w = v × w``."""
    result = np.zeros((*v.shape, 3))
    result[..., 0, 1], result[..., 0, 2] = -v[..., 2], v[..., 1]
    result[..., 1, 0], result[..., 1, 2] = v[..., 2], -v[..., 0]
    result[..., 2, 0], result[..., 2, 1] = -v[..., 1], v[..., 0]
    return result


def exponential(omega: Floats) -> Floats:
    """Rotation matrices (…, 3, 3) of rotation vectors (…, 3), by Rodrigues' formula."""
    angle = np.linalg.norm(omega, axis=-1)[..., None, None]
    K = cross_matrix(omega)
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    result: Floats = np.eye(3) + first * K + second * (K @ K)
    return result


def nearest(M: Floats) -> Floats:
    """The rotations (…, d, d) that maximise ``trace(Rᵀ M)``, by the determinant rule (Umeyama 1991, lemma)."""
    finite = np.isfinite(M).all(axis=(-2, -1), keepdims=True)
    U, _, Vt = np.linalg.svd(np.where(finite, M, np.eye(M.shape[-1])))
    sign = np.linalg.det(U) * np.linalg.det(Vt)
    U = U.copy()
    U[..., :, -1] *= np.where(sign < 0, -1.0, 1.0)[..., None]
    return np.where(finite, U @ Vt, np.nan)


def euler_angles(R: Floats) -> Floats:
    """(φ, θ, ψ) (…, 3) with ``R = Rz(ψ) Ry(θ) Rx(φ)``; φ = 0 where θ is a right angle and only a sum is determined."""
    theta = np.arctan2(-R[..., 2, 0], np.hypot(R[..., 0, 0], R[..., 1, 0]))
    locked = np.hypot(R[..., 0, 0], R[..., 1, 0]) < 1e-12
    phi = np.where(locked, 0.0, np.arctan2(R[..., 2, 1], R[..., 2, 2]))
    psi = np.where(locked, np.arctan2(-R[..., 0, 1], R[..., 1, 1]), np.arctan2(R[..., 1, 0], R[..., 0, 0]))
    return np.stack([phi, theta, psi], axis=-1)


def from_euler(angles: Floats) -> Floats:
    """``Rz(ψ) Ry(θ) Rx(φ)`` (…, 3, 3) of (φ, θ, ψ) (…, 3)."""
    (cf, ct, cp), (sf, st, sp) = np.moveaxis(np.cos(angles), -1, 0), np.moveaxis(np.sin(angles), -1, 0)
    rows = [
        [ct * cp, sf * st * cp - cf * sp, cf * st * cp + sf * sp],
        [ct * sp, sf * st * sp + cf * cp, cf * st * sp - sf * cp],
        [-st, sf * ct, cf * ct],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def planar(angle: Floats) -> Floats:
    """Rotations of the plane (…, 2, 2) by angles (…)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)
