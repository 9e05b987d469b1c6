"""Images of solids by a renderer of the tests' own: triangles filled line by line, blurred, with noise."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

WIDTH, HEIGHT, FOCAL, CENTER = 640, 480, 700.0, np.array([320.0, 240.0])
LINES = 16
"""Lines of samples in a line of pixels: along them pixels are covered exactly, an edge is off by 1/32 px at most."""

BLUR, NOISE, DARK, BRIGHT = 0.8, 2.0, 60.0, 190.0


def box(sides, center=(0, 0, 0)) -> list[np.ndarray]:
    """Triangles (n, 3, 3) of a convex solid."""
    signs = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    return [hull(signs * np.array(sides) / 2 + center)]


def disk(radius: float, low: float, high: float, corners: int = 720) -> list[np.ndarray]:
    """A cylinder about z; of a circle by 720 chords 1e-5 of the radius is missing."""
    turn = 2 * np.pi * np.arange(corners) / corners
    ring = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return [hull(np.concatenate([np.column_stack([ring, np.full(corners, z)]) for z in (low, high)]))]


def hull(points: np.ndarray) -> np.ndarray:
    return points[ConvexHull(points).simplices]


def wall(outer: float, inner: float, low: float, high: float, corners: int = 720) -> list[np.ndarray]:
    """A tube about z, open at both ends, as many convex staves."""
    turn = 2 * np.pi * np.arange(corners + 1) / corners
    ways = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    quads = []
    for a, b in pairwise(ways):
        ends = [np.array([*(r * w), z]) for r in (outer, inner) for w in (a, b) for z in (low, high)]
        o1, o2, o3, o4, i1, i2, i3, i4 = ends
        for p, q, r, s in ((o1, o2, o4, o3), (i1, i2, i4, i3), (o1, o3, i3, i1), (o2, o4, i4, i2)):
            quads += [[p, q, r], [p, r, s]]
    return [np.array(quads)]


def covered(solids: list[np.ndarray], R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """How much of each pixel (HEIGHT, WIDTH) the triangles cover."""
    corners = np.concatenate(solids) @ R.T + t
    images = corners[..., :2] / corners[..., 2:] * FOCAL + CENTER
    low, high = np.floor(images.min(axis=(0, 1))).astype(int) - 2, np.ceil(images.max(axis=(0, 1))).astype(int) + 2
    if low.min() < 4 or (high > np.array([WIDTH, HEIGHT]) - 4).any():
        message = "the object is cut by the border"
        raise ValueError(message)
    size = high - low
    # pixel centres are at whole numbers: pixel k reaches from k - 1/2 to k + 1/2
    starts, ends = (np.full((len(images), size[1] * LINES), sign * np.inf) for sign in (1, -1))
    y = low[1] - 0.5 + (np.arange(size[1] * LINES) + 0.5) / LINES
    for first, second in ((0, 1), (1, 2), (2, 0)):
        p, q = images[:, first], images[:, second]
        dy = q[:, 1] - p[:, 1]
        with np.errstate(all="ignore"):
            share = (y - p[:, 1:]) / dy[:, None]
            x = p[:, :1] + share * (q[:, :1] - p[:, :1])
        met = (share >= 0) & (share <= 1) & np.isfinite(x)
        starts, ends = np.where(met, np.minimum(starts, x), starts), np.where(met, np.maximum(ends, x), ends)
    lines = np.zeros((len(y), size[0]))
    for k in range(len(y)):
        lines[k] = _filled(starts[:, k], ends[:, k], low[0] - 0.5, size[0])
    found = np.zeros((HEIGHT, WIDTH))
    found[low[1] : high[1], low[0] : high[0]] = lines.reshape(size[1], LINES, size[0]).mean(axis=1)
    return found


def _filled(starts: np.ndarray, ends: np.ndarray, first: float, count: int) -> np.ndarray:
    """How much of each of ``count`` cells of length 1 from ``first`` the union of intervals covers."""
    own = ends > starts
    if not own.any():
        return np.zeros(count)
    order = np.argsort(starts[own])
    begins, stops = starts[own][order], np.maximum.accumulate(ends[own][order])
    new = np.concatenate([[True], begins[1:] > stops[:-1]])
    edges = np.arange(count + 1) + first
    total = np.zeros(count + 1)
    for a, b in zip(begins[new], stops[np.concatenate([np.flatnonzero(new)[1:] - 1, [len(stops) - 1]])], strict=True):
        total += np.clip(edges, a, b) - a
    return np.diff(total)


def photograph(file: Path, solids: list[np.ndarray], R: np.ndarray, t: np.ndarray, rng: np.random.Generator) -> None:
    """A bright object before a dark background, as a PNG."""
    grey = gaussian_filter(DARK + (BRIGHT - DARK) * covered(solids, R, t), BLUR)
    grey += rng.normal(0, NOISE, grey.shape)
    cv2.imwrite(str(file), np.clip(np.rint(grey), 0, 255).astype(np.uint8))


def pose(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A uniformly random rotation before the camera, and a place."""
    R = Rotation.random(random_state=rng).as_matrix()
    return R, np.array([rng.uniform(-0.05, 0.05), rng.uniform(-0.04, 0.04), rng.uniform(0.5, 0.75)])
