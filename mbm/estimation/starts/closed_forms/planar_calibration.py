"""Photographs of known points, of a plane most often: the camera, and the pose of each view (Zhang 2000).

Of a fisheye, that focal length with which the planes suit best what was seen.

A view is a product of poses (`chains`): the pose of the board alone, or that of the camera in its rig and of the board
before the rig, or of a hand and an eye. The camera is found with the products free; a single pose is given, too.

Where a camera stands before the unknown poses through which it sees, from how its images move with the points.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.cameras import (
    Camera,
    Lens,
    camera_numbers,
    cameras_of,
    outlook,
    pose_of_plane,
)
from mbm.estimation.starts.closed_forms.chains import (
    FRAME,
    Chain,
    Lines,
    chain,
    is_pose,
    put_pose,
    rows_of_products,
    without_poses,
)
from mbm.estimation.starts.closed_forms.moved_points import MovedPoints
from mbm.estimation.starts.closed_forms.rows import Rows
from mbm.estimation.starts.closed_forms.types import AGREEMENT, Candidate, Plan, Situation
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Axes:
    """``turn`` (3, 3) leads from x, y, z of a camera to right, down, forward; ``signs`` (2,) of its image to these."""

    turn: Floats
    signs: Floats


OPENCV = Axes(turn=np.eye(3), signs=np.ones(2))
AXES = (
    OPENCV,
    Axes(turn=np.eye(3)[[1, 2, 0]], signs=np.ones(2)),  # the paper's, but for a half turn of the image
    Axes(turn=np.diag([1.0, -1.0, -1.0]), signs=np.array([1.0, -1.0])),  # OpenGL's; its pinholes are turned OpenCV's
)

PLANAR = 1e-3
"""Extent of the points across their plane beside the largest, up to which a start takes them for plane: coordinates of
boards are measured, and rounded."""

LEAST_IN_SPACE, DEEP = 6, 0.03
"""Points of space that tell the camera by their image, and their extent across the likeliest plane beside the largest
from which on they do, whatever the noise."""

PROBE = np.array([0.4, 0.7, 1.3])
"""A place to look at: before the camera, with either axes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """Points (n, 2) in coordinates of their plane, or (n, 3) in space, and where a camera sees them (n, 2).

    ``basis`` (3, 3) and ``origin`` place the plane in space. ``places`` (7,) are those of the numbers of the one
    unknown pose through which it is seen, or none; ``inverse``: it is the inverse of that pose. ``eye`` is the camera's
    known pose before it, if there is one. ``ahead`` is −1 where the camera looks along −z, ``sense`` where its focal
    lengths are negative.
    """

    camera: int
    lens: Lens
    plane: Floats
    image: Floats
    basis: Floats
    origin: Floats
    axes: Axes
    eye: Eye | None
    places: Indices
    inverse: bool
    ahead: float
    sense: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Views:
    """Views by some cameras; ``columns`` are those of a camera's numbers among the candidate's."""

    views: tuple[View, ...] = field(repr=False)
    cameras: Mapping[int, Camera]
    columns: Indices


@dataclass(frozen=True, slots=True)
class PlanarCalibration:
    """Homographies, the image of the absolute conic, then the pose of each view.

    Distortion is left at its start; without one, it starts at nothing.
    """

    name: str = "planar-calibration"
    joint: bool = True

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Images of points of planes by products of poses, affine in two to four numbers of a camera."""
        poses = [is_pose(entry) for entry in candidate.entries]
        if not any(poses) or all(poses) or candidate.paired:
            return None
        columns, cameras = cameras_of(candidate)
        views: list[View] = []
        known: dict[int, Camera] = {}
        for number, camera in enumerate(cameras):
            seen = _seen(situation, camera, number)
            if seen is None:
                continue
            known[number] = seen[0]
            views += seen[1]
        if not views:
            return None
        rows = Rows.without_numbers(len(views), 2)
        data = Views(views=tuple(views), cameras=known, columns=columns)
        return Plan(form=self, candidate=candidate, rows=rows, minimal=1, data=data)

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """One solution of all cameras together, (T, 1, K·s); NaN for what the views do not determine."""
        return np.stack([_solved(plan, subset) for subset in subsets])[:, None, :]


def _seen(situation: Situation, camera: Camera, number: int) -> tuple[Camera, list[View]] | None:
    """What the numbers of a camera are, and its views of planes; None if it is no such camera, or sees none.

    Poses that closed forms have found meanwhile are unknown again, so that each view has a pose of its own.
    """
    numbers = without_poses(situation)
    numbers[camera.places] = 0.0
    free = situation.with_numbers(numbers)
    views: list[View] = []
    for poses, lines in _lines(free, camera).items():
        kinds = camera.recognised(free, lines, poses)
        if kinds is None or (camera.kinds and camera.kinds != kinds):
            return None
        camera = replace(camera, kinds=kinds)
        found = chain(camera.probed(free), lines, poses, 2)
        if found is not None:
            views += _views(situation, camera, found, number)
    return (camera, views) if views else None


def _lines(situation: Situation, camera: Camera) -> dict[tuple[int, ...], Lines]:
    """The rows that mention a camera's numbers, by the poses that they miss."""
    found: dict[tuple[int, ...], list[tuple[Group, Indices]]] = {}
    numbers = [situation.layout.entries.index(entry) for entry in camera.entries]
    groups = {group.number: group for entry in numbers for group in situation.mentioning[entry]}
    for group in groups.values():
        mine = np.flatnonzero(np.isin(group.index, camera.places).any(axis=1))
        for poses, rows in rows_of_products(situation, group, mine):
            found.setdefault(poses, []).append((group, rows))
    return {poses: tuple(lines) for poses, lines in found.items()}


