"""Photographs of a plane of known points: the camera and the pose of each view (Zhang 2000)."""

from __future__ import annotations

from dataclasses import field

import numpy as np

from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.frames import WholeFrame
from mbm.estimation.starts.closed_forms.moved_points import MovedPoints, moved_points
from mbm.estimation.starts.closed_forms.numerics.planes import Knowledge, camera_from_planes, homography
from mbm.estimation.starts.closed_forms.rows import Rows
from mbm.estimation.starts.closed_forms.situation import AGREEMENT, Candidate, Situation
from mbm.estimation.starts.closed_forms.types import Plan
from mbm.problem.types import UnknownKind
from mbm.rotations import nearest
from mbm.values import dataclass

AXES = ((0, 1, 2), (1, 2, 0))
"""Right, down, forward among x, y, z: OpenCV's cameras, and the paper's."""

PLANAR = 1e-9
"""Extent of the points across their plane beside the largest."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Views:
    """Points (n, 2) in coordinates of their plane, and where they are seen (n, 2) from the centre that is known.

    ``intrinsic`` says of each unknown of the camera, in the candidate's order, what it is: a focal length of axis 0, 1
    or of both (2), or a coordinate of the centre (3, 4). ``basis`` (3, 3) and ``origin`` place the plane in space.
    """

    moved: MovedPoints = field(repr=False)
    intrinsic: tuple[int, ...]
    plane: Floats
    image: Floats
    basis: Floats
    origin: Floats
    axes: tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class PlanarCalibration:
    """Homographies, the image of the absolute conic, then the pose of each view; distortion is left at its start."""

    name: str = "planar-calibration"
    joint: bool = True

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Images of points of one plane by poses of a family, affine in two to four numbers that all views share."""
        kinds = [entry.unknown.kind for entry in candidate.entries]
        poses = [e for e in candidate.entries if e.unknown.kind is UnknownKind.POSE and e.unknown.dimension == 3]
        if len(poses) != 1 or kinds.count(UnknownKind.POSE) != 1 or not 1 <= len(kinds) - 1 <= 4:
            return None
        if any(e.unknown.size != 1 for e in candidate.entries if e is not poses[0]):
            return None
        rows = candidate.rows(2)
        intrinsic = _intrinsic(rows, candidate, poses[0]) if len(rows) else None
        if intrinsic is None:
            return None
        views = _views(situation, candidate, poses[0], intrinsic)
        if views is None:
            return None
        return Plan(form=self, candidate=candidate, rows=rows, minimal=4, data=views)

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """One solution of all views together, (T, 1, K·s); NaN where the views do not determine the camera."""
        return np.stack([_solved(plan, subset) for subset in subsets])[:, None, :]


def _pose_columns(candidate: Candidate, pose: Entry) -> slice:
    """Where the pose's numbers stand among the candidate's."""
    first = 0
    for entry in candidate.entries:
        if entry is pose:
            break
        first += entry.unknown.size
    return slice(first, first + 7)


def _intrinsic(rows: Rows, candidate: Candidate, pose: Entry) -> tuple[int, ...] | None:
    """What each of the camera's numbers is, by how the image depends on it; None if it is no such camera."""
    place = _pose_columns(candidate, pose)
    others = [i for i in range(candidate.places.shape[1]) if not place.start <= i < place.stop]
    coordinate = [i if i < place.start else i - 1 for i in others]  # a pose has six coordinates
    base = np.zeros(candidate.places.shape[1])
    base[place] = WholeFrame(dimension=3, moves=True, scales=False).numbers(
        np.ones(()), np.eye(3), np.array([0.31, 0.47, 5.3])
    )
    other = base.copy()
    other[place] = WholeFrame(dimension=3, moves=True, scales=False).numbers(
        np.ones(()), np.eye(3), np.array([5.2, -0.64, 6.9])
    )
    slopes = [rows.slopes(p)[..., coordinate] for p in (base, other)]
    shifted = base.copy()
    shifted[others] = np.arange(1.0, len(others) + 1)
    if not np.allclose(rows.slopes(shifted)[..., coordinate], slopes[0], rtol=1e-9, atol=1e-12):
        return None
    if not np.allclose(rows.values(base), rows.values(other), rtol=1e-9, atol=1e-9):
        return None
    found = []
    for j in range(len(others)):
        one = slopes[0][..., j]
        constant = np.allclose(one, slopes[1][..., j])
        axes = [bool(np.abs(one[:, i]).max() > 0) for i in range(2)]
        if constant and sum(axes) == 1 and np.allclose(np.abs(one[:, axes.index(True)]), 1.0):
            found.append(3 + axes.index(True))
        elif not constant:
            found.append(2 if all(axes) else axes.index(True))
        else:
            return None
    focal = sorted(i for i in found if i < 3)
    centre = sorted(i for i in found if i > 2)
    return tuple(found) if focal in ([2], [0, 1]) and centre in ([], [3, 4]) else None


