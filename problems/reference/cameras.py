"""Poses and cameras for the reference scripts: exact derivatives by complex steps need formulas that are analytic."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from problems.reference.least_squares import Array

NEAR_ZERO = 1e-6
"""Of a squared angle: below it the next term of the series, a³/5040, is below 1e-21."""


def cross(vector: Array) -> Array:
    """The matrix (3, 3) that takes x to ``vector`` × x."""
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def exponential(vector: Array) -> Array:
    """The rotation (3, 3) about ``vector`` by its length, analytic at zero (Rodrigues)."""
    square = np.sum(vector * vector)
    if abs(square) < NEAR_ZERO:
        sine, versine = 1 - square / 6 + square**2 / 120, 0.5 - square / 24 + square**2 / 720
    else:
        angle = np.sqrt(square)
        sine, versine = np.sin(angle) / angle, (1 - np.cos(angle)) / square
    matrix = cross(vector)
    return np.eye(3) + sine * matrix + versine * matrix @ matrix


class Poses:
    """Rotations and translations that parameters move: R Exp(ω), t + v for each six parameters."""

    def __init__(self, vectors: Array) -> None:
        """From rotation vectors and translations (n, 6)."""
        self.rotations = [exponential(v[:3]) for v in vectors]
        self.translations = [v[3:] for v in vectors]

    def moved(self, parameters: Array) -> list[tuple[Array, Array]]:
        """The poses after tangent coordinates (6 n,)."""
        steps = parameters.reshape(-1, 6)
        return [
            (r @ exponential(s[:3]), t + s[3:])
            for r, t, s in zip(self.rotations, self.translations, steps, strict=True)
        ]

    def settle(self, parameters: Array) -> None:
        """Take the moved poses as the ones to move."""
        moved = self.moved(parameters)
        self.rotations, self.translations = [r for r, _ in moved], [t for _, t in moved]

    def values(self) -> list[dict[str, Any]]:
        """As the result document has them."""
        pairs = zip(self.rotations, self.translations, strict=True)
        return [{"matrix": r.tolist(), "translation": np.asarray(t).tolist()} for r, t in pairs]


def rotation_of(quaternion: Sequence[float]) -> Array:
    """The rotation (3, 3) of a quaternion (w, x, y, z) of any length."""
    w, x, y, z = np.asarray(quaternion) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def pinhole(camera: Array, points: Array) -> Array:
    """Image points (n, 2) in px of points (n, 3) in the camera's frame.

    ``camera`` is fx fy cx cy and, as far as given, k1 k2 p1 p2 k3: Brown's distortion in OpenCV's order.
    """
    k1, k2, p1, p2, k3 = (*camera[4:], *[0.0] * (9 - len(camera)))
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    square = x * x + y * y
    radial = 1 + k1 * square + k2 * square**2 + k3 * square**3
    u = x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x)
    v = y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y
    return np.column_stack([camera[2] + camera[0] * u, camera[3] + camera[1] * v])
