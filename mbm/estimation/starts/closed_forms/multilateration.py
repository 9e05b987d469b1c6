"""Distances to known stations: where one is, with or without a common offset; circles and spheres are the same case."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.starts.closed_forms.rows import Rows
from mbm.estimation.starts.closed_forms.types import AGREEMENT, Candidate, Plan, Situation
from mbm.machine.records import put
from mbm.solver.workspace import MOST_PLACES, SCRATCH, Ranges
from mbm.values import dataclass

DROWNING = 1e8
"""Value of a row beside what it changes from probe to probe, from which on half of its digits and more say nothing."""

NEAR = 30.0
"""Extent of a scene about the origin in which probes within one unit of it lose no more than two digits."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spheres:
    """Rows that say ``√(|p − station|² + extra) = length + slope · offset``, arrays over n rows.

    ``point`` are the columns of p among the candidate's numbers, ``offset`` that of the offset, None without one. The
    offset's sign is open where the rows hold its square only (``even``); it is taken positive. ``precision`` is one
    over the variance of a row; of rows whose length drowns the stations' coordinates nothing is known, and it is 0.
    Squares that are measured have a length of 0, so that all that is known is affine in them.
    """

    point: tuple[int, ...]
    offset: int | None
    stations: Floats
    extra: Floats
    length: Floats
    slope: Floats
    precision: Floats
    even: bool = False

    @property
    def told(self) -> Floats:
        """Station, length, extra and slope of each row (n, d + 3), as `mbm.solver.spheres.Ranges` has them."""
        return np.column_stack([self.stations, self.length, self.extra, self.slope])


