"""Closed forms by linear least squares: of affine equations, and of squared distances from known places.

Unknowns in which all their equations are affine, given the others, follow at once. Distances may have an unknown scale,
an offset, or both, and the place of a radio may be unknown, too: with ``r = g |x − p| + o`` the square
``(r − o)² = g² |x − p|²`` is linear in g², g² p, o and g² |p|² − o².
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbm.equations.binding import affine
from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.rows import Rows, finite
from mbm.estimation.starts.closed_forms.types import AGREEMENT, Candidate, Plan, Situation
from mbm.values import dataclass

DETERMINED = 1e-12
"""Singular value of the scaled equations beside the largest, below which an unknown counts as not determined."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AffineRows:
    """Each row says ``matrix · x + offset = 0``: (n, s) and (n,), already divided by σ."""

    matrix: Floats
    offset: Floats


@dataclass(frozen=True, slots=True)
class Linear:
    """One step of least squares, where it determines everything."""

    name: str = "linear"
    joint: bool = False

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Rows that are affine in the candidate's numbers, and enough of them."""
        if not candidate.flat or not candidate.lines:
            return None
        wanted = np.zeros(len(situation.layout.number), dtype=bool)
        wanted[candidate.coordinates] = True
        if not all(affine(group, wanted) for group, _, _ in candidate.lines):
            return None
        rows = candidate.scalars()
        size = candidate.places.shape[1]
        if len(rows) < size:
            return None
        origin = np.zeros(size)
        values, slopes = rows.values(origin)[:, 0], rows.slopes(origin)[:, 0]
        usable = np.isfinite(values) & finite(slopes, 1)
        if int(usable.sum()) < size:
            return None
        root = np.sqrt(rows.weight[usable])
        data = AffineRows(matrix=slopes[usable] * root[:, None], offset=values[usable] * root)
        return Plan(form=self, candidate=candidate, rows=rows.picked(usable), minimal=size, data=data)

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """One solution for each subset; NaN where it does not determine all numbers."""
        rows: AffineRows = plan.data
        matrix, right = rows.matrix[subsets], -rows.offset[subsets]
        return least_squares(matrix, right)[:, None, :]


def least_squares(matrix: Floats, right: Floats) -> Floats:
    """x (T, s) with the least ``|A x − b|`` for each of T systems (T, n, s), (T, n); NaN where they leave some open."""
    scale = np.linalg.norm(matrix, axis=1)
    scale = np.where(scale > 0, scale, 1.0)
    U, values, Vt = np.linalg.svd(matrix / scale[:, None, :], full_matrices=False)
    determined = values[:, -1] > DETERMINED * values[:, 0]
    inverse = np.where(determined[:, None], 1.0 / np.where(determined[:, None], values, 1.0), np.nan)
    return np.asarray(np.einsum("tji,tj,tkj,tk->ti", Vt, inverse, U, right) / scale)


LINEAR = Linear()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Radios:
    """Rows that say ``length = scale · |place − p| + slope · offset``, arrays over n rows.

    ``point`` are the columns of p among the candidate's numbers, ``scale`` and ``offset`` those of the two, None where
    there is no offset. ``unit`` is the distance's factor at a scale of 1.
    """

    point: tuple[int, ...]
    scale: int
    offset: int | None
    places: Floats
    unit: Floats
    length: Floats
    slope: Floats


