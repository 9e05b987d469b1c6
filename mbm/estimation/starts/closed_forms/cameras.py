"""Cameras whose numbers are unknown: what each number is, by how images depend on it where it is probed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import Enum

import numpy as np

from mbm.equations.at_rows import DIVIDES_BY_DEPTH, looks_back
from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.starts.closed_forms.chains import Lines, is_pose, with_poses
from mbm.estimation.starts.closed_forms.moved_points import MovedPoints
from mbm.estimation.starts.closed_forms.numerics.parallel import parallel_camera, parallel_poses
from mbm.estimation.starts.closed_forms.numerics.planes import (
    Knowledge,
    camera_from_planes,
    homography,
    likeliest_camera,
)
from mbm.estimation.starts.closed_forms.numerics.space import (
    DEEP,
    FISHEYES,
    fisheye_in_space,
    in_space,
    off_plane,
    one_focal_length,
    pinhole_in_space,
)
from mbm.estimation.starts.closed_forms.rows import Piece, Rows
from mbm.estimation.starts.closed_forms.types import Candidate, Situation, Support
from mbm.expression.evaluate import evaluate
from mbm.expression.nodes import Column, Component, Constant, Leaf, externals
from mbm.rotations import nearest
from mbm.symbolic.types import ColumnInput, ConstantInput, Slot
from mbm.values import dataclass

ONE_FOCAL, DISTORTION = 2, 5
"""Kinds of a camera's numbers: 0 and 1 are focal lengths of the axes, this is one for both; 3 and 4 the centre."""


def usual(situation: Situation, places: Indices, coordinates: Indices) -> Floats:
    """The numbers at ``places`` (k,) as they are known, or as they are stated; else ±1, as their limits allow."""
    layout = situation.layout
    stated = np.where(layout.guessed[places], np.nan, layout.start[places])
    numbers = np.where(np.isnan(situation.numbers[places]), stated, situation.numbers[places])
    return np.where(np.isnan(numbers), np.where(layout.upper[coordinates] <= 0, -1.0, 1.0), numbers)


def outlook(situation: Situation, moved: MovedPoints) -> Floats:
    """The ways (n, 3) in which cameras look at the points of rows, where these are moved to; NaN where nothing tells.

    Unknown focal lengths are taken to be positive where nothing says that they are negative.
    """
    rest = _depths(situation, moved, np.zeros(3))
    return np.stack([_depths(situation, moved, axis) - rest for axis in np.eye(3)], axis=1)


def _depths(situation: Situation, moved: MovedPoints, place: Floats) -> Floats:
    """How far before their cameras rows have their points (n,) if these are moved to a place (3,); NaN: not known."""
    rows = moved.rows
    numbers = moved.at_places(np.tile(place, (len(rows), 1)))
    found, first = np.full(len(rows), np.nan), 0
    for piece in rows.pieces:
        mine = slice(first, first + len(piece.lines))
        first = mine.stop
        whiteners = [(each.first, each.last) for each in piece.group.whiteners]
        if (piece.first, piece.last) not in whiteners:
            continue
        camera = piece.group.equations[whiteners.index((piece.first, piece.last))].projection
        if camera is None or any(externals((camera.depth, *camera.focal))):
            continue
        given = piece.given(numbers[mine])

        def value(leaf: Leaf, piece: Piece = piece, given: Floats = given) -> Floats:
            return _at_rows(situation, piece, given, leaf)

        depth, *focal = evaluate((camera.depth, *camera.focal), value)
        back = looks_back(*focal) & (camera.model == DIVIDES_BY_DEPTH)
        found[mine] = np.where(back, -np.asarray(depth), depth)
    return found


