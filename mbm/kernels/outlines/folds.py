"""Where the image of a surface folds back: D(s, t) = 0 in the unit square, as polylines with exact points.

The square is a grid of `CELLS` × `CELLS`; where D changes its sign along an edge of the grid, the zero is found by
Newton's method within its bracket, and zeros are joined through the cells (marching squares, Lorensen and Cline 1987).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mbm.kernels.types import Floats
from mbm.values import dataclass

CELLS = 32
"""Of a fold that lies within one cell nothing is seen."""

_STEPS = 60

_SETTLED = 1e-9
"""Share of an edge of the grid: a step of Newton's method as short leaves a rounding."""

Indices = NDArray[np.int64]

Fold = Callable[[Floats], tuple[Floats, Floats]]
"""D (points,) and its gradient (points, 2) at parameters (points, 2)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Folds:
    """Polylines (points, 2) in (s, t), D > 0 on their left; and the zeros on the sides 0…3, as fractions along each."""

    lines: tuple[Floats, ...]
    zeros: tuple[Floats, Floats, Floats, Floats]


def folds_of(fold: Fold, at: tuple[Floats, Floats], values: Floats) -> Folds:
    """The folds of a surface whose D has ``values`` (CELLS + 1, CELLS + 1) on the grid of coordinates ``at``."""
    s, t = at
    positive = values >= 0
    if positive.all() or not positive.any():
        return Folds(lines=(), zeros=(np.zeros(0),) * 4)
    across = np.argwhere(positive[1:, :] != positive[:-1, :])  # edges along s
    along = np.argwhere(positive[:, 1:] != positive[:, :-1])  # edges along t
    both = np.concatenate([across, along])
    after = both + np.repeat([[1, 0], [0, 1]], [len(across), len(along)], axis=0)
    starts, ends = (np.stack([s[i], t[j]], axis=1) for i, j in (both.T, after.T))
    rising = positive[tuple(after.T)]
    found, slopes = _zeros(fold, starts, ends, rising)
    on_s, on_t = np.full((CELLS, CELLS + 1), -1), np.full((CELLS + 1, CELLS), -1)
    on_s[tuple(across.T)] = np.arange(len(across))
    on_t[tuple(along.T)] = len(across) + np.arange(len(along))
    chains = _chains(_neighbours(on_s, on_t, positive, len(both)))
    lines = tuple(_apart(_directed(found[chain], slopes[chain])) for chain in chains)
    sides = (each[each >= 0] for each in (on_s[:, 0], on_t[CELLS], on_s[:, CELLS], on_t[0]))
    bottom, right, top, left = (found[each] for each in sides)
    return Folds(lines=lines, zeros=(bottom[:, 0], right[:, 1], 1 - top[:, 0], 1 - left[:, 1]))


def _zeros(fold: Fold, starts: Floats, ends: Floats, rising: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Between each start and end, where D has opposite signs: the points of a zero, and the gradients there."""
    low, high = np.zeros(len(starts)), np.ones(len(starts))
    share = np.full(len(starts), 0.5)
    way = ends - starts
    for _ in range(_STEPS):
        values, slopes = fold(starts + share[:, None] * way)
        above = (values >= 0) == rising
        high, low = np.where(above, share, high), np.where(above, low, share)
        with np.errstate(all="ignore"):
            step = -values / np.einsum("ij,ij->i", slopes, way)
        inside = (share + step > low) & (share + step < high)
        moved = np.where(inside, share + step, (low + high) / 2)
        moved = np.where(values == 0, share, moved)
        done = (np.abs(moved - share) <= _SETTLED) & (
            inside | (values == 0)
        )  # what is left is of the order of its square
        share = moved
        if done.all() or (high - low).max() <= 4e-16:
            break
    points = starts + share[:, None] * way
    return points, fold(points)[1]


def _neighbours(on_s: Indices, on_t: Indices, positive: NDArray[np.bool_], count: int) -> list[list[int]]:
    """The zeros that are joined to each one through a cell; ``on_s``, ``on_t``: the zero on each edge, or −1."""
    edges = np.stack([on_s[:, :-1], on_t[1:], on_s[:, 1:], on_t[:-1]], axis=2)
    met = edges[(edges >= 0).any(axis=2)]
    two = (met >= 0).sum(axis=1) == 2
    pairs = met[two][met[two] >= 0].reshape(-1, 2).tolist()
    # where both diagonals differ, the corner at (i, j) is cut off if it is negative: the positive ones are joined
    for four, joined in zip(met[~two].tolist(), positive[:-1, :-1][(edges >= 0).all(axis=2)].tolist(), strict=True):
        a, b, c, d = four
        pairs += [(a, b), (c, d)] if joined else [(a, d), (b, c)]
    found: list[list[int]] = [[] for _ in range(count)]
    for a, b in pairs:
        found[a].append(b)
        found[b].append(a)
    return found


def _chains(joined: list[list[int]]) -> list[list[int]]:
    """Open chains from end to end, then closed ones, whose first point comes again."""
    left = [True] * len(joined)
    chains = []
    for start in (*(k for k, near in enumerate(joined) if len(near) == 1), *range(len(joined))):
        if not left[start]:
            continue
        chain, here = [start], start
        left[start] = False
        while here >= 0:
            here = next((k for k in joined[here] if left[k]), -1)
            if here >= 0:
                chain.append(here)
                left[here] = False
        if len(chain) > 2 and start in joined[chain[-1]]:
            chain.append(start)
        if len(chain) > 1:
            chains.append(chain)
    return chains


def _directed(points: Floats, slopes: Floats) -> Floats:
    """The polyline with D > 0 on its left."""
    ways = np.diff(points, axis=0)
    left = np.stack([-ways[:, 1], ways[:, 0]], axis=1)
    return points if np.sum(left * (slopes[:-1] + slopes[1:])) >= 0 else points[::-1]


def _apart(points: Floats) -> Floats:
    """The polyline without points that repeat the one before, as where D = 0 at a node of the grid; its ends stay."""
    kept = np.append(True, np.abs(np.diff(points, axis=0)).max(axis=1) > _SETTLED / CELLS)
    if not kept[1:].any():
        return np.asarray(points[[0, -1]])
    kept[np.flatnonzero(kept)[-1]] &= kept[-1]
    kept[-1] = True
    return np.asarray(points[kept])