def _views(situation: Situation, camera: Camera, found: Chain, number: int) -> Iterator[View]:
    """Of each product of poses the points, if they lie in a plane, and where they are seen.

    A camera that stands at a known pose before the unknown ones sees the products from there.
    """
    kinds = ((lens, axes) for lens in Lens for axes in AXES)
    lens, axes = next((kind for kind in kinds if _is_camera(found.moved, *kind)), (Lens.PINHOLE, None))
    eye = standing(found.moved) if axes is None else None
    if axes is not None:
        seen = lens.image(axes.turn @ PROBE) - axes.signs * _sign(found.moved, axes) * found.moved.values(PROBE)
        forward = axes.turn[2]
    elif eye is not None:
        seen, forward = eye.image(PROBE) - found.moved.values(PROBE), eye.R[2]
    else:
        return
    ahead = np.where(outlook(situation, found.moved) @ forward < 0, -1.0, 1.0)
    order = np.argsort(found.product, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(found.product[order])) + 1):
        points = found.points[rows]
        origin = points.mean(axis=0)
        _, extent, basis = np.linalg.svd(points - origin, full_matrices=False)
        spatial = len(rows) >= LEAST_IN_SPACE and lens is Lens.PINHOLE and extent[2] > DEEP * extent[0]
        if not spatial and (len(rows) < 4 or not extent[2] <= PLANAR * extent[0] < extent[1]):
            continue
        basis[2] = np.cross(basis[0], basis[1])
        link = found.links[0] if len(found.links) == 1 else None
        yield View(
            camera=number,
            lens=lens,
            plane=(points - origin) @ basis[: 3 if spatial else 2].T,
            image=seen[rows],
            basis=basis.T,
            origin=origin,
            axes=axes or OPENCV,
            eye=eye,
            places=np.empty(0, dtype=np.int64) if link is None else link.places(int(link.member[rows[0]])),
            inverse=link is not None and link.inverse,
            ahead=float(ahead[rows[0]]),
            sense=camera.sense(situation),
        )


def _sign(moved: MovedPoints, axes: Axes) -> float:
    """Whether the residual is model − measured (1) or the other way round (-1): what is farther right is seen so."""
    change = moved.values(PROBE + axes.turn[0])[0, 0] - moved.values(PROBE)[0, 0]
    return 1.0 if change > 0 else -1.0


def _is_camera(moved: MovedPoints, lens: Lens, axes: Axes) -> bool:
    """Whether images move as those of an undistorted camera with focal length 1, this lens and these axes."""
    signs = _sign(moved, axes) * axes.signs
    first = moved.values(PROBE)
    for other in (np.array([0.6, -0.3, 1.1]), np.array([1.7, 0.2, 0.9])):
        expected = signs * (lens.image(axes.turn @ other) - lens.image(axes.turn @ PROBE))
        if not np.allclose(moved.values(other) - first, expected, rtol=AGREEMENT, atol=AGREEMENT):
            return False
    return True


def _solved(plan: Plan, subset: Indices) -> Floats:
    data: Views = plan.data
    places = plan.candidate.places
    result = np.full(places.shape, np.nan)
    chosen = [data.views[k] for k in subset]
    for number, camera in data.cameras.items():
        views = [view for view in chosen if view.camera == number]
        if not views:
            continue
        first = views[0]
        spatial = [view for view in views if view.plane.shape[1] == 3]
        views = [] if spatial else views  # the poses then follow from the camera
        seen = [(view.plane, view.image) for view in spatial or views]
        found = camera_in_space(camera.kinds, seen) if spatial else camera_numbers(camera.kinds, first.lens, seen)
        if found is None:
            continue
        numbers, homographies = found
        # Images that a pinhole turns about its centre with positive numbers are those of the opposite centre.
        turned = first.ahead * first.sense if first.lens is Lens.PINHOLE else 1.0
        senses = np.array([first.sense] * 3 + [turned, turned * first.axes.signs[1], 1.0])
        numbers = numbers * senses[list(camera.kinds)]
        mine = np.flatnonzero((places[:, data.columns] == camera.places).all(axis=1))
        result[np.ix_(mine, data.columns)] = numbers
        for view, each in zip(views, homographies, strict=True):
            if view.places.size and bool(np.isfinite(each).all()):
                put_pose(result, places, view.places, _pose(view, each))
    return result.ravel()