def _at_rows(situation: Situation, piece: Piece, given: Floats, leaf: Leaf) -> Floats:
    """What a leaf is in some rows (r,) whose unknowns are ``given`` (r, variables), or where not as `usual`.

    NaN if the equation does not take it as it is.
    """
    group, layout = piece.group, situation.layout
    if isinstance(leaf, Component):
        entry = layout.entry(leaf.unknown)
        slot = Slot(leaf.unknown, entry.unknown.indices().index(leaf.index), leaf.member)
        if slot in group.kernel.variables:
            number = group.kernel.variables.index(slot)
            if piece.roles[:, number].max(initial=-1) >= 0 or entry.unknown.freedom != entry.unknown.size:
                return given[:, number]
            places = group.index[piece.lines, number]
            return usual(situation, places, entry.first + places - entry.offset)
    for number, parameter in enumerate(group.kernel.parameters):
        if isinstance(leaf, Column) and isinstance(parameter, ColumnInput):
            told = (parameter.table, parameter.name, parameter.row, parameter.member)
            same = leaf.identity == told and leaf.sampling is parameter.sampling is None
        else:
            same = isinstance(leaf, Constant) and parameter == ConstantInput(leaf.name)
        if same:
            return np.asarray(group.parameters[piece.lines, number])
    return np.full(len(piece.lines), np.nan)


LEAST_POINTS = 4
"""Points of a plane that tell its homography."""

LEVELLED = 1e-9
"""Extent of points of a plane across it, beside the largest, that rounding leaves."""

SHIFTED = 3
"""In which images of points off their plane are shifted into it: each leaves some hundredths of what is off."""

WIDEST, NARROWEST = 0.05, 100.0
"""Focal lengths beside the extent of what is seen, beyond which they are noise."""


STEEPEST = 1.4
"""Angle from the axis, rad, beyond which a pinhole's image is too far out to tell of a plane."""