def _views(situation: Situation, candidate: Candidate, pose: Entry, intrinsic: tuple[int, ...]) -> Views | None:
    """The plane and what is seen of it; the camera is probed with focal lengths 1 and its centre at 0."""
    place = _pose_columns(candidate, pose)
    others = [i for i in range(candidate.places.shape[1]) if not place.start <= i < place.stop]
    numbers = situation.numbers.copy()
    numbers[candidate.places[0, others]] = [1.0 if kind < 3 else 0.0 for kind in intrinsic]
    number = situation.layout.entries.index(pose)
    members = (candidate.places[:, place.start] - pose.offset) // pose.unknown.size
    alone = situation.with_numbers(numbers).candidate((number,), members[:, None])
    moved = moved_points(alone, alone.rows(2)) if alone is not None else None
    if moved is None:
        return None
    probe = np.array([0.4, 0.7, 1.3])
    axes = next((a for a in AXES if _is_pinhole(moved, probe, a)), None)
    origin = moved.points.mean(axis=0)
    _, extent, basis = np.linalg.svd(moved.points - origin, full_matrices=True)
    if axes is None or len(extent) < 3 or not extent[2] <= PLANAR * extent[0] < extent[1]:
        return None
    basis[2] = np.cross(basis[0], basis[1])
    sign = _sign(moved, probe, axes)
    seen = _pinhole(probe, axes) - sign * moved.values(probe)
    plane = (moved.points - origin) @ basis[:2].T
    return Views(moved=moved, intrinsic=intrinsic, plane=plane, image=seen, basis=basis.T, origin=origin, axes=axes)


def _pinhole(p: Floats, axes: tuple[int, int, int]) -> Floats:
    return np.asarray(p[list(axes[:2])] / p[axes[2]])


def _sign(moved: MovedPoints, probe: Floats, axes: tuple[int, int, int]) -> float:
    """Whether the residual is model − measured (1) or the other way round (-1)."""
    aside = probe + np.eye(3)[axes[0]]
    change = moved.values(aside)[0, 0] - moved.values(probe)[0, 0]
    return 1.0 if change * (_pinhole(aside, axes)[0] - _pinhole(probe, axes)[0]) > 0 else -1.0


def _is_pinhole(moved: MovedPoints, probe: Floats, axes: tuple[int, int, int]) -> bool:
    """Whether images move as those of an undistorted camera with focal length 1 and these axes."""
    sign = _sign(moved, probe, axes)
    first = moved.values(probe)
    for other in (np.array([0.6, -0.3, 1.1]), np.array([1.7, 0.2, 0.9])):
        expected = sign * (_pinhole(other, axes) - _pinhole(probe, axes))
        if not np.allclose(moved.values(other) - first, expected, rtol=AGREEMENT, atol=AGREEMENT):
            return False
    return True


def _solved(plan: Plan, subset: Indices) -> Floats:
    views: Views = plan.data
    candidate = plan.candidate
    nothing = np.full(candidate.places.size, np.nan)
    members = plan.rows.member[subset]
    H = [homography(views.plane[subset[members == m]], views.image[subset[members == m]]) for m in np.unique(members)]
    homographies = np.stack(H)
    if len(H) < candidate.members or not bool(np.isfinite(homographies).all()):
        return nothing
    known = Knowledge(one_focal=2 in views.intrinsic, centred=3 not in views.intrinsic)
    focal, centre = camera_from_planes(homographies, known)
    if not bool(np.isfinite(focal).all()):
        return nothing
    values = np.array([focal[0], focal[1], focal.mean(), centre[0], centre[1]])
    result = np.empty(candidate.places.shape)
    pose = next(e for e in candidate.entries if e.unknown.kind is UnknownKind.POSE)
    place = _pose_columns(candidate, pose)
    others = [i for i in range(candidate.places.shape[1]) if not place.start <= i < place.stop]
    result[:, others] = values[list(views.intrinsic)]
    R, t = _poses(homographies, focal, np.where(known.centred, 0.0, centre), views)
    result[:, place] = views.moved.frame.numbers(np.ones(len(R)), R, t)
    return result.ravel()


def _poses(H: Floats, focal: Floats, centre: Floats, views: Views) -> tuple[Floats, Floats]:
    """Rotations (K, 3, 3) and translations (K, 3) from ``H ~ K [r₁ r₂ t]``, each view before the camera."""
    camera = np.array([[focal[0], 0, centre[0]], [0, focal[1], centre[1]], [0, 0, 1.0]])
    M = np.linalg.solve(camera, H)
    M = M / (np.linalg.norm(M[:, :, :2], axis=1).mean(axis=1) * np.sign(M[:, 2, 2]))[:, None, None]
    frame = np.stack([M[:, :, 0], M[:, :, 1], np.cross(M[:, :, 0], M[:, :, 1])], axis=2)
    order = np.argsort(views.axes)  # from right, down, forward to x, y, z
    R = nearest(frame)[:, order, :] @ views.basis.T
    t = M[:, order, 2] - np.einsum("kij,j->ki", R, views.origin)
    if views.moved.inverse:
        R = np.swapaxes(R, 1, 2)
        t = -np.einsum("kij,kj->ki", R, t)
    return R, t


PLANAR_CALIBRATION = PlanarCalibration()
