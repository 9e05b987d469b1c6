"""Cameras whose numbers are unknown: what each number is, by how images depend on it where it is probed."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

import numpy as np

from mbm.equations.at_rows import DIVIDES_BY_DEPTH, looks_back
from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.chains import FRAME, Lines, is_pose
from mbm.estimation.starts.closed_forms.moved_points import MovedPoints
from mbm.estimation.starts.closed_forms.numerics.planes import (
    Knowledge,
    camera_from_planes,
    homography,
    likeliest_camera,
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

WIDEST, NARROWEST = 0.05, 100.0
"""Focal lengths beside the extent of what is seen, beyond which they are noise."""


FISHEYES = np.geomspace(0.15, 10.0, 31)
"""Focal lengths of fisheyes that are tried, beside the extent of what is seen: from all around to 6°."""

STEEPEST = 1.4
"""Angle from the axis, rad, beyond which a pinhole's image is too far out to tell of a plane."""


class Lens(Enum):
    """How directions come into the image of a camera."""

    PINHOLE = "pinhole"
    FISHEYE = "fisheye"

    def image(self, p: Floats) -> Floats:
        """Where a camera of focal length 1 sees points (…, 3): right, down, forward."""
        across, ahead = p[..., :2], p[..., 2:]
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

    def sense(self, situation: Situation) -> float:
        """−1 where all its focal lengths are known to be negative, else 1."""
        focal = np.array(self.kinds) <= ONE_FOCAL
        return -1.0 if bool((usual(situation, self.places[focal], self.coordinates[focal]) < 0).all()) else 1.0

    def probed(self, situation: Situation) -> Situation:
        """With focal lengths of 1, the centre at 0, and no distortion."""
        numbers = situation.numbers.copy()
        numbers[self.places] = [1.0 if kind <= ONE_FOCAL else 0.0 for kind in self.kinds]
        return situation.with_numbers(numbers)

    def recognised(self, situation: Situation, lines: Lines, poses: tuple[int, ...]) -> tuple[int, ...] | None:
        """What each number is, by how images of points moved by ``poses`` depend on it; None if it is no such camera.

        Where all numbers are nothing, the image is so, too, wherever the point: a focal length moves it with the point,
        a coordinate of the centre alike, and distortion, which a focal length multiplies, not at all.
        """
        rows = [self._rows(self._with_poses(situation, poses, t), lines) for t in _PLACES]
        if not len(rows[0]):
            return None
        nothing = np.zeros(len(self.places))
        values, slopes = zip(*(each.linearised(nothing) for each in rows), strict=True)
        finite = all(bool(np.isfinite(each).all()) for each in (*values, *slopes))
        if not finite or not np.allclose(values[0], values[1], rtol=1e-9, atol=1e-9):
            return None
        kinds = [_kind(slopes[0][..., j], slopes[1][..., j]) for j in range(len(self.places))]
        linear = np.array([kind is not None and kind != DISTORTION for kind in kinds])
        shifted = rows[0].slopes(np.where(linear, np.arange(1.0, len(linear) + 1), 0.0))
        if not np.allclose(shifted[..., linear], slopes[0][..., linear], rtol=1e-9, atol=1e-12):
            return None
        found = tuple(kind for kind in kinds if kind is not None)
        focal = sorted(kind for kind in found if kind <= ONE_FOCAL)
        centre = sorted(kind for kind in found if kind in (3, 4))
        distorted = self.coordinates[[kind == DISTORTION for kind in kinds]]
        usable = len(found) == len(kinds) and not bool(situation.layout.positive[distorted].any())
        return found if usable and focal in ([ONE_FOCAL], [0, 1]) and centre in ([], [3, 4]) else None

    def _rows(self, situation: Situation, lines: Lines) -> Rows:
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

    @staticmethod
    def _with_poses(situation: Situation, poses: tuple[int, ...], shift: Floats) -> Situation:
        numbers = situation.numbers.copy()
        for k, number in enumerate(poses):
            entry = situation.layout.entries[number]
            motion = FRAME.numbers(np.ones(()), np.eye(3), (1.0 + 0.37 * k) * shift)
            numbers[entry.range] = np.tile(motion, entry.members)
        return situation.with_numbers(numbers)


_PLACES = (np.array([0.31, 0.47, 5.3]), np.array([5.2, -0.64, 6.9]))


