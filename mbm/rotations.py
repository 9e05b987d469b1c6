"""Rotations by columns, many at once: quaternions (w, x, y, z), matrices, rotation vectors, Euler angles."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]


def unit(vectors: Floats) -> Floats:
    """Vectors (…, k) at length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def tangents(x: Any, y: Any, z: Any, sign: Any) -> tuple[tuple[Any, Any, Any], tuple[Any, Any, Any]]:
    """Two orthonormal tangents at a unit vector (Duff et al. 2017); ``sign`` 1 or -1, the one farther from -z."""
    a = -1.0 / (sign + z)
    b = x * y * a
    return (1.0 + sign * x * x * a, sign * b, -sign * x), (b, sign + y * y * a, -y)


CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])
"""Unit quaternions times it, number by number, turn back."""


def hamilton(p: Floats, q: Floats) -> Floats:
    """Products p q of quaternions (…, 4)."""
    a, b, c, d = np.moveaxis(p, -1, 0)
    w, x, y, z = np.moveaxis(q, -1, 0)
    parts = (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )
    return np.stack(parts, axis=-1)


def quaternion_of_vector(omega: Floats) -> Floats:
    """Exp of rotation vectors (…, 3) as unit quaternions (…, 4)."""
    angle = np.linalg.norm(omega, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), 0.5 * np.sinc(angle / (2 * np.pi)) * omega], axis=-1)


def signed(q: Floats) -> Floats:
    """Of unit quaternions (…, 4) and their negatives, which turn alike, those that are reported.

    Their first number that is not zero is positive: w, and of half turns, where w is 0, x, or else y, or else z.
    """
    nonzero = q != 0.0
    first = np.take_along_axis(q, nonzero.argmax(axis=-1)[..., None], axis=-1)
    return np.where(first < 0.0, -q, q) + 0.0  # no zero is negative


def vector_of_quaternion(q: Floats) -> Floats:
    """Log of unit quaternions (…, 4) as rotation vectors (…, 3), no longer than π."""
    q = signed(q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, q[..., :1])
    factor = np.where(sine > 1e-150, angle / np.where(sine > 1e-150, sine, 1.0), 2.0)
    return np.asarray(factor * q[..., 1:])


def quaternion_of_matrix(matrices: Floats) -> Floats:
    """Unit quaternions (…, 4) of rotation matrices (…, 3, 3); of near-rotations the nearest (Bar-Itzhack 2000)."""
    m = matrices
    k = np.empty((*m.shape[:-2], 4, 4))
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    k[..., 0, 0] = xx + yy + zz
    k[..., 1, 1], k[..., 2, 2], k[..., 3, 3] = xx - yy - zz, yy - xx - zz, zz - xx - yy
    k[..., 0, 1] = k[..., 1, 0] = m[..., 2, 1] - m[..., 1, 2]
    k[..., 0, 2] = k[..., 2, 0] = m[..., 0, 2] - m[..., 2, 0]
    k[..., 0, 3] = k[..., 3, 0] = m[..., 1, 0] - m[..., 0, 1]
    k[..., 1, 2] = k[..., 2, 1] = m[..., 1, 0] + m[..., 0, 1]
    k[..., 1, 3] = k[..., 3, 1] = m[..., 0, 2] + m[..., 2, 0]
    k[..., 2, 3] = k[..., 3, 2] = m[..., 2, 1] + m[..., 1, 2]
    q = np.linalg.eigh(k)[1][..., -1]
    return signed(q)


def matrix_of_quaternion(q: Floats) -> Floats:
    """Rotation matrices (…, 3, 3) of unit quaternions (…, 4)."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def cross_matrix(v: Floats) -> Floats:
    """[v]× for vectors (…, 3): shape (…, 3, 3), so that ``[v]× w = v × w``."""
    result = np.zeros((*v.shape, 3))
    result[..., 0, 1], result[..., 0, 2] = -v[..., 2], v[..., 1]
    result[..., 1, 0], result[..., 1, 2] = v[..., 2], -v[..., 0]
    result[..., 2, 0], result[..., 2, 1] = -v[..., 1], v[..., 0]
    return result


def inverse_motion(R: Floats, t: Floats) -> tuple[Floats, Floats]:
    """The inverses of motions ``x → R x + t``: rotations (…, d, d) and translations (…, d) again."""
    back = np.swapaxes(R, -1, -2)
    return back, -np.einsum("...ij,...j->...i", back, t)


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
