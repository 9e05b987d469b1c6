"""Boards with markers that have numbers: chessboards with markers in them, grids of markers. Parts of them are enough.
Dictionaries of markers that OpenCV knows, by its names, and what a board asks of them.

A marker is known by its pattern, of which no dictionary has the mirror image: a board that is seen from behind, or in
a mirrored image, shows none.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mbm.data.images import faults, opencv
from mbm.data.images.boards import Found, Plane, clear, crossed_patches, plane_of, refined
from mbm.data.images.faults import NoBoardError
from mbm.data.images.features import corner, crossing
from mbm.data.images.fitting import Floats, Grey, Patches
from mbm.data.images.opencv import Charuco
from mbm.problem.tables import Argument, ArgumentKind
from mbm.text.types import DataPlace, MbmError
from mbm.values import dataclass

DICTIONARIES = (
    *(f"DICT_{side}X{side}_{count}" for side in (4, 5, 6, 7) for count in (50, 100, 250, 1000)),
    *(f"DICT_APRILTAG_{code}" for code in ("16h5", "25h9", "36h10", "36h11")),
    "DICT_ARUCO_ORIGINAL",
    "DICT_ARUCO_MIP_36h12",
)


def dictionary_argument(usual: str) -> Argument:
    """``:dictionary NAME``."""
    return Argument(name="dictionary", kind=ArgumentKind.WORD, required=False, default=usual, choices=DICTIONARIES)


def check_markers(shown: str, dictionary: str, first: int, count: int) -> None:
    """``count`` markers from number ``first`` on are in a dictionary; ``shown`` is the pattern of the data clause.

    Raises:
        MbmError: bad-board, missing-extra.

    """
    place = DataPlace(file=shown)
    opencv.opencv(place)
    there = opencv.dictionary_size(dictionary)
    if first + count > there:
        reason = (
            f"it has the markers {first:,} to {first + count - 1:,}, `{dictionary}` has those from 0 to {there - 1:,}"
        )
        raise MbmError(faults.bad_board(place, reason))


FEWEST_MARKERS = 2
"""Of a grid: fewer do not tell how markers are turned on it."""

MISPLACED = 0.25
"""Part of a marker's side by which corners may be away from where the board has them: lenses bend it by less."""

SLIPPED, LEAST_SLIP = 3.0, 1.5
"""A corner is beside its place that is so many times the median farther from it, and so many px."""

CORNERS = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
"""The corners of a marker in the order of their numbers, in parts of its side."""

TWICE = "it shows a marker twice: there are two boards"
MIRRORED = "it is mirrored, or the board is seen from behind"
OTHERWISE = "its markers are not where the board has them: other numbers, or other sizes"


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerGrid:
    """Markers in rows: their side and the gap between them in one unit, the number of the first, in the first corner.

    ``upward``: the first marker is at the lower left, and the rows follow one another upward; else at the upper left
    and downward. ``joined``: small black squares touch the corners of the markers.
    """

    columns: int
    rows: int
    side: float
    gap: float
    dictionary: str
    first: int
    border: int
    upward: bool
    joined: bool

    @property
    def count(self) -> int:
        """How many markers there are."""
        return self.columns * self.rows

    def places(self) -> Floats:
        """The corners (4·count, 2) of all markers: the two on x of each first, then the other two, in this order."""
        row, column = np.divmod(np.arange(self.count), self.columns)
        origins = np.column_stack([column, row]) * (self.side + self.gap)
        return (origins[:, None] + CORNERS * self.side).reshape(-1, 2)

    def room(self) -> float:
        """How far from a corner nothing but its edges is, on the board: the gap, or the pattern inside the border."""
        square = self.side / (opencv.dictionary_side(self.dictionary) + 2 * self.border)
        return min(self.gap, float(np.sqrt(2)) * self.border * square)


def chessboard_with_markers(image: Grey, board: Charuco) -> Found:
    """The inner corners that are seen.

    Raises:
        NoBoardError

    """
    levels = opencv.pyramid(image)
    numbers, points, seen = opencv.charuco(levels[-1], board)
    _refuse_doubles(seen)
    places = np.column_stack(np.divmod(numbers, board.columns - 1)[::-1]).astype(np.float64) + 1
    if plane_of(places, points) is None:
        _, _, flipped = opencv.charuco(np.ascontiguousarray(levels[-1][:, ::-1]), board)
        raise NoBoardError(MIRRORED if len(flipped) > max(len(seen), FEWEST_MARKERS) else None)
    room = (1 - board.marker) / np.sqrt(2)  # to the corners of the nearest markers
    prepared = _prepared(places, min(float(room), 1.0))
    return Found(numbers=numbers + 1, fitted=refined(levels, points, prepared, crossing))