@dataclass(frozen=True, slots=True)
class ScaledRanges:
    """Linear least squares of squared lengths, each weighted as its length is."""

    name: str = "scaled-ranges"
    joint: bool = False

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Rows that are affine in a scale of a distance from two or three coordinates, and in an offset."""
        del situation
        size = candidate.places.shape[1]
        if not candidate.flat or not 3 <= size <= 5 or bool(candidate.angles.any()):
            return None
        rows = candidate.rows(1)
        if not len(rows):
            return None
        for point, scale, offset in _roles(size):
            found = _recognised(rows, size, point, scale, offset)
            if found is not None:
                return Plan(form=self, candidate=candidate, rows=rows, minimal=size + 1, data=found)
        return None

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """One solution for each subset; NaN where it does not determine all, or has no scale."""
        found: Radios = plan.data
        d, r = len(found.point), found.length[subsets] / found.unit[subsets]
        b, s = found.slope[subsets] / found.unit[subsets], found.places[subsets]
        weight = np.sqrt(plan.rows.weight[subsets]) / np.maximum(np.abs(r), np.abs(r).mean(axis=1, keepdims=True))
        middle = s.mean(axis=1, keepdims=True)  # moved there, so that places far away lose nothing
        s = s - middle
        columns = [np.square(s).sum(axis=2), *(-2.0 * s[..., i] for i in range(d)), np.ones_like(r)]
        if found.offset is not None:
            columns.append(2.0 * b * r)
        linear = least_squares(np.stack(columns, axis=2) * weight[..., None], np.square(r) * weight)
        square = np.where(linear[:, :1] > 0, linear[:, :1], np.nan)
        result = np.full((len(subsets), 1, d + 1 + (found.offset is not None)), np.nan)
        result[:, 0, list(found.point)] = linear[:, 1 : d + 1] / square + middle[:, 0]
        result[:, 0, found.scale] = np.sqrt(square[:, 0])
        if found.offset is not None:
            result[:, 0, found.offset] = linear[:, d + 2]
        return result


def _roles(size: int) -> Iterator[tuple[tuple[int, ...], int, int | None]]:
    """Which of the numbers may be coordinates, the scale, and the offset."""
    columns = range(size)
    for scale in columns:
        rest = tuple(c for c in columns if c != scale)
        if len(rest) <= 3:
            yield rest, scale, None
        for offset in rest if len(rest) >= 3 else ():
            yield tuple(c for c in rest if c != offset), scale, offset


def _recognised(rows: Rows, size: int, point: tuple[int, ...], scale: int, offset: int | None) -> Radios | None:
    """The rows as radios; probed again about the places if these turn out to be far from the origin."""
    found, middle, extent = None, np.zeros(len(point)), 1.0
    for _ in range(2):
        probes = np.zeros((len(point) + 4, size))
        spread = np.random.default_rng(0).uniform(-1.0, 1.0, size=(len(probes), len(point)))
        probes[:, list(point)] = middle + extent * spread
        probes[:, scale] = 1.0
        found = _probed(rows, probes, point, scale, offset)
        if found is None:
            return None
        middle = np.median(found.places, axis=0)
        extent = 1.0 + float(np.median(np.linalg.norm(found.places - middle, axis=1)))
    return found


def _probed(rows: Rows, probes: Floats, point: tuple[int, ...], scale: int, offset: int | None) -> Radios | None:
    """What rows are at probes with a scale of 1, and, to see that they are affine in scale and offset, at others."""
    count = len(probes)
    twice, aside = probes.copy(), probes.copy()
    twice[:, scale] = 3.0
    if offset is not None:
        aside[:, offset] = 0.7
    values, steep = rows.probed(np.vstack([probes, twice, aside]))
    values, steep = values[..., 0], steep[:, :, 0]
    if not bool(np.isfinite(values).all() and np.isfinite(steep).all()):
        return None
    first, second, third = np.split(values, 3, axis=1)
    distance = steep[:, :count, scale]
    size_of = np.abs(values).max(axis=1, keepdims=True)
    slope = steep[:, 0, offset] if offset is not None else np.zeros(len(rows))
    affine = np.abs(second - first - 2.0 * distance) <= AGREEMENT * size_of
    affine &= np.abs(third - first - (0.7 * slope[:, None] if offset is not None else 0.0)) <= AGREEMENT * size_of
    constant = first - distance
    affine &= np.abs(constant - constant[:, :1]) <= AGREEMENT * size_of
    if not bool(affine.all()) or not bool(distance.any()) or (offset is not None and not bool(slope.all())):
        return None
    stations = _stations(distance, steep[:, :count][..., list(point)], probes[:, list(point)])
    if stations is None:
        return None
    places, unit = stations
    return Radios(
        point=point, scale=scale, offset=offset, places=places, unit=unit, length=-constant.mean(axis=1), slope=slope
    )


def _stations(distance: Floats, slopes: Floats, probes: Floats) -> tuple[Floats, Floats] | None:
    """Places s (n, d) and factors k (n,) of which ``distance`` (n, K) at ``probes`` is k |probe − s|; None if of none.

    ``D ∇D = k² (p − s)`` is affine in p.
    """
    sides = distance[..., None] * slopes
    moves = probes[1:] - probes[:1]
    square = np.einsum("nkd,kd->n", sides[:, 1:] - sides[:, :1], moves) / np.square(moves).sum()
    if not bool((square > 0).all()):
        return None
    every = probes - sides / square[:, None, None]
    size = np.abs(probes).max() + np.abs(every).max(axis=(1, 2))
    places = every.mean(axis=1)
    if bool((np.abs(every - places[:, None]).max(axis=(1, 2)) > AGREEMENT * size).any()):
        return None
    k = np.sqrt(square) * np.sign(distance[:, 0])
    told = k[:, None] * np.linalg.norm(probes - places[:, None], axis=2)
    if not bool((np.abs(told - distance) <= AGREEMENT * np.abs(distance).max(axis=1, keepdims=True)).all()):
        return None
    return (places, k) if finite(places, 1).all() else None


SCALED_RANGES = ScaledRanges()
