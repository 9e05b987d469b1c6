"""Planes and lines through points: a unit normal, as a direction, a scaled vector or an angle, and an offset."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.rows import Rows
from mbm.estimation.starts.closed_forms.types import Candidate, Plan, Situation
from mbm.problem.manifold import Piece
from mbm.values import dataclass

AGREEMENT = 1e-9
"""How well an equation must agree with what it was recognised as, beside its size."""

DETERMINED = 1e-9
"""Extent of the points in the plane, across their largest, below which they leave its normal open."""

NUMBERS = 4
"""A normal in space and an offset: more numbers say no plane."""

CHECKS = 4
"""Random normals at which the equations are checked."""


class Written(Enum):
    """How the numbers of an unknown say a unit normal."""

    DIRECTION = "a direction"
    VECTOR = "a vector whose length does not matter"
    ANGLE = "the angle of a normal in the plane"


@dataclass(frozen=True, slots=True, kw_only=True)
class Chart:
    """Which of the candidate's numbers (s,) say the normal, and which the offset; None: the plane holds the origin."""

    written: Written
    normal: tuple[int, ...]
    offset: int | None

    @property
    def dimension(self) -> int:
        """Components of the normal."""
        return 2 if self.written is Written.ANGLE else len(self.normal)

    def numbers(self, normals: Floats, offsets: Floats) -> Floats:
        """Normals (…, d) of length 1 and offsets (…,) as numbers (…, s)."""
        result = np.empty((*normals.shape[:-1], len(self.normal) + (self.offset is not None)))
        if self.written is Written.ANGLE:
            result[..., self.normal[0]] = np.arctan2(normals[..., 1], normals[..., 0])
        else:
            result[..., list(self.normal)] = normals
        if self.offset is not None:
            result[..., self.offset] = offsets
        return result


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Incidences:
    """Rows that say ``point · normal + offset = 0``: points (n, d), weights (n,); ``both``: either sign of the normal.

    Bounds may exclude one of the two ways in which a plane is written.
    """

    chart: Chart
    points: Floats
    weight: Floats
    both: bool


@dataclass(frozen=True, slots=True)
class Planes:
    """The least singular vector of the points about their weighted mean (Pearson 1901)."""

    name: str = "plane"
    joint: bool = False

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Rows that are linear in the components of a unit normal and in an offset, if there is one, and in no more."""
        charts = tuple(_charts(candidate))
        rows = candidate.rows(1) if charts else None
        if rows is None or not len(rows):
            return None
        layout = situation.layout
        ranges = np.stack([layout.lower[candidate.coordinates], layout.upper[candidate.coordinates]])
        for chart in charts:
            found = _incidences(rows, chart, both=bool(np.isfinite(ranges).any()))
            if found is not None:
                minimal = chart.dimension - (chart.offset is None)
                return Plan(form=self, candidate=candidate, rows=rows, minimal=minimal, data=found)
        return None

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """One plane for each subset, its offset not negative; where the unknowns are bounded the other sign as well."""
        found: Incidences = plan.data
        points, weight = found.points[subsets], found.weight[subsets]
        middle = np.zeros((len(subsets), points.shape[2]))
        if found.chart.offset is not None:
            middle = np.einsum("tk,tkd->td", weight, points) / weight.sum(axis=1)[:, None]
        scatter = (points - middle[:, None]) * np.sqrt(weight)[..., None]
        # Zero rows change no singular vector, and let a subset of d - 1 rows have d of them.
        padded = np.concatenate([scatter, np.zeros_like(scatter[:, :1])], axis=1)
        _, values, axes = np.linalg.svd(padded, full_matrices=False)
        normal = axes[:, -1]
        offset = -np.einsum("td,td->t", normal, middle)
        largest = np.take_along_axis(normal, np.abs(normal).argmax(axis=1)[:, None], axis=1)[:, 0]
        nothing = np.abs(offset) <= AGREEMENT * np.abs(middle).max(axis=1)
        sign = np.where(np.where(nothing, largest, offset) < 0, -1.0, 1.0)
        normal, offset = sign[:, None] * normal, sign * offset
        normal[values[:, -2] <= DETERMINED * values[:, 0]] = np.nan
        every = [found.chart.numbers(normal, offset)]
        if found.both:
            every.append(found.chart.numbers(-normal, -offset))
        return np.stack(every, axis=1)


def _charts(candidate: Candidate) -> Iterator[Chart]:
    """The ways in which the candidate's numbers may be a normal and an offset."""
    size = candidate.places.shape[1]
    if not candidate.flat:
        curved = [i for i, e in enumerate(candidate.entries) if not e.unknown.manifold.flat]
        pieces = [candidate.entries[i].unknown.manifold.pieces for i in curved]
        if pieces != [(Piece.SPHERE,)] or size not in (3, 4):
            return
        first = int(size == 4 and curved[0] == 1)
        offset = None if size == 3 else 3 - 3 * first
        yield Chart(written=Written.DIRECTION, normal=(first, first + 1, first + 2), offset=offset)
        return
    if size > NUMBERS:
        return
    columns = tuple(range(size))
    for offset in (*columns, None):
        normal = tuple(c for c in columns if c != offset)
        if len(normal) == 1:
            yield Chart(written=Written.ANGLE, normal=normal, offset=offset)
        elif len(normal) in (2, 3):
            yield Chart(written=Written.VECTOR, normal=normal, offset=offset)


def _incidences(rows: Rows, chart: Chart, *, both: bool) -> Incidences | None:
    """What the rows are as points in a plane: ``h = a · n + b · offset``, probed along the axes, checked elsewhere."""

    def values(normal: Floats, offset: float) -> Floats:
        return rows.values(chart.numbers(normal, np.asarray(offset)))[:, 0]

    d = chart.dimension
    axes = np.eye(d)
    with np.errstate(all="ignore"):
        points = np.stack([values(axis, 0.0) for axis in axes], axis=1)
        slope = values(axes[0], 1.0) - points[:, 0] if chart.offset is not None else np.ones(len(rows))
        size = np.abs(points).max(axis=1) + np.abs(slope)
        if not bool(np.isfinite(size).all() and (slope != 0).all() and points.any()):
            return None
        generator = np.random.default_rng(0)
        for _ in range(CHECKS):
            normal = generator.normal(size=d)
            normal /= np.linalg.norm(normal)
            offset = 0.0 if chart.offset is None else float(generator.uniform(-1.0, 1.0))
            scales = (1.0, 2.5) if chart.written is Written.VECTOR else (1.0,)
            expected = points @ normal + slope * offset
            for scale in scales:
                wrong = np.abs(values(scale * normal, offset) - expected)
                if not bool((wrong <= AGREEMENT * size).all()):
                    return None
    return Incidences(chart=chart, points=points / slope[:, None], weight=rows.weight * slope**2, both=both)


PLANES = Planes()
