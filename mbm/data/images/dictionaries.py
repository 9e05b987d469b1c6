"""Dictionaries of markers that OpenCV knows, by its names, and what a board asks of them."""

from __future__ import annotations

from mbm.data.images import faults, opencv
from mbm.problem.tables import Argument, ArgumentKind
from mbm.text.types import DataPlace, MbmError

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
