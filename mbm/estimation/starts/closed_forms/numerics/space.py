"""Images of points of space → the camera that took them, whose centre and focal lengths are unknown.

Pinholes by the direct linear transformation (Abdel-Aziz and Karara 1971). Of a fisheye, whatever its distortion, points
are seen in the direction from its centre that they have from the axis (Tsai 1987): that alone is linear in the first
two rows of the pose, and with an unknown centre in a fundamental matrix that has it for epipole (Hartley and Kang, IEEE
PAMI 29 (8), 2007). How far out a point is seen then tells the focal length and the depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from mbm.equations.types import Floats
from mbm.estimation.starts.closed_forms.numerics.bearings import poses_from_bearings
from mbm.values import dataclass

Views = Sequence[tuple[Floats, Floats]]
"""Points (n, 3), and where they are seen (n, 2)."""

FISHEYES = np.geomspace(0.15, 10.0, 31)
"""Focal lengths of fisheyes that are tried, beside the extent of what is seen: from all around to 6°."""

PINHOLES = np.geomspace(0.25, 16.0, 25)
"""The same of pinholes, from 127° to 4°."""

LEAST_IN_SPACE, DEEP = 6, 0.03
"""Points of space that tell the camera by their image, and their extent across the likeliest plane beside the largest
from which on they do, whatever the noise."""

DIRECTIONS, WITH_CENTRE = 8, 12
"""Points by which directions from a known centre tell the pose, and by which they tell the centre, too."""

DEPTHS = 8
"""Newton's steps to a depth."""


def in_space(points: Floats, _image: Floats | None = None) -> bool:
    """Whether images of points (n, 3), in axes of their own, tell of space."""
    return len(points) >= LEAST_IN_SPACE and off_plane(points)


def off_plane(points: Floats) -> bool:
    """Whether points (n, 3), in axes of their own, lie so far off their plane."""
    return bool(np.ptp(points[:, 2]) > DEEP * np.ptp(points[:, 0]))


def projection(places: Floats, images: Floats) -> Floats:
    """P (3, 4) with ``images ~ P (places, 1)``, its third row of length 1 and its determinant positive."""
    whole = np.column_stack([places, np.ones(len(places))])
    nothing = np.zeros_like(whole)
    lines = [np.hstack([whole, nothing, -images[:, :1] * whole]), np.hstack([nothing, whole, -images[:, 1:] * whole])]
    P = np.linalg.svd(np.vstack(lines))[2][-1].reshape(3, 4)
    P /= np.linalg.norm(P[2, :3]) * np.sign(np.linalg.det(P[:, :3]))
    return np.asarray(P)


def pinhole_in_space(views: Views, ahead: float) -> tuple[Floats, Floats] | None:
    """Focal lengths (2,) and centre (2,) of a pinhole, the medians of all views; None where they tell of no camera.

    ``P = K [R t]``, and K from ``M Mᵀ = K Kᵀ``, M = K R (Hartley and Zisserman 2004, 7.1). The second focal length is
    negative where points would else be behind a camera that looks ``ahead`` (1: along z, −1).
    """
    found = []
    for points, image in views:
        P = projection(points / np.abs(points).max(), image)
        M = P[:, :3]
        conic = M @ M.T
        centre = conic[:2, 2]
        with np.errstate(invalid="ignore"):
            fy = np.sqrt(conic[1, 1] - centre[1] ** 2)
            fx = np.sqrt(conic[0, 0] - centre[0] ** 2 - ((conic[0, 1] - centre[0] * centre[1]) / fy) ** 2)
        depth = points / np.abs(points).max() @ P[2, :3] + P[2, 3]
        found.append([fx, fy * np.sign(np.median(depth) * ahead), *centre])
    known = np.array([each for each in found if np.isfinite(each).all()]).reshape(-1, 4)
    if not len(known):
        return None
    middle = np.median(known, axis=0)
    return middle[:2], middle[2:]


def one_focal_length(views: Views, ahead: float) -> float:
    """Of a pinhole whose centre is at 0 that of a table by which the views of four points or more have the best poses.

    Images are of the size of one.
    """
    lengths = PINHOLES
    for finer in (True, False):
        best = int(np.argmin([sum(_led_off(*view, length, ahead) for view in views) for length in lengths]))
        if finer:
            step = PINHOLES[1] / PINHOLES[0]
            lengths = lengths[best] * np.geomspace(1 / step, step, 9)
    return float(lengths[best])