def grid_of_markers(image: Grey, board: MarkerGrid) -> Found:
    """The corners of the markers that are seen, numbered as `MarkerGrid.places` has them.

    Raises:
        NoBoardError

    """
    levels = opencv.pyramid(image)
    seen, found = _of_board(levels[-1], board)
    _refuse_doubles(seen)
    if len(seen) < FEWEST_MARKERS:
        mirrored, _ = _of_board(np.ascontiguousarray(levels[-1][:, ::-1]), board)
        raise NoBoardError(MIRRORED if len(mirrored) > max(len(seen), FEWEST_MARKERS) else None)
    numbers = (4 * (seen[:, None] - board.first) + np.arange(4)).ravel()
    places = board.places()[numbers]
    points = _turned(places, found, board)
    if board.joined:
        fitted = refined(levels, points, _prepared(places, board.room()), crossing)
    else:
        inward = np.tile(1.0 - 2 * CORNERS, (len(seen), 1))
        fitted = refined(levels, points, _prepared(places, board.room(), inward), corner)
    return Found(numbers=numbers + 1, fitted=fitted)


def _of_board(image: Grey, board: MarkerGrid) -> tuple[NDArray[np.int64], Floats]:
    """The markers of the board that an image shows, by their numbers."""
    numbers, found = opencv.markers(image, board.dictionary, board.border)
    own = (numbers >= board.first) & (numbers < board.first + board.count)
    order = np.argsort(numbers[own], kind="stable")
    return numbers[own][order], found[own][order]


def _refuse_doubles(numbers: NDArray[np.int64]) -> None:
    if len(np.unique(numbers)) < len(numbers):
        raise NoBoardError(TWICE)


def _turned(places: Floats, found: Floats, board: MarkerGrid) -> Floats:
    """The corners (4·n, 2) in the order of their places: dictionaries differ in which corner of a marker is the first.

    Detectors give them clockwise. Of the four orders the one that fits a homography best is taken, for all markers.
    """
    clockwise = [2, 3, 1, 0] if board.upward else [0, 1, 3, 2]
    best = None
    for turn in range(4):
        points = np.empty_like(found)
        points[:, clockwise] = np.roll(found, turn, axis=1)
        plane = plane_of(places, points.reshape(-1, 2))
        misfit = np.inf if plane is None else plane.misfit(places, points.reshape(-1, 2))
        if best is None or misfit < best[0]:
            best = misfit, points.reshape(-1, 2)
    side = np.linalg.norm(found - np.roll(found, 1, axis=1), axis=2).mean()
    if best is None or best[0] > MISPLACED * side:
        raise NoBoardError(OTHERWISE)
    return _without_slips(places, best[1])


def _without_slips(places: Floats, points: Floats) -> Floats:
    """The corners, those far from where a homography has them put there: the detector slips along black squares."""
    plane = plane_of(places, points)
    if plane is None:
        return points
    there = plane.points(places)
    away = np.linalg.norm(points - there, axis=1)
    far = away > max(SLIPPED * float(np.median(away)), LEAST_SLIP)
    return np.where(far[:, None], there, points)


def _prepared(places: Floats, room: float, inward: Floats | None = None) -> Callable[[Floats], Patches]:
    """Patches about points at places (n, 2), with the directions of the board's edges there.

    ``inward`` (n, 2) are signs: the axes with these signs lead from corners of squares along their edges.
    """

    def prepared(points: Floats) -> Patches:
        plane = plane_of(places, points) or Plane(matrix=np.eye(3))
        along, down = plane.steps(places)
        free = clear(along, down) * room
        if inward is not None:
            along, down = _clockwise(along * inward[:, :1], down * inward[:, 1:])
        return crossed_patches(points, along, down, free)

    return prepared


def _clockwise(along: Floats, down: Floats) -> tuple[Floats, Floats]:
    """Directions of two edges that leave corners in directions (n, 2), such that squares lie clockwise of both."""
    turns = along[:, :1] * down[:, 1:] > along[:, 1:] * down[:, :1]
    return np.where(turns, along, down), -np.where(turns, down, along)