def _kind(here: Floats, there: Floats) -> int | None:
    """What a number is, by the slopes (n, 2) of the image with points at two places."""
    axes = [bool(np.abs(here[:, i]).max() > 0) for i in range(2)]
    constant = bool(np.allclose(here, there))
    if constant and not any(axes):
        return DISTORTION
    if constant:
        alone = sum(axes) == 1 and np.allclose(np.abs(here[:, axes.index(True)]), 1.0)
        return 3 + axes.index(True) if alone else None
    return ONE_FOCAL if all(axes) else axes.index(True)


def cameras_of(candidate: Candidate) -> tuple[Indices, tuple[Camera, ...]]:
    """The columns of a candidate's numbers that are of no pose, and the cameras that these are of, each once.

    What fewer rows know of than a plane needs is no camera: not each point of a reconstruction is taken for one.
    """
    flat = [entry for entry in candidate.entries if not is_pose(entry)]
    columns = np.flatnonzero([any(_within(p, e.range) for e in flat) for p in candidate.places[0].tolist()])
    steps = np.flatnonzero([any(_within(c, e.coordinates) for e in flat) for c in candidate.coordinates[0].tolist()])
    places, first, which = np.unique(candidate.places[:, columns], axis=0, return_index=True, return_inverse=True)
    rows = np.zeros(len(places), dtype=np.int64)
    for _, _, member in candidate.lines:
        rows += np.bincount(which.ravel()[member], minlength=len(places))
    enough = rows >= LEAST_POINTS
    places, first = places[enough], first[enough]
    coordinates = candidate.coordinates[np.ix_(first, steps)]
    return columns, tuple(
        Camera(entries=tuple(flat), places=p, coordinates=c) for p, c in zip(places, coordinates, strict=True)
    )


def _within(number: int, span: slice) -> bool:
    return number in range(span.start, span.stop)


def camera_numbers(
    kinds: tuple[int, ...], lens: Lens, views: Sequence[tuple[Floats, Floats]]
) -> tuple[Floats, Floats] | None:
    """A camera's numbers (s,), focal lengths positive, from ``views``: points (n, 2) of a plane, and their images.

    And homographies (K, 3, 3) from the planes to the images of a pinhole camera with focal length 1 and centre 0, NaN
    where a view tells of none; None where none does.
    """
    images = np.concatenate([image for _, image in views])
    middle = (images.min(axis=0) + images.max(axis=0)) / 2 if 3 in kinds else np.zeros(2)
    extent = float(np.ptp(images, axis=0).max())
    scaled = [(plane, (image - middle) / extent) for plane, image in views]
    found = _of_pinhole(kinds, scaled) if lens is Lens.PINHOLE else _of_fisheye(scaled)
    if found is None:
        return None
    focal, centre = found[0] * extent, found[1] * extent + middle
    values = np.array([focal[0], focal[1], focal.mean(), centre[0], centre[1], 0.0])
    return values[list(kinds)], found[2]


def _of_pinhole(kinds: tuple[int, ...], views: Sequence[tuple[Floats, Floats]]) -> tuple[Floats, Floats, Floats] | None:
    """Focal lengths (2,), centre (2,) and homographies (K, 3, 3) of views whose images are of the size of one.

    Where few or noisy views give no camera that could see the images, it is the best of a table of cameras.
    """
    every = np.stack([homography(plane, image) for plane, image in views])
    known = every[np.isfinite(every).all(axis=(1, 2))]
    if not len(known):
        return None
    focal, centre = camera_from_planes(known, Knowledge(one_focal=ONE_FOCAL in kinds, centred=3 not in kinds))
    sees = bool((focal > WIDEST).all() and (focal < NARROWEST).all() and (np.abs(centre) < 1.0).all())
    if not sees:
        focal, centre = likeliest_camera(known, centred=3 not in kinds)
    every[:, :2] = (every[:, :2] - centre[:, None] * every[:, 2:]) / focal[:, None]
    return focal, centre, every


def _of_fisheye(views: Sequence[tuple[Floats, Floats]]) -> tuple[Floats, Floats, Floats] | None:
    """The same of a fisheye, with that focal length by which the planes suit their images best, and the centre at 0."""
    lengths = FISHEYES
    for finer in (True, False):
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