def _led_off(points: Floats, image: Floats, length: float, ahead: float) -> float:
    """How far points are seen (mean) from where a pinhole at its best pose has them."""
    bearings = ahead * np.column_stack([image / length, np.ones(len(image))])
    turns, shifts = poses_from_bearings(points, bearings / np.linalg.norm(bearings, axis=1)[:, None])
    places = np.einsum("kij,nj->kni", turns, points) + shifts[:, None]
    off = np.linalg.norm(length * places[..., :2] / places[..., 2:] - image, axis=2).mean(axis=1)
    return float(off.min(initial=np.inf))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Directions:
    """Of the points of a view: how far they are aside from the axis (n, 2), the depth (n,) but for a constant, where
    they are seen (n, 2) for the same focal length of both axes, and the root of the ratio of these.
    """

    aside: Floats
    depth: Floats
    seen: Floats
    aspect: float


def fisheye_in_space(views: Views, *, centred: bool, one_focal: bool) -> tuple[Floats, Floats] | None:
    """Focal lengths (2,) and centre (2,) of a fisheye, images of the size of one; None where they tell of no camera.

    Of a centre in the middle and one that the directions tell, and of a camera and its mirror image (a negative second
    focal length) that which leads least off. ``centred``: it is known to be at 0.
    """
    centres = [np.zeros(2)]
    told = [] if centred else [_epipole(*view) for view in views if len(view[0]) >= WITH_CENTRE]
    centres += [np.median(told, axis=0)] if told else []
    best, least = None, np.inf
    for centre, mirror in product(centres, (1.0,) if one_focal else (1.0, -1.0)):
        seen = [_directions(points, image - centre, mirror, one_focal=one_focal) for points, image in views]
        known = [each for each in seen if each is not None]
        if not known:
            continue
        focal, misfit = _likeliest(known)
        aspect = 1.0 if one_focal else float(np.median([each.aspect for each in known]))
        if misfit < least:
            best, least = (focal * np.array([aspect, mirror / aspect]), centre), misfit
    return best


def _epipole(points: Floats, image: Floats) -> Floats:
    """The centre (2,) from which all points are seen in the directions that they have from an axis."""
    whole = np.column_stack([points / np.abs(points).max(), np.ones(len(points))])
    seen = np.column_stack([image, np.ones(len(image))])
    F = np.linalg.svd((seen[:, :, None] * whole[:, None]).reshape(-1, 12))[2][-1].reshape(3, 4)
    e = np.linalg.svd(F.T)[2][-1]
    return np.asarray(e[:2] / e[2])


def _directions(points: Floats, image: Floats, mirror: float, *, one_focal: bool) -> _Directions | None:
    if len(points) < DIRECTIONS:
        return None
    size = np.abs(points).max()
    whole = np.column_stack([points / size, np.ones(len(points))])
    rows = np.linalg.svd(np.hstack([-image[:, 1:] * whole, image[:, :1] * whole]))[2][-1].reshape(2, 4)
    rows *= np.sign(np.median((image * (whole @ rows.T)).sum(axis=1)))
    lengths = np.linalg.norm(rows[:, :3], axis=1)
    if not (lengths > 0.0).all():
        return None
    aspect = 1.0 if one_focal else float(np.sqrt(lengths[0] / lengths[1]))
    rows /= (np.full(2, lengths.mean()) if one_focal else lengths * np.array([1.0, mirror]))[:, None]
    U, _, Vt = np.linalg.svd(rows[:, :3], full_matrices=False)
    R = U @ Vt
    aside = whole[:, :3] @ R.T + rows[:, 3]
    seen = image / [aspect, mirror / aspect]
    return _Directions(aside=aside, depth=whole[:, :3] @ np.cross(R[0], R[1]), seen=seen, aspect=aspect)


def _likeliest(views: Sequence[_Directions]) -> tuple[float, float]:
    """The focal length of a fisheye by which the views are seen best, and how far it leads off (mean)."""
    lengths = FISHEYES
    for finer in (True, False):
        misfits = [sum(_misfit(view, length) for view in views) / len(views) for length in lengths]
        best = int(np.argmin(misfits))
        if finer:
            step = FISHEYES[1] / FISHEYES[0]
            lengths = lengths[best] * np.geomspace(1 / step, step, 9)
    return float(lengths[best]), float(misfits[best])


def _misfit(view: _Directions, length: float) -> float:
    """How far points are seen (mean) from where a fisheye has them, at the depth that suits it best."""
    angle, aside = (np.linalg.norm(each, axis=1) for each in (view.seen / length, view.aside))
    if angle.max() >= np.pi or not aside.all():
        return np.inf
    with np.errstate(all="ignore"):
        ahead = np.where(angle > 0.0, aside / np.tan(angle), 0.0) - view.depth
    weight = np.square(aside)
    shift = float((weight * ahead).sum() / weight.sum())
    for _ in range(DEPTHS):
        far = view.depth + shift
        off = np.arctan2(aside, far) - angle
        slope = -aside / (np.square(aside) + np.square(far))
        shift -= float((slope * off).sum() / np.square(slope).sum())
    shown = (length * np.arctan2(aside, view.depth + shift) / aside)[:, None] * view.aside
    return float(np.linalg.norm(shown - view.seen, axis=1).mean())