@dataclass(frozen=True, slots=True)
class Multilateration:
    """Linear differences of squared distances (Nishida et al., eqs 6–11), stations in a plane included."""

    name: str = "multilateration"
    joint: bool = False

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Rows whose square, some constant added, is a parabola ``k² |p − s|²`` in two or three coordinates."""
        del situation
        size = candidate.places.shape[1]
        if not candidate.flat or not 2 <= size <= 4 or bool(candidate.angles.any()):
            return None
        rows = candidate.rows(1)
        if not len(rows):
            return None
        columns = tuple(range(size))
        found = _spheres(rows, columns, None) if size <= 3 else None
        for offset in columns if found is None and size >= 3 else ():
            found = _spheres(rows, tuple(c for c in columns if c != offset), offset)
            if found is not None:
                break
        if found is None:
            return None
        minimal = len(found.point) + (found.offset is not None)
        return Plan(form=self, candidate=candidate, rows=rows, minimal=minimal, data=found)

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """Up to three positions: by differences alone, and both sides of a plane that holds nearly all stations."""
        found: Spheres = plan.data
        d, offset = len(found.point), found.offset is not None
        told, weights = np.ascontiguousarray(found.told[subsets]), np.sqrt(found.precision[subsets])
        sets, rows = subsets.shape
        code = plan.rows.code
        code.expect(float(sets * rows * (d + 2) ** 2))
        ranges, scratch, counts = code.blank(Ranges), np.empty(SCRATCH), np.zeros(sets, dtype=np.int64)
        put(ranges, Ranges, d=d, offset=int(offset), even=int(found.even), rows=rows)
        put(ranges, Ranges, spheres=told, weights=weights, scratch=scratch)
        places = np.empty((sets, MOST_PLACES, d + offset))
        code.routine("places_of_many", object, int, object, object)(ranges, sets, places, counts)
        most = max(int(counts.max(initial=0)), 1)
        result = np.full((sets, most, d + offset), np.nan)
        there = np.arange(most) < counts[:, None]
        columns = [*found.point, *([] if found.offset is None else [found.offset])]
        result[..., columns] = np.where(there[..., None], places[:, :most], np.nan)
        return result


def _spheres(rows: Rows, point: tuple[int, ...], offset: int | None) -> Spheres | None:
    """What the rows are as spheres; probed again about the stations if they turn out to be far from the origin."""
    generator = np.random.default_rng(0)
    middle, size = np.zeros(len(point)), 1.0
    found = None
    for _ in range(2):
        probes = middle + size * generator.uniform(-1.0, 1.0, size=(len(point) + 3, len(point)))
        found = _fitted(rows, point, offset, probes)
        if found is None:
            return None
        # What is typical: of a length that is grossly wrong the probes leave rounding, and no station that means
        # anything; probes as far away as that would drown the other rows.
        middle = np.median(found.stations, axis=0)
        size = 1.0 + float(np.median(np.linalg.norm(found.stations - middle, axis=1) + np.abs(found.length)))
        if size + float(np.abs(middle).max()) < NEAR:
            break
    return found


def _fitted(rows: Rows, point: tuple[int, ...], offset: int | None, probes: Floats) -> Spheres | None:
    """Distances, or their squares."""
    found = _distances(rows, point, offset, probes)
    return found if found is not None else _squares(rows, point, offset, probes)


def _squares(rows: Rows, point: tuple[int, ...], offset: int | None, probes: Floats) -> Spheres | None:
    """Rows ``k (|p − s|² − l²)``, or ``k (|p − s|² − b²)`` with the offset b: the slopes are ``2 k (p − s)``."""
    count, d = probes.shape
    numbers = np.zeros((count, d + (offset is not None)))
    numbers[:, list(point)] = probes
    probed, steep = rows.probed(numbers)
    values, slopes = probed[..., 0], steep[:, :, 0, list(point)]
    if not bool(np.isfinite(slopes).all() and np.isfinite(values).all()):
        return None
    moves = probes[1:] - probes[:1]
    changes = slopes[:, 1:] - slopes[:, :1]
    k = np.einsum("nkd,kd->n", changes, moves) / (2 * np.square(moves).sum())
    if bool((k == 0).any()):
        return None
    stations = probes - slopes / (2 * k[:, None, None])
    size = np.abs(probes).max() + np.abs(stations).max(axis=(1, 2))
    if bool((np.abs(stations - stations[:, :1]).max(axis=(1, 2)) > AGREEMENT * size).any()):
        return None
    stations = stations.mean(axis=1)
    squares = (np.square(probes - stations[:, None, :]).sum(axis=-1) - values / k[:, None]).mean(axis=1)
    slope = np.zeros(len(rows))
    if offset is not None:
        changes = np.stack(
            [rows.values(numbers[0] + b * np.eye(d + 1)[offset])[:, 0] for b in (1.0, 2.0, -1.0)], axis=1
        )
        changes = (changes - values[:, :1]) / -k[:, None]
        if not np.allclose(changes, changes[:1, :1] * np.array([1.0, 4.0, 1.0]), rtol=1e-9) or changes[0, 0] <= 0:
            return None
        if bool((np.abs(squares) > AGREEMENT * size**2).any()):
            return None
        slope = np.sqrt(changes[:, 0])
    return Spheres(
        point=point,
        offset=offset,
        stations=stations,
        extra=-squares if offset is None else np.zeros(len(rows)),
        length=np.zeros(len(rows)),
        slope=slope,
        precision=rows.weight * k**2,
        even=offset is not None,
    )


def _distances(rows: Rows, point: tuple[int, ...], offset: int | None, probes: Floats) -> Spheres | None:
    """``(h + m) ∇h = k² (p − s)`` is linear in m, k² and k²s: solved from all probes but one, which checks."""
    count, d = probes.shape
    numbers = np.zeros((count, d + (offset is not None)))
    numbers[:, list(point)] = probes
    probed, steep = rows.probed(numbers)
    values, every = probed[..., 0], steep[:, :, 0]
    slopes = every[..., list(point)]
    if not bool(np.isfinite(every).all() and np.isfinite(values).all()):
        return None
    beta = np.zeros(len(rows))
    if offset is not None:
        beta = every[:, 0, offset]
        if not _one_constant(every[..., offset]):
            return None
    heard = ~(np.abs(values).max(axis=1) > DROWNING * np.ptp(values, axis=1))
    if not bool(heard.all()) and 2 * int(heard.sum()) > len(rows):
        found = _distances(rows.picked(heard), point, offset, probes)
        return None if found is None else _among(found, heard)
    used = slice(0, count - 1)
    solution = _constants(values[:, used], slopes[:, used], probes[used])
    if solution is None:
        return None
    shift, square, stations = solution
    sides = np.sign(values + shift[:, None])
    distance = np.square(probes - stations[:, None, :]).sum(axis=-1)
    extra = ((values + shift[:, None]) ** 2 / square[:, None] - distance)[:, used].mean(axis=1)
    predicted = sides[:, :1] * np.sqrt(np.maximum(square[:, None] * (distance + extra[:, None]), 0.0)) - shift[:, None]
    close = np.abs(predicted - values) <= AGREEMENT * (np.abs(values).max(axis=1) + np.abs(shift))[:, None]
    if not bool(close.all()) or bool((sides != sides[:, :1]).any()):
        return None
    k = sides[:, 0] * np.sqrt(square)
    length, slope = shift / k, -beta / k
    if offset is not None and not np.allclose(slope, slope[0], rtol=1e-6):
        return None
    extra = np.where(np.abs(extra) <= AGREEMENT * distance.max(axis=1), 0.0, extra)
    return Spheres(
        point=point,
        offset=offset,
        stations=stations,
        extra=extra,
        length=length,
        slope=slope,
        precision=rows.weight * square,
    )


def _among(found: Spheres, heard: Mask) -> Spheres:
    """The same for all rows (n,), those that are not ``heard`` with a precision of 0, at a place among the others."""
    places = np.where(heard, np.cumsum(heard) - 1, 0)
    return replace(
        found,
        stations=np.where(heard[:, None], found.stations[places], np.median(found.stations, axis=0)),
        extra=np.where(heard, found.extra[places], 0.0),
        length=np.where(heard, found.length[places], 0.0),
        slope=found.slope[places],
        precision=np.where(heard, found.precision[places], 0.0),
    )


def _one_constant(slopes: Floats) -> bool:
    """Whether a coordinate enters all rows at all probes (n, K) with one slope up to its sign, not zero."""
    magnitude = np.abs(slopes)
    return bool(slopes.any()) and bool(np.allclose(slopes, slopes[:, :1], rtol=1e-9)) and bool((magnitude > 0).all())


def _constants(values: Floats, slopes: Floats, probes: Floats) -> tuple[Floats, Floats, Floats] | None:
    """m, k² (n,) and stations (n, d) from values (n, K), slopes (n, K, d) at probes (K, d); None if they do not fit."""
    n, count, d = slopes.shape
    matrix = np.empty((n, count, d, d + 2))
    matrix[..., 0] = -slopes
    matrix[..., 1] = probes
    matrix[..., 2:] = -np.eye(d)
    right = values[..., None] * slopes
    matrix, right = matrix.reshape(n, count * d, d + 2), right.reshape(n, count * d)
    scale = np.linalg.norm(matrix, axis=1)
    if bool((scale == 0).any()):
        return None
    Q, R = np.linalg.qr(matrix / scale[:, None, :])
    if bool((np.abs(np.diagonal(R, axis1=1, axis2=2)).min(axis=1) < 1e-13).any()):
        return None
    solution = np.linalg.solve(R, np.einsum("nij,ni->nj", Q, right)[..., None])[..., 0] / scale
    misfit = np.abs(np.einsum("nij,nj->ni", matrix, solution) - right).max(axis=1)
    fits = misfit <= AGREEMENT * np.abs(right).max(axis=1)
    square = solution[:, 1]
    if not bool((fits & (square > 0)).all()):
        return None
    return solution[:, 0], square, solution[:, 2:] / square[:, None]


MULTILATERATION = Multilateration()
