"""Cameras whose numbers are unknown: what each number is, by how images depend on it where it is probed."""

from __future__ import annotations

import numpy as np

from mbm.equations.at_rows import looks_back, pinholes
from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.chains import FRAME, Lines, is_pose
from mbm.estimation.starts.closed_forms.numerics.planes import Knowledge, camera_from_planes, likeliest_camera
from mbm.estimation.starts.closed_forms.rows import Rows
from mbm.estimation.starts.closed_forms.situation import Candidate, Situation, Support
from mbm.expression.evaluate import evaluate
from mbm.expression.nodes import Component, Leaf, Number, Parameter, leaves
from mbm.expression.projection import by_axes
from mbm.values import dataclass

ONE_FOCAL, CENTRE, DISTORTION = 2, (3, 4), 5
"""Kinds of a camera's numbers: 0 and 1 are focal lengths of the axes, this is one for both; 3 and 4 the centre."""


def negative(situation: Situation, places: Indices, coordinates: Indices) -> bool:
    """Whether numbers at ``places`` (k,) are below zero: as they are known, as they are stated, or by their limits."""
    layout = situation.layout
    stated = np.where(layout.guessed[places], np.nan, layout.start[places])
    numbers = np.where(np.isnan(situation.numbers[places]), stated, situation.numbers[places])
    return bool(((numbers < 0) | (layout.upper[coordinates] <= 0)).all())


def outlook(situation: Situation, rows: Rows) -> Floats | None:
    """The way (3,) in which the pinhole cameras of rows look, in their frames; None where that is not known.

    Unknown focal lengths are taken to be positive where nothing says that they are negative.
    """

    def sign(leaf: Leaf) -> float:
        if not isinstance(leaf, Component):
            return 1.0
        entry = situation.layout.entry(leaf.unknown)
        if entry.unknown.freedom != entry.unknown.size:
            return 1.0
        own = np.arange(entry.members) * entry.unknown.size + entry.unknown.indices().index(leaf.index)
        return -1.0 if negative(situation, entry.offset + own, entry.first + own) else 1.0

    axes = tuple(Parameter(name) for name in "xyz")
    frame: dict[Leaf, Floats] = dict(zip(axes, np.eye(3), strict=True))
    ways = set()
    for camera in dict.fromkeys(each for piece in rows.pieces for each in pinholes(piece.group)):
        if not all(isinstance(leaf, Component | Number) for leaf in leaves(camera.focal)):
            return None
        ahead = -1.0 if bool(looks_back(*evaluate(camera.focal, sign))) else 1.0
        depth = evaluate(by_axes(axes, camera.axes)[2:], frame.__getitem__)[0]
        ways.add(tuple((ahead * np.asarray(depth)).tolist()))
    return np.array(ways.pop()) if len(ways) == 1 else None


LEAST_POINTS = 4
"""Points of a plane that tell its homography."""

WIDEST, NARROWEST = 0.05, 100.0
"""Focal lengths beside the extent of what is seen, beyond which they are noise."""


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
        return -1.0 if negative(situation, self.places[focal], self.coordinates[focal]) else 1.0

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


def camera_numbers(kinds: tuple[int, ...], homographies: Floats, images: Floats) -> tuple[Floats, Floats, Floats]:
    """A camera's numbers (s,), its focal lengths (2,) and centre (2,) from homographies (K, 3, 3), lengths positive.

    Where few or noisy views give no camera that could see the ``images`` (n, 2), it is the best of a table of cameras.
    """
    middle = (images.min(axis=0) + images.max(axis=0)) / 2 if 3 in kinds else np.zeros(2)
    extent = float(np.ptp(images, axis=0).max())
    shifted = homographies.copy()
    shifted[:, :2] -= middle[:, None] * homographies[:, 2:]
    shifted[:, :2] /= extent
    focal, centre = camera_from_planes(shifted, Knowledge(one_focal=ONE_FOCAL in kinds, centred=3 not in kinds))
    sees = bool((focal > WIDEST).all() and (focal < NARROWEST).all() and (np.abs(centre) < 1.0).all())
    if not sees:
        focal, centre = likeliest_camera(shifted, centred=3 not in kinds)
    focal, centre = focal * extent, centre * extent + middle
    values = np.array([focal[0], focal[1], focal.mean(), centre[0], centre[1], 0.0])
    return values[list(kinds)], focal, centre