def _pose(view: View, homography: Floats) -> Floats:
    """The pose (7,) from a homography to the image of focal length 1; the plane is before the camera."""
    R, t = pose_of_plane(homography * np.array([[view.sense], [view.sense], [1.0]]), view.ahead)
    R = view.axes.turn.T @ R @ view.basis.T
    t = view.axes.turn.T @ t - R @ view.origin
    if view.eye is not None:
        R, t = view.eye.R.T @ R, view.eye.R.T @ (t - view.eye.t)
    return FRAME.numbers(np.ones(()), R.T, -R.T @ t) if view.inverse else FRAME.numbers(np.ones(()), R, t)


PLANAR_CALIBRATION = PlanarCalibration()


PLACES = 24
"""Places that are looked at; six would tell all."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Eye:
    """An undistorted camera of focal length 1 (z forward) at the pose ``R``, ``t``: it sees R p + t."""

    R: Floats
    t: Floats

    def image(self, places: Floats) -> Floats:
        """Where places (…, 3) are seen (…, 2)."""
        p = places @ self.R.T + self.t
        with np.errstate(all="ignore"):
            return np.asarray(p[..., :2] / p[..., 2:])


def standing(moved: MovedPoints) -> Eye | None:
    """The camera that sees the places of all rows, if they have one: its residual is the image less what was measured.

    By the direct linear transformation (Abdel-Aziz and Karara 1971) of the first row, whose measured image shifts the
    principal point.
    """
    places = np.random.default_rng(0).uniform(-2.0, 2.0, size=(PLACES, 3))
    values = np.stack([moved.values(place) for place in places])
    known = np.isfinite(values).all(axis=(1, 2))
    if int(known.sum()) < PLACES // 2:
        return None
    places, values = places[known], values[known]
    P = _projection(places, values[:, 0])
    R, t = P[:, :3].copy(), P[:, 3].copy()
    shift = R[:2] @ R[2]
    R[:2] -= np.outer(shift, R[2])
    t[:2] -= shift * t[2]
    if not np.allclose(R @ R.T, np.eye(3), atol=AGREEMENT) or np.linalg.det(R) < 0:
        return None
    eye = Eye(R=R, t=t)
    shown = eye.image(places)[:, None]
    apart = values - values[:1] - (shown - shown[:1])
    size = 1.0 + np.abs(values).max() + np.abs(shown).max()
    return eye if bool(np.abs(apart).max() <= AGREEMENT * size) else None


def camera_in_space(kinds: tuple[int, ...], views: Sequence[tuple[Floats, Floats]]) -> tuple[Floats, Floats] | None:
    """A camera's numbers (s,) from images of points (n, 3) of space, the medians of all views; and no homography.

    ``P = K [R t]`` by the direct linear transformation of each, and K from ``M Mᵀ = K Kᵀ``, M = K R (Hartley and
    Zisserman 2004, 7.1). None where they tell of no camera.
    """
    found = []
    for points, image in views:
        extent, middle = float(np.ptp(image, axis=0).max()), image.mean(axis=0)
        M = _projection(points / np.abs(points).max(), (image - middle) / extent)[:, :3]
        conic = M @ M.T
        centre = conic[:2, 2]
        fy = np.sqrt(conic[1, 1] - centre[1] ** 2)
        fx = np.sqrt(conic[0, 0] - centre[0] ** 2 - ((conic[0, 1] - centre[0] * centre[1]) / fy) ** 2)
        found.append([*(extent * np.array([fx, fy, (fx + fy) / 2])), *(extent * centre + middle), 0.0])
    known = np.array([each for each in found if np.isfinite(each).all()]).reshape(-1, 6)
    return (np.median(known, axis=0)[list(kinds)], np.empty((0, 3, 3))) if len(known) else None


def _projection(places: Floats, images: Floats) -> Floats:
    """P (3, 4) with ``images ~ P (places, 1)``, its third row of length 1, most places before the camera."""
    whole = np.column_stack([places, np.ones(len(places))])
    nothing = np.zeros_like(whole)
    lines = [np.hstack([whole, nothing, -images[:, :1] * whole]), np.hstack([nothing, whole, -images[:, 1:] * whole])]
    P = np.linalg.svd(np.vstack(lines))[2][-1].reshape(3, 4)
    P /= np.linalg.norm(P[2, :3]) * np.sign(np.linalg.det(P[:, :3]))
    return np.asarray(P)