class Lens(Enum):
    """How directions come into the image of a camera."""

    PINHOLE = "pinhole"
    FISHEYE = "fisheye"
    PARALLEL = "parallel"

    def image(self, p: Floats) -> Floats:
        """Where a camera of focal length 1 sees points (…, 3): right, down, forward."""
        across, ahead = p[..., :2], p[..., 2:]
        if self is Lens.PARALLEL:
            return across
        if self is Lens.PINHOLE:
            return np.asarray(across / ahead)
        radius = np.linalg.norm(across, axis=-1, keepdims=True)
        return np.asarray(across * np.where(radius > 0.0, np.arctan2(radius, ahead) / np.maximum(radius, 1e-300), 1.0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Camera:
    """The unknown numbers (s,) of a camera: their ``places`` and ``coordinates``, and the unknowns they are of.

    ``kinds`` says of each what it is, as above; none if that is not known yet.
    """

    entries: tuple[Entry, ...]
    places: Indices
    coordinates: Indices
    kinds: tuple[int, ...] = ()

    def signs(self, situation: Situation) -> Floats:
        """Those of the numbers (s,): −1 of focal lengths that are known to be negative, else 1."""
        focal = np.array(self.kinds) <= ONE_FOCAL
        return np.where(focal & (usual(situation, self.places, self.coordinates) < 0), -1.0, 1.0)

    def unknown(self) -> Mask:
        """The axes (2,) whose focal length is among the numbers."""
        return np.array([axis in self.kinds or ONE_FOCAL in self.kinds for axis in range(2)])

    def probed(self, situation: Situation, numbers: Floats) -> Situation:
        """With focal lengths of 1 or −1, the centre at 0, and no distortion; the others are as in ``numbers`` (N,)."""
        numbers = numbers.copy()
        numbers[self.places] = np.where(np.array(self.kinds) <= ONE_FOCAL, self.signs(situation), 0.0)
        return situation.with_numbers(numbers)

    def recognised(self, situation: Situation, lines: Lines, poses: tuple[int, ...]) -> tuple[Camera, Floats] | None:
        """With the ``kinds`` of its numbers, by how images of points moved by ``poses`` depend on them.

        And how the coordinates (2,) of the image grow with those of the centre, 1 or −1. None if it is no such camera.
        Where all numbers are nothing, the image is so, too, wherever the point, but for axes whose focal length is
        known: a focal length moves it with the point, a coordinate of the centre alike, and distortion, which a focal
        length multiplies, not at all.
        """
        rows = [self.rows_of(with_poses(situation, poses, t), lines) for t in _PLACES]
        if not len(rows[0]):
            return None
        nothing = np.zeros(len(self.places))
        values, slopes = zip(*(each.linearised(nothing) for each in rows), strict=True)
        if not all(bool(np.isfinite(each).all()) for each in (*values, *slopes)):
            return None
        known = ~np.isclose(values[0], values[1], rtol=1e-9, atol=1e-9).all(axis=0)
        kinds = [_kind(slopes[0][..., j], slopes[1][..., j], known) for j in range(len(self.places))]
        linear = np.array([kind is not None and kind != DISTORTION for kind in kinds])
        shifted = rows[0].slopes(np.where(linear, np.arange(1.0, len(linear) + 1), 0.0))
        if not np.allclose(shifted[..., linear], slopes[0][..., linear], rtol=1e-9, atol=1e-12):
            return None
        distorted = self.coordinates[[kind == DISTORTION for kind in kinds]]
        if None in kinds or bool(situation.layout.positive[distorted].any()):
            return None
        found = replace(self, kinds=tuple(kind for kind in kinds if kind is not None))
        repeated = any(found.kinds.count(kind) > 1 for kind in range(DISTORTION)) or sorted(found.kinds)[1:2] == [2]
        if repeated or bool((found.unknown() == known).any()) or known[0] != known[1]:
            return None
        growing = [slopes[0][0, i, found.kinds.index(3 + i)] if 3 + i in found.kinds else 1.0 for i in range(2)]
        return found, np.sign(growing)

    def rows_of(self, situation: Situation, lines: Lines) -> Rows:
        """Rows in which the camera's numbers are the only unknown ones."""
        support = Support(tuple(sorted(situation.layout.entries.index(entry) for entry in self.entries)))
        return Candidate(
            situation=situation,
            support=support,
            entries=self.entries,
            places=self.places[None],
            coordinates=self.coordinates[None],
            lines=tuple((group, rows, np.zeros(len(rows), dtype=np.int64)) for group, rows in lines),
        ).rows(2)


_PLACES = (np.array([0.31, 0.47, 5.3]), np.array([5.2, -0.64, 6.9]))


def _kind(here: Floats, there: Floats, known: Mask) -> int | None:
    """What a number is, by the slopes (n, 2) of the image with points at two places; ``known`` as above."""
    axes = np.abs(here).max(axis=0) > 0
    if np.allclose(here, there):
        if not axes.any():
            return DISTORTION
        alone = axes.sum() == 1 and np.allclose(np.abs(here[:, axes]), 1.0)
        return 3 + int(np.argmax(axes)) if alone else None
    if known[axes].any():
        return DISTORTION
    return ONE_FOCAL if axes.all() else int(np.argmax(axes))


def cameras_of(candidate: Candidate) -> tuple[Indices, tuple[Camera, ...]]:
    """The columns of a candidate's numbers that are of no pose, and the cameras that these are of, each once.

    What fewer rows know of than a plane needs is no camera: not each point of a reconstruction is taken for one; nor is
    what has directions or rotations, such as the axis of a turntable.
    """
    flat = [entry for entry in candidate.entries if not is_pose(entry)]
    columns = np.flatnonzero([any(_within(p, e.range) for e in flat) for p in candidate.places[0].tolist()])
    steps = np.flatnonzero([any(_within(c, e.coordinates) for e in flat) for c in candidate.coordinates[0].tolist()])
    places, first, which = np.unique(candidate.places[:, columns], axis=0, return_index=True, return_inverse=True)
    rows = np.zeros(len(places), dtype=np.int64)
    for _, _, member in candidate.lines:
        rows += np.bincount(which.ravel()[member], minlength=len(places))
    enough = (rows >= LEAST_POINTS) & all(entry.unknown.manifold.flat for entry in flat)
    places, first = places[enough], first[enough]
    coordinates = candidate.coordinates[np.ix_(first, steps)]
    return columns, tuple(
        Camera(entries=tuple(flat), places=p, coordinates=c) for p, c in zip(places, coordinates, strict=True)
    )


def _within(number: int, span: slice) -> bool:
    return number in range(span.start, span.stop)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Told:
    """What views tell of a camera: its focal lengths (2,), its centre (2,), and a pose R, t for each (None: not)."""

    focal: Floats
    centre: Floats
    poses: tuple[tuple[Floats, Floats] | None, ...]


Seen = tuple[Floats, Floats]
"""Points (n, 3) in axes of their own, the last of which is across their plane, and their images (n, 2)."""


def told_by(camera: Camera, lens: Lens, views: Sequence[Seen], known: Floats, ahead: float) -> Told | None:
    """What views of space tell, or where there is none of them views of planes; None if nothing.

    ``known`` (2,) are focal lengths, NaN where they are not; the plane is before a camera that looks ``ahead``.
    """
    images = np.concatenate([image for _, image in views])
    centred = not {3, 4} & set(camera.kinds)
    middle = np.zeros(2) if centred else (images.min(axis=0) + images.max(axis=0)) / 2
    extent = float(np.ptp(images, axis=0).max())
    scaled = [(points, (image - middle) / extent) for points, image in views]
    found = _scaled(
        lens, scaled, Knowledge(one_focal=ONE_FOCAL in camera.kinds, centred=centred), known / extent, ahead
    )
    if found is None:
        return None
    return replace(found, focal=found.focal * extent, centre=found.centre * extent + middle)


def _scaled(lens: Lens, views: Sequence[Seen], about: Knowledge, known: Floats, ahead: float) -> Told | None:
    """The same of images of the size of one."""
    spatial = [view for view in views if in_space(*view)]
    if lens is Lens.PARALLEL:
        scales = parallel_camera(views, DEEP, one_focal=about.one_focal)
        if scales is None:
            return None
        focal = np.where(np.isnan(known), scales, known)
        poses = [parallel_poses(points, image / focal, DEEP)[:2] for points, image in views]
        return Told(focal=focal, centre=np.zeros(2), poses=tuple((R[0], t[0]) if len(R) else None for R, t in poses))
    few = [view for view in views if off_plane(view[0])]
    if few and not spatial and lens is Lens.PINHOLE and about.one_focal and about.centred:
        return Told(focal=np.full(2, one_focal_length(few, ahead)), centre=np.zeros(2), poses=(None,) * len(views))
    if not spatial:
        return _of_planes(lens, views, about, known, ahead)
    if lens is Lens.FISHEYE:
        found = fisheye_in_space(spatial, centred=about.centred, one_focal=about.one_focal)
    else:
        found = pinhole_in_space(spatial, ahead)
    # the poses then follow from the camera
    return None if found is None else Told(focal=found[0], centre=found[1], poses=(None,) * len(views))


def _of_planes(lens: Lens, views: Sequence[Seen], about: Knowledge, known: Floats, ahead: float) -> Told | None:
    """By homographies; points off their plane have images that are shifted as the camera so found says."""
    shifts = [np.zeros_like(image) for _, image in views]
    thick = any(np.ptp(points[:, 2]) > LEVELLED * np.ptp(points[:, 0]) for points, _ in views)
    for _ in range(SHIFTED if thick else 1):
        planes = [(points[:, :2], image - by) for (points, image), by in zip(views, shifts, strict=True)]
        found = _of_pinhole(planes, about, known) if lens is Lens.PINHOLE else _of_fisheye(planes, known)
        if found is None:
            return None
        focal, centre, homographies = found
        poses = [pose_of_plane(H, ahead) if bool(np.isfinite(H).all()) else None for H in homographies]
        for k, ((points, _), pose) in enumerate(zip(views, poses, strict=True)):
            if pose is not None:
                places = points @ pose[0].T + pose[1]
                flat = places - points[:, 2:] * pose[0][:, 2]
                shifts[k] = focal * (lens.image(places) - lens.image(flat))
    return Told(focal=focal, centre=centre, poses=tuple(poses))


def _of_pinhole(
    views: Sequence[tuple[Floats, Floats]], about: Knowledge, known: Floats
) -> tuple[Floats, Floats, Floats] | None:
    """Focal lengths (2,), centre (2,) and homographies (K, 3, 3) of views whose images are of the size of one.

    The homographies, NaN where a view tells of none, lead to the images of a camera with focal length 1 and centre 0.
    Where few or noisy views give no camera that could see the images, it is the best of a table of cameras.
    """
    every = np.stack([homography(plane, image) for plane, image in views])
    usable = every[np.isfinite(every).all(axis=(1, 2))]
    if not len(usable):
        return None
    focal, centre = camera_from_planes(usable, about)
    sees = bool((focal > WIDEST).all() and (focal < NARROWEST).all() and (np.abs(centre) < 1.0).all())
    if not sees:
        focal, centre = likeliest_camera(usable, centred=about.centred)
    focal = np.where(np.isnan(known), focal, known)
    every[:, :2] = (every[:, :2] - centre[:, None] * every[:, 2:]) / focal[:, None]
    return focal, centre, every


def _of_fisheye(views: Sequence[tuple[Floats, Floats]], known: Floats) -> tuple[Floats, Floats, Floats] | None:
    """The same of a fisheye, with that focal length by which the planes suit their images best, and the centre at 0."""
    lengths = FISHEYES if np.isnan(known).any() else known[:1]
    for finer in (len(lengths) > 1, False):
        trials = [[_through_fisheye(plane, image / length) for plane, image in views] for length in lengths]
        misfits = np.array(
            [[length * misfit for _, misfit in each] for length, each in zip(lengths, trials, strict=True)]
        )
        misfits = misfits[:, np.isfinite(misfits).any(axis=0)]
        if not misfits.size:
            return None
        best = int(np.argmin(misfits.sum(axis=1)))
        if finer:
            step = FISHEYES[1] / FISHEYES[0]
            lengths = lengths[best] * np.geomspace(1 / step, step, 9)
    return np.full(2, lengths[best]), np.zeros(2), np.stack([H for H, _ in trials[best]])


def _through_fisheye(plane: Floats, image: Floats) -> tuple[Floats, float]:
    """The homography (3, 3) of a pinhole in place of a fisheye with focal length 1, and how far it leads off.

    That is the mean distance of the points in the image of the fisheye; infinite where too few of them tell.
    """
    angle = np.linalg.norm(image, axis=1)
    seen = angle < STEEPEST
    with np.errstate(all="ignore"):
        straight = image * np.where(angle > 0.0, np.tan(angle) / angle, 1.0)[:, None]
    H = homography(plane[seen], straight[seen])
    if not bool(np.isfinite(H).all()):
        return np.full((3, 3), np.nan), np.inf
    R, t = pose_of_plane(H)
    again = Lens.FISHEYE.image(plane @ R[:, :2].T + t)
    return H, float(np.linalg.norm(again - image, axis=1).mean())


def pose_of_plane(H: Floats, ahead: float = 1.0) -> tuple[Floats, Floats]:
    """R (3, 3), t (3,) with ``H ~ [r₁ r₂ t]``, the plane before a camera that looks ``ahead`` (1: along z, −1)."""
    M = H / (np.linalg.norm(H[:, :2], axis=0).mean() * np.sign(H[2, 2]) * ahead)
    return nearest(np.stack([M[:, 0], M[:, 1], np.cross(M[:, 0], M[:, 1])], axis=1)), M[:, 2]
