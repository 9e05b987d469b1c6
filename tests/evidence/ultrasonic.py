"""The room of Nishida's first paper: 48 receivers in the ceiling, a tag at five places, thirty times each.

The ranges (10 mm of noise) are those of problems/tags. Which echo is half a metre long was drawn once, and is stated
here; the mean errors of least squares, least absolute deviations and least median of squares with one such echo were
computed apart from mbm, in NumPy and SciPy.
"""

from __future__ import annotations

import json

import numpy as np
from numpy.typing import NDArray

from tests.evidence.material import PROBLEMS, read_numbers

PLACES = np.array([[1.75, 1.75, 0.8], [1.2, 1.2, 0.8], [2.3, 2.2, 0.8], [1.75, 2.4, 1.2], [1.1, 1.9, 0.4]])
"""Where the tag was, in m."""
EPOCHS = 30
SUBSETS = {
    6: (0, 3, 7, 40, 43, 47),
    9: (0, 3, 7, 24, 27, 31, 40, 43, 47),
    24: tuple(8 * row + k for row in (0, 2, 4) for k in range(8)),
    48: tuple(range(48)),
}
"""Receivers of smaller rooms, by their number."""
MEAN_ERRORS = {6: 0.12796008379813054, 9: 0.02439714170999014, 24: 0.012702031536482448, 48: 0.008477585286684504}
"""In m, of least median of squares and a fit of the rows that it keeps, with one echo of +0.5 m in each epoch."""
LONG = {
    number: np.array([int(word) for word in text.split()]).reshape(len(PLACES), EPOCHS)
    for number, text in {
        6: (
            "43 40 43 47 47 7 47 47 40 43 0 47 47 7 47 43 43 7 43 40 47 43 40 7 3 7 0 3 3 40 40 3 7 47 0 47 47 3 7 0 7 "
            "0 43 43 7 7 0 47 47 3 0 43 3 47 47 40 40 3 43 0 43 43 3 40 43 47 47 40 0 43 7 47 40 40 47 0 0 40 7 40 40 "
            "7 43 3 0 3 7 7 47 7 43 43 0 0 47 0 3 40 3 47 0 7 47 3 0 40 0 40 3 0 3 47 0 3 43 47 7 47 47 0 47 0 0 3 7 "
            "43 7 3 7 40 0 7 0 7 47 7 43 7 0 3 40 0 7 40 43 40 7 3 3 3 "
        ),
        9: (
            "0 47 0 24 27 40 24 7 43 40 0 0 47 3 24 27 31 27 0 0 47 47 7 27 24 24 43 0 47 31 47 43 31 31 7 0 7 0 24 7 "
            "40 3 31 24 7 43 31 47 27 47 3 47 3 3 0 43 24 7 7 24 3 31 31 0 27 0 24 27 27 40 7 47 3 27 0 27 24 0 0 7 7 "
            "7 40 27 47 3 0 43 47 31 0 27 3 43 3 7 3 3 40 43 3 43 43 40 24 43 0 0 7 43 3 47 43 40 3 27 31 3 0 3 43 27 "
            "47 27 0 3 40 43 27 0 3 24 40 3 27 7 31 47 0 40 43 43 27 43 40 24 43 47 0 7 "
        ),
        24: (
            "16 39 32 37 32 4 21 3 36 22 17 7 18 5 36 3 22 4 37 7 1 0 39 20 20 0 18 19 21 38 0 35 0 16 38 4 35 22 17 "
            "34 16 33 18 37 3 17 34 22 18 21 38 22 38 36 38 0 7 36 34 21 35 5 5 22 18 18 23 36 35 6 5 0 35 35 32 3 3 3 "
            "6 0 3 23 7 3 21 22 32 34 33 1 6 39 4 33 5 35 0 39 20 6 3 37 5 20 0 38 7 18 37 18 37 0 35 22 23 36 36 7 16 "
            "32 0 2 3 5 5 2 22 37 2 21 3 1 32 0 38 3 3 2 0 34 23 39 5 4 19 39 18 1 23 32 "
        ),
        48: (
            "34 9 17 4 20 17 30 41 21 14 43 30 12 42 26 39 22 9 44 3 29 5 2 6 37 37 46 0 31 13 19 32 18 41 11 31 12 22 "
            "40 25 27 10 7 35 13 42 12 43 5 24 24 30 32 12 0 6 12 47 14 13 15 7 15 6 47 10 24 35 3 46 22 2 12 15 28 28 "
            "14 6 20 19 40 46 41 5 35 1 11 33 15 3 23 21 34 16 12 23 31 43 5 20 10 20 18 40 15 32 32 4 16 25 7 27 36 "
            "47 22 40 24 14 21 22 44 43 0 9 30 27 25 22 27 15 41 32 26 16 21 21 15 41 17 5 12 14 38 18 40 36 12 4 0 37 "
        ),
    }.items()
}
"""The receiver whose echo is long, by number of receivers, at a place (row) in an epoch (column)."""


def receivers() -> dict[str, NDArray[np.float64]]:
    """Columns ``id x y z``, in m."""
    return read_numbers(PROBLEMS / "tags" / "receivers.csv")


def ranges() -> dict[str, NDArray[np.float64]]:
    """Columns ``position epoch receiver range``, 7,200 rows without gross errors."""
    return read_numbers(PROBLEMS / "tags" / "ranges.csv")


def best_places() -> NDArray[np.float64]:
    """Least squares over all receivers, (150, 3): computed by SciPy, good to 1e-8 m."""
    solves = json.loads((PROBLEMS / "tags" / "expected.json").read_text(encoding="utf-8"))["tags"]["solves"]
    return np.array([solve["estimates"]["p"]["value"] for solve in solves])
