"""Images of a plane → homographies, and from several the camera that took them (Zhang, IEEE PAMI 22 (11), 2000)."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Knowledge:
    """What the camera is to have: one focal length for both axes, a centre at the origin of the image coordinates."""

    one_focal: bool
    centred: bool


def homography(plane: Floats, image: Floats) -> Floats:
    """H (3, 3) with ``(u, v, 1) ~ H (a, b, 1)`` from n ≥ 4 points (n, 2), by the normalised linear method."""
    T, a = _normalised(plane)
    S, u = _normalised(image)
    zero = np.zeros_like(a)
    rows = np.concatenate(
        [np.hstack([a, zero, -u[:, :1] * a]), np.hstack([zero, a, -u[:, 1:2] * a])],
    )
    _, values, Vt = np.linalg.svd(rows)
    if len(plane) < 4 or values[7] < 1e-9 * values[0]:
        return np.full((3, 3), np.nan)
    return np.asarray(np.linalg.inv(S) @ Vt[-1].reshape(3, 3) @ T)


def _normalised(points: Floats) -> tuple[Floats, Floats]:
    """The transform (3, 3) that centres points and gives them unit spread, and the points (n, 3) after it."""
    centre = points.mean(axis=0)
    scale = 1.0 / max(float(np.sqrt(np.square(points - centre).sum(axis=1).mean() / 2)), 1e-300)
    T = np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1.0]])
    return T, np.hstack([points, np.ones((len(points), 1))]) @ T.T


def camera_from_planes(homographies: Floats, known: Knowledge) -> tuple[Floats, Floats]:
    """Focal lengths (2,) and centre (2,) of a camera without skew from homographies (K, 3, 3); NaN if not determined.

    The images of the plane's two axes are orthogonal and of one length under the image of the absolute conic, two
    linear equations a view in B11, B22, B13, B23, B33.
    """
    scale = np.abs(homographies[:, :2, 2] / homographies[:, 2:, 2]).max()
    S = np.diag([1 / scale, 1 / scale, 1.0])
    H = S @ homographies
    H = H / np.linalg.norm(H, axis=(1, 2), keepdims=True)

    def row(i: int, j: int) -> Floats:
        a, b = H[:, :, i], H[:, :, j]
        products = [
            a[:, 0] * b[:, 0],
            a[:, 1] * b[:, 1],
            a[:, 0] * b[:, 2] + a[:, 2] * b[:, 0],
            a[:, 1] * b[:, 2] + a[:, 2] * b[:, 1],
            a[:, 2] * b[:, 2],
        ]
        return np.stack(products, axis=1)

    matrix = np.concatenate([row(0, 1), row(0, 0) - row(1, 1)])
    select = np.eye(5)
    if known.one_focal:
        select[:, 0] += select[:, 1]
        select = np.delete(select, 1, axis=1)
    if known.centred:
        select = select[:, ~select[2:4].any(axis=0)]
    reduced = matrix @ select
    _, values, Vt = np.linalg.svd(reduced, full_matrices=True)
    nothing = np.full(2, np.nan)
    if len(reduced) < reduced.shape[1] - 1 or values[reduced.shape[1] - 2] < 1e-9 * values[0]:
        return nothing, nothing
    b11, b22, b13, b23, b33 = select @ Vt[-1]
    with np.errstate(all="ignore"):
        centre = np.array([-b13 / b11, -b23 / b22])
        size = b33 - b13**2 / b11 - b23**2 / b22
        focal = np.sqrt(np.array([size / b11, size / b22]))
    if not bool(np.isfinite(focal).all() and np.isfinite(centre).all()):
        return nothing, nothing
    return scale * focal, scale * centre
