"""Rotations and scenes of known truth, made without the code under test."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def rotation(axis: tuple[float, float, float], angle: float) -> Floats:
    """By Euler's formula in components, R v = v cos + (n × v) sin + n (n·v)(1 − cos)."""
    n = np.array(axis) / np.linalg.norm(axis)
    columns = [
        e * np.cos(angle) + np.cross(n, e) * np.sin(angle) + n * (n @ e) * (1 - np.cos(angle)) for e in np.eye(3)
    ]
    return np.stack(columns, axis=1)


ROTATIONS = (
    rotation((1, 2, 3), 0.4),
    rotation((-1, 0.5, 0.2), 3.0),
    rotation((0, 0, 1), np.pi),
    rotation((0.3, -2, 1), 2.0),
    np.eye(3),
)


def cloud(count: int, seed: int, *, flat: bool = False) -> Floats:
    """Random points (count, 3) within one metre; in the plane z = 0 if flat."""
    points = np.random.default_rng(seed).uniform(-1.0, 1.0, size=(count, 3))
    if flat:
        points[:, 2] = 0.0
    return points


def bearings(points: Floats, R: Floats, t: Floats) -> Floats:
    """Unit vectors to the points as seen from the origin."""
    seen = points @ R.T + t
    return seen / np.linalg.norm(seen, axis=1, keepdims=True)
