"""Images of a plane → homographies, and from several the camera that took them (Zhang, IEEE PAMI 22 (11), 2000).

Points among which some are wrong: random samples, and the one with the least median of squares (Rousseeuw 1984).
"""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.values import dataclass

SAMPLES = 100
"""Samples of at most four points: with 30 % wrong ones, one is right but in one of 10¹¹ cases."""

APART = 4.0
"""Distance, in medians of all, beyond which a point is wrong: 4.7 standard deviations of normal noise in a plane."""

LEAST = 8
"""Points from which on the median tells wrong ones."""


def contaminated(squares: Floats) -> bool:
    """Whether some squared misfits (n,) stand out so far that the fit must not be trusted."""
    return len(squares) >= LEAST and not bool(squares.max() <= APART**2 * np.median(squares))


def samples_of(count: int, size: int) -> Indices:
    """Random samples (k, size) of ``count`` points, the same ones at each call."""
    every = np.tile(np.arange(count), (SAMPLES, 1))
    return np.asarray(np.random.default_rng(0).permuted(every, axis=1)[:, :size])


def agreeing(squares: Floats) -> Mask:
    """Which points agree with the fit whose squared misfits, of those of all fits (k, n), have the least median."""
    best = squares[int(np.argmin(np.median(squares, axis=1)))]
    return np.asarray(best <= APART**2 * np.median(best))


_LENGTHS = np.geomspace(0.25, 16.0, 37)
_OFFSETS = np.linspace(-1.0, 1.0, 11)

SINGULAR = 1e-15
"""Second eigenvalue of the normal equations beside the largest, below which points determine no homography."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Knowledge:
    """What the camera is to have: one focal length for both axes, a centre at the origin of the image coordinates."""

    one_focal: bool
    centred: bool


def homography(plane: Floats, image: Floats) -> Floats:
    """H (3, 3) with ``(u, v, 1) ~ H (a, b, 1)`` from n ≥ 4 points (n, 2), by the normalised linear method.

    Where some points lie far from where the others' homography has them, it is that of the others: of random samples
    of four the one with the least median of squares (Rousseeuw 1984) tells which. NaN where it is not determined.
    """
    if len(plane) < 4:
        return np.full((3, 3), np.nan)
    every = _homographies(plane[None], image[None])
    if not contaminated(_misfits(every, plane, image)[0]):
        return np.asarray(every[0])
    samples = samples_of(len(plane), 4)
    found = np.concatenate([every, _homographies(plane[samples], image[samples])])
    kept = agreeing(_misfits(found, plane, image))
    return np.asarray(_homographies(plane[None, kept], image[None, kept])[0])


def _homographies(plane: Floats, image: Floats) -> Floats:
    """The homographies (k, 3, 3) of k sets of points (k, n, 2), by least squares."""
    T, a = _normalised(plane)
    S, u = _normalised(image)
    zero = np.zeros_like(a)
    rows = np.concatenate(
        [np.concatenate([a, zero, -u[..., :1] * a], axis=2), np.concatenate([zero, a, -u[..., 1:2] * a], axis=2)],
        axis=1,
    )
    values, vectors = np.linalg.eigh(np.swapaxes(rows, 1, 2) @ rows)
    found = np.linalg.inv(S) @ vectors[:, :, 0].reshape(-1, 3, 3) @ T
    return np.where((values[:, 1] > SINGULAR * values[:, -1])[:, None, None], found, np.nan)


def _misfits(homographies: Floats, plane: Floats, image: Floats) -> Floats:
    """Squared distances (k, n) of points in the image from where each homography has them; infinite without one."""
    with np.errstate(all="ignore"):
        seen = np.hstack([plane, np.ones((len(plane), 1))]) @ np.swapaxes(homographies, 1, 2)
        found = np.square(seen[..., :2] / seen[..., 2:] - image).sum(axis=2)
    return np.where(np.isfinite(found), found, np.inf)


def _normalised(points: Floats) -> tuple[Floats, Floats]:
    """Transforms (k, 3, 3) that centre points (k, n, 2) and give them unit spread, and the points (k, n, 3) then."""
    centre = points.mean(axis=1)
    spread = np.sqrt(np.square(points - centre[:, None]).sum(axis=2).mean(axis=1) / 2)
    T = np.tile(np.eye(3), (len(points), 1, 1))
    T[:, :2, 2] = -centre
    T[:, :2] /= np.maximum(spread, 1e-300)[:, None, None]
    return T, np.concatenate([points, np.ones((*points.shape[:2], 1))], axis=2) @ np.swapaxes(T, 1, 2)


def camera_from_planes(homographies: Floats, known: Knowledge) -> tuple[Floats, Floats]:
    """Focal lengths (2,) and centre (2,) of a camera without skew from homographies (K, 3, 3); NaN if not determined.

    The images of the plane's two axes are orthogonal and of one length under the image of the absolute conic, two
    linear equations a view in B11, B22, B13, B23, B33. Coordinates of the image are to be of the size of one.
    """
    H = homographies / np.linalg.norm(homographies, axis=(1, 2), keepdims=True)

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
    return focal, centre if not known.centred else np.zeros(2)


def likeliest_camera(homographies: Floats, *, centred: bool) -> tuple[Floats, Floats]:
    """The one of a table of cameras, focal lengths (2,) and centre (2,), under which the planes' axes suit best.

    Coordinates of the image are of the size of one. The cost is scale free, so that no camera gains by a long focal
    length, and a centre off the middle of the image costs a little.
    """
    offsets = np.zeros((1, 2)) if centred else np.stack(np.meshgrid(_OFFSETS, _OFFSETS), axis=-1).reshape(-1, 2)
    lengths = np.repeat(_LENGTHS, len(offsets))
    centres = np.tile(offsets, (len(_LENGTHS), 1))
    axes = homographies[None, :, :, :2].repeat(len(lengths), axis=0)
    axes[:, :, :2] = (axes[:, :, :2] - centres[:, None, :, None] * axes[:, :, 2:]) / lengths[:, None, None, None]
    a, b = axes[..., 0], axes[..., 1]
    aa, bb, ab = (np.einsum("...i,...i->...", p, q) for p, q in ((a, a), (b, b), (a, b)))
    costs = ((np.square(ab) + np.square(aa - bb) / 4) / np.square(aa + bb)).mean(axis=1)
    best = int(np.argmin(costs * (1.0 + np.square(centres).sum(axis=1))))
    return np.full(2, lengths[best]), centres[best]
