"""Cameras in rigs that photograph boards: an independent simulator, plain NumPy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Motion = tuple[Floats, Floats]
"""R (3, 3) and t (3,): ``x → R x + t``."""


def turn(vector: Sequence[float]) -> Floats:
    """The rotation by a rotation vector (Rodrigues)."""
    v = np.asarray(vector, dtype=np.float64)
    angle = float(np.linalg.norm(v))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = v / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K)


def composed(*motions: Motion) -> Motion:
    """The first after the second after …"""
    R, t = np.eye(3), np.zeros(3)
    for turned, shifted in motions:
        R, t = R @ turned, R @ shifted + t
    return R, t


def inverted(motion: Motion) -> Motion:
    return motion[0].T, -motion[0].T @ motion[1]


def numbers(motion: Motion) -> list[float]:
    """Quaternion (w x y z) with w ≥ 0, then the translation."""
    R, t = motion
    candidates = np.array(
        [
            [1 + R[0, 0] + R[1, 1] + R[2, 2], R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], 1 + R[0, 0] - R[1, 1] - R[2, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]],
            [R[0, 2] - R[2, 0], R[0, 1] + R[1, 0], 1 - R[0, 0] + R[1, 1] - R[2, 2], R[1, 2] + R[2, 1]],
            [R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], 1 - R[0, 0] - R[1, 1] + R[2, 2]],
        ]
    )
    q = candidates[int(np.argmax(np.diag(candidates)))]
    q = q / np.linalg.norm(q)
    return [*(q if q[0] >= 0 else -q), *t]


@dataclass(frozen=True)
class Camera:
    """Focal lengths and centre in pixels, radial distortion of the pinhole; a fisheye has r = f θ."""

    focal: tuple[float, float] = (800.0, 810.0)
    centre: tuple[float, float] = (320.0, 240.0)
    radial: tuple[float, ...] = ()
    fisheye: bool = False

    def seen(self, points: Floats) -> Floats:
        x = points[:, :2] / points[:, 2:]
        r = np.linalg.norm(x, axis=1, keepdims=True)
        if self.fisheye:
            x = x * np.arctan(r) / r
        else:
            x = x * (1.0 + sum(k * r ** (2 * i + 2) for i, k in enumerate(self.radial)))
        return np.asarray(x * np.array(self.focal) + np.array(self.centre))


def board(columns: int = 7, rows: int = 5, size: float = 0.03) -> Floats:
    """Corners of a chessboard, in metres."""
    return np.array([[i * size, j * size, 0.0] for j in range(rows) for i in range(columns)])


def held(generator: np.random.Generator, count: int, tilt: float = 0.5, far: float = 0.7) -> list[Motion]:
    """Where a board is held before a camera, each time otherwise."""
    found = []
    for _ in range(count):
        R = turn(generator.uniform(-tilt, tilt, size=3))
        t = np.array([generator.uniform(-0.2, 0.0), generator.uniform(-0.15, 0.0), far * generator.uniform(0.8, 1.3)])
        found.append((R, t))
    return found


@dataclass
class Corners:
    """Rows of a table: keys (camera, photograph, …), the corner on its board, and where it is seen."""

    keys: tuple[str, ...]
    rows: list[tuple[float, ...]] = field(default_factory=list)

    def add(self, keys: Sequence[float], points: Floats, images: Floats) -> None:
        self.rows += [(*keys, *point, *image) for point, image in zip(points, images, strict=True)]

    def columns(self) -> dict[str, Floats]:
        values = np.array(self.rows).T
        return dict(zip((*self.keys, "x", "y", "z", "u", "v"), values, strict=True))


def keyed(name: str, count: int) -> dict[str, Floats]:
    """A table of keys 0 … count - 1."""
    return {name: np.arange(float(count))}


def photographed(
    cameras: Sequence[Camera],
    rig: Sequence[Motion],
    boards: Sequence[Motion],
    seen: Mapping[int, Sequence[int]],
    noise: float,
    generator: np.random.Generator,
    points: Floats | None = None,
) -> list[Corners]:
    """One table for each camera: the photographs that ``seen`` lists for it; the board is placed before camera 0."""
    points = board() if points is None else points
    found = []
    for number, camera in enumerate(cameras):
        table = Corners(keys=("photo",))
        for photo in seen[number]:
            R, t = composed(rig[number], boards[photo])
            images = camera.seen(points @ R.T + t)
            table.add((photo,), points, images + noise * generator.standard_normal(images.shape))
        found.append(table)
    return found
