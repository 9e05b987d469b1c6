"""Photographs of known points, of a plane most often: the camera, and the pose of each view (Zhang 2000).

Of a fisheye, that focal length with which the planes suit best what was seen; `numerics` say how points of space tell.

A view is a product of poses (`chains`): the pose of the board alone, or that of the camera in its rig and of the board
before the rig, or of a hand and an eye. The camera is found with the products free; a single pose is given, too.

Where a camera stands before the unknown poses through which it sees, from how its images move with the points.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import field
from operator import itemgetter

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.cameras import (
    LEAST_POINTS,
    Camera,
    Lens,
    cameras_of,
    outlook,
    told_by,
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
from mbm.estimation.starts.closed_forms.numerics.parallel import LINE
from mbm.estimation.starts.closed_forms.numerics.space import projection
from mbm.estimation.starts.closed_forms.rows import Rows
from mbm.estimation.starts.closed_forms.types import AGREEMENT, Candidate, Plan, Situation
from mbm.rotations import inverse_motion
from mbm.values import dataclass

AXES = (
    np.eye(3),  # opencv
    np.eye(3)[[1, 2, 0]],  # the paper's, but for a half turn of the image
    np.diag([1.0, -1.0, -1.0]),  # OpenGL's; its pinholes are turned OpenCV's
)
"""What leads from x, y, z of a camera to right, down, forward, but for the signs of the image."""

PROBE = np.array([0.4, 0.7, 1.3])
"""A place to look at: before the camera, with either axes."""

ELSEWHERE, FAR = (np.array([0.6, -0.3, 1.1]), np.array([1.7, 0.2, 0.9])), 1e4
"""Two more, and how many times as far ahead lenses do not distort, to 1e-8."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """Points (n, 3) in axes of their own, the last of which is across their plane, and where a camera sees them (n, 2).

    ``basis`` (3, 3) and ``origin`` place them in space. ``places`` (7,) are those of the numbers of the one unknown
    pose through which they are seen, or none; ``inverse``: it is the inverse of that pose. ``eye`` is the known pose of
    the camera before it, if there is one; ``turn`` (3, 3) leads to right, down, forward, ``ahead`` is −1 where it looks
    the other way. The image is without signs; ``centre`` (2,) are the numbers of its centre beside where it is
    there, ``known`` (2,) focal lengths that are no numbers of the camera, else NaN.
    """

    camera: int
    lens: Lens
    points: Floats
    image: Floats
    basis: Floats
    origin: Floats
    turn: Floats
    eye: Eye | None
    places: Indices
    inverse: bool
    ahead: float
    centre: Floats
    known: Floats


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
    for poses, lines in lines_of(free, camera).items():
        recognised = camera.recognised(free, lines, poses)
        if recognised is None or (camera.kinds and camera.kinds != recognised[0].kinds):
            return None
        camera, growing = recognised
        found = chain(camera.probed(situation, numbers), lines, poses, 2)
        if found is not None:
            views += _views(situation, camera, found, number, growing)
    return (camera, views) if views else None


def lines_of(situation: Situation, camera: Camera) -> dict[tuple[int, ...], Lines]:
    """The rows that mention a camera's numbers, by the poses that they miss."""
    found: dict[tuple[int, ...], list[tuple[Group, Indices]]] = {}
    numbers = [situation.layout.entries.index(entry) for entry in camera.entries]
    groups = {group.number: group for entry in numbers for group in situation.mentioning[entry]}
    for group in groups.values():
        mine = np.flatnonzero(np.isin(group.index, camera.places).any(axis=1))
        for poses, rows in rows_of_products(situation, group, mine):
            found.setdefault(poses, []).append((group, rows))
    return {poses: tuple(lines) for poses, lines in found.items()}


