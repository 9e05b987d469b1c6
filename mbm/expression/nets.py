"""Meshes in figures: their points and faces as columns, however many there are."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING

from mbm.values import dataclass

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Net:
    """``points`` (n, 3) in m, and flat faces over them; ``key`` is what equal nets share and no others.

    ``edges`` (m, 2) are positions of points, the lower one first. Around the faces, counter-clockwise seen from
    outside, run ``sides`` (k,): numbers of edges, and whether they go ``along`` these; those of face i begin at
    ``first[i]``.
    """

    key: str
    points: NDArray[np.float64] = field(repr=False, compare=False)
    edges: NDArray[np.int64] = field(repr=False, compare=False)
    sides: NDArray[np.int64] = field(repr=False, compare=False)
    along: NDArray[np.bool_] = field(repr=False, compare=False)
    first: NDArray[np.int64] = field(repr=False, compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenNet:
    """A net in a figure: numbers of sheets, with the places of what these take behind coordinates of the net's points.

    ``point`` has no parameters and takes one point. ``line`` takes both ends of an edge: images and depths if it is
    straight, else the points.
    """

    net: Net
    point: int
    of_point: tuple[int, ...]
    line: int
    of_line: tuple[int, ...]