def _views(situation: Situation, camera: Camera, found: Chain, number: int, growing: Floats) -> Iterator[View]:
    """Of each product of poses the points, if they lie on no line, and where they are seen.

    A camera that stands at a known pose before the unknown ones sees the products from there. ``growing`` (2,): how the
    image grows with the numbers of the centre.
    """
    sight = _sight(found.moved)
    eye = standing(found.moved) if sight is None else None
    if sight is not None:
        lens, turn, scale, place = sight
        signs, shown, forward = np.where(camera.unknown(), scale, np.sign(scale)), lens.image(turn @ place), turn[2]
    elif eye is not None and camera.unknown().all():
        lens, turn, scale, place = Lens.PINHOLE, np.eye(3), np.ones(2), PROBE
        signs, shown, forward = scale, eye.image(PROBE), eye.R[2]
    else:
        return
    seen = (scale * shown - found.moved.values(place)) / signs
    ahead = np.where(outlook(situation, found.moved) @ forward < 0, -1.0, 1.0)
    order = np.argsort(found.product, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(found.product[order])) + 1):
        points = found.points[rows]
        origin = points.mean(axis=0)
        _, extent, basis = np.linalg.svd(points - origin, full_matrices=False)
        if len(rows) < LEAST_POINTS or not extent[1] > LINE * extent[0]:
            continue
        basis[2] = np.cross(basis[0], basis[1])
        link = found.links[0] if len(found.links) == 1 else None
        yield View(
            camera=number,
            lens=lens,
            points=(points - origin) @ basis.T,
            image=seen[rows],
            basis=basis.T,
            origin=origin,
            turn=turn,
            eye=eye,
            places=np.empty(0, dtype=np.int64) if link is None else link.places(int(link.member[rows[0]])),
            inverse=link is not None and link.inverse,
            ahead=float(ahead[rows[0]]),
            centre=signs * growing,
            known=np.where(camera.unknown(), np.nan, np.abs(scale)),
        )


def _sight(moved: MovedPoints) -> tuple[Lens, Floats, Floats, Floats] | None:
    """The lens and axes, scales (2,) and a place (3,), if images move as those of a camera of these, times the scales.

    The signs of these say which way the image grows, and whether the residual is model − measured or the other way
    round. Where the camera is distorted, that of its places near its axis, and the lens that suits the others best.
    """
    kinds = [(lens, turn) for lens in Lens for turn in AXES]
    for depth in (1.0, FAR):
        scales = [(lens, turn, _scale(moved, lens, turn, depth)) for lens, turn in kinds]
        found = [
            (_off(moved, lens, turn, scale, 1.0), lens, turn, scale)
            for lens, turn, scale in scales
            if scale is not None and _off(moved, lens, turn, scale, depth) <= AGREEMENT
        ]
        if found:
            _, lens, turn, scale = min(found, key=itemgetter(0))
            return lens, turn, scale, _place(PROBE, turn, depth)
    return None


def _place(place: Floats, turn: Floats, depth: float) -> Floats:
    """A place (3,) so many times as far ahead."""
    return np.asarray(turn.T @ (turn @ place * [1.0, 1.0, depth]))


def _scale(moved: MovedPoints, lens: Lens, turn: Floats, depth: float) -> Floats | None:
    """How many times as far as that of a lens the image moves with a point that moves aside, along both axes (2,)."""
    places = [_place(each, turn, depth) for each in (PROBE, PROBE + turn[0], PROBE + turn[1])]
    first, *aside = [moved.values(p)[0] for p in places]
    shown, *other = [lens.image(turn @ p) for p in places]
    scale = np.array([(aside[i] - first)[i] / (other[i] - shown)[i] for i in range(2)])
    return scale if bool(np.isfinite(scale).all() and scale.all()) else None


def _off(moved: MovedPoints, lens: Lens, turn: Floats, scale: Floats, depth: float) -> float:
    """By how much images move otherwise, beside how far they do."""
    first, *others = [_place(each, turn, depth) for each in (PROBE, *ELSEWHERE)]
    off = size = 0.0
    for other in others:
        expected = lens.image(turn @ other) - lens.image(turn @ first)
        off = max(off, float(np.abs((moved.values(other) - moved.values(first)) / scale - expected).max()))
        size = max(size, float(np.abs(expected).max()))
    return off / size if np.isfinite(off) else np.inf


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
        seen = [(view.points, view.image) for view in views]
        told = told_by(camera, first.lens, seen, first.known, first.ahead)
        if told is None:
            continue
        numbers = np.array([*told.focal, np.abs(told.focal).mean(), *(told.centre * first.centre), 0.0])
        mine = np.flatnonzero((places[:, data.columns] == camera.places).all(axis=1))
        result[np.ix_(mine, data.columns)] = numbers[list(camera.kinds)] * camera.signs(plan.candidate.situation)
        for view, pose in zip(views, told.poses, strict=True):
            if view.places.size and pose is not None:
                put_pose(result, places, view.places, _pose(view, *pose))
    return result.ravel()


def _pose(view: View, R: Floats, t: Floats) -> Floats:
    """The numbers (7,) of the pose, from that of the points in their axes."""
    R = view.turn.T @ R @ view.basis.T
    t = view.turn.T @ t - R @ view.origin
    if view.eye is not None:
        R, t = view.eye.R.T @ R, view.eye.R.T @ (t - view.eye.t)
    return FRAME.numbers(np.ones(()), *(inverse_motion(R, t) if view.inverse else (R, t)))


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
    P = projection(places, values[:, 0])
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
