"""Distances from stations that stay: where they tell by themselves that no other place fits better."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.consensus.recognised import Recognised
from mbm.estimation.minimise.native.system import NativeSystem
from mbm.estimation.starts.closed_forms.multilateration import Spheres
from mbm.solver import description as of
from mbm.values import dataclass

FLAT = 1e-12
"""Height of stations above their plane beside their extent, that rounding leaves."""

AS_DISTANCES = 1e-9
"""Relative difference of costs up to which rows are distances as these are understood."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stations:
    """Distances from stations (n, d) that are measured with weights 1/σ² (n,); all rows are such.

    They are the same in all data sets. ``spread`` (d,) are the singular values of the stations about their weighted
    mean ``centre``, times the roots of the weights, ascending; ``normal`` is the direction of the first. ``flat``: the
    stations lie in a plane (on a line in two dimensions). ``whole`` is the root of the sum of the weights.
    """

    stations: Floats
    squares: Floats
    whole: float
    places: Indices
    centre: Floats
    normal: Floats
    spread: tuple[float, ...]
    flat: bool

    def sure(self, numbers: Floats, cost: Floats, covariance: Floats) -> Mask:
        """Where no other point costs less than T minima with numbers (T, N) and covariances (T, d, d)."""
        p, size = numbers[:, self.places], np.square(covariance).sum(axis=(1, 2))
        height = np.abs((p - self.centre) @ self.normal)
        with np.errstate(all="ignore"):
            found = np.asarray(self._alone(*self._boxed(p), height, cost, size))
            rest = np.flatnonzero(~found)
            if len(rest):
                squares = self.stations @ p[rest].T
                squares *= -2.0
                squares += self.squares[:, None]
                own = np.square(p[rest]).sum(axis=1)
                far, near = squares.max(axis=0) + own, squares.min(axis=0) + own
                found[rest] = self._alone(far, near, height[rest], cost[rest], size[rest])
        return found

    def sure_one(self, numbers: Floats, cost: float, covariance: Floats) -> bool:
        """The same for one of them, in a tenth of the time."""
        p = numbers[self.places]
        squares = self.squares - 2 * (self.stations @ p)
        own, spread = p.dot(p).item(), covariance.ravel()
        far, near = squares.max().item() + own, squares.min().item() + own
        height = abs((p - self.centre).dot(self.normal).item())
        try:
            return bool(self._alone(far, near, height, cost, spread.dot(spread).item()))
        except ZeroDivisionError:
            return False

    def _boxed(self, p: Floats) -> tuple[Floats, Floats]:
        """Limits (T,) of the squared distances of points (T, d): to a box about all stations, which is soon told."""
        below, above = p - self.stations.min(axis=0), self.stations.max(axis=0) - p
        return (
            np.square(np.maximum(below, above)).sum(axis=1),
            np.square(np.minimum(np.minimum(below, above), 0.0)).sum(axis=1),
        )

    def _alone(self, far: Any, near: Any, height: Any, cost: Any, size: Any) -> Any:
        """Whether no other point costs less than p; numbers of one minimum, or arrays of all.

        ``far`` and ``near`` are limits of the squared distances, ``size`` is the squared norm of the covariance.
        If q costs no more, ``‖d(q) − d(p)‖ ≤ 2√cost`` for the weighted distances d: q lies within a radius. J changes
        by so little there that ``cost(q) ≥ cost + |q − p|² ((s − radius slope / 2)² − slope √cost)``, where s is the
        least singular value of J at p. Where the stations lie in a plane, the other side of it is the same fit.
        """
        root = cost**0.5
        radius = self._radius(height, root, far**0.5)
        slope = self.whole / (abs(near) ** 0.5 - radius)
        firm = size**-0.25 - radius * slope / 2
        return (radius > 0) & (slope > 0) & (firm > 0) & (firm * firm > slope * root)

    def _radius(self, height: Any, root: Any, far: Any) -> Any:
        """Within which of p what costs no more lies, on its side of a plane of all stations; else nothing positive.

        Differences of squared distances are linear, and by up to ``√cost (2 far + radius)`` others; so is their mean,
        which tells the ``height`` above the plane.
        """
        if not self.flat:
            return 2 * root * far / (self.spread[0] - root)
        along = root / self.spread[1]
        share = along + (root / (self.whole * far) + along + along * along) ** 0.5
        twice = 2 * far / (1 - share)
        aside = along * twice
        squared = 2 * root * twice / self.whole + aside * (2 * far + aside)
        return (aside * aside + (squared / height) ** 2) ** 0.5 * (1 - 2 * (share >= 1))


def stations_of(form: Recognised, costs: NativeSystem, changing: Sequence[Indices | slice]) -> Stations | None:
    """The stations, where all rows are distances of these from all numbers that are estimated, and these stay.

    ``costs`` is the system of a data set without a step, ``changing`` are the places of the parameters that data sets
    change.
    """
    equations, data = form.first, form.plan.data
    if not isinstance(data, Spheres) or data.offset is not None or len(form.plan.rows) != equations.count:
        return None
    if len(data.stations) < data.stations.shape[1]:
        return None
    weights, centre = form.plan.rows.weight, np.average(data.stations, axis=0, weights=form.plan.rows.weight)
    places = form.plan.candidate.places[0][list(data.point)]
    probes = np.tile(equations.numbers, (2, 1))
    probes[:, places] = centre + np.ptp(data.stations, axis=0).max() * np.array([[1.0], [-0.7]])
    away = np.linalg.norm(probes[:, None, places] - data.stations, axis=2)
    expected = np.square(away - data.length) @ weights
    if not np.allclose(costs.solve(probes).results[:, of.COST], expected, rtol=AS_DISTANCES, atol=0.0):
        return None
    changes = np.zeros(len(costs.rows.parameters), dtype=bool)
    for each in changing:
        changes[each] = True
    if changes[_depends(equations, form, data.stations.shape[1])].any():
        return None
    _, spread, axes = np.linalg.svd((data.stations - centre) * np.sqrt(weights)[:, None], full_matrices=False)
    height = np.abs((data.stations - centre) @ axes[-1]).max()
    return Stations(
        stations=data.stations,
        squares=np.square(data.stations).sum(axis=1),
        whole=float(np.sqrt(weights.sum())),
        places=places,
        centre=centre,
        normal=axes[-1],
        spread=tuple(spread[::-1].tolist()),
        flat=bool(height <= FLAT * np.abs(data.stations - centre).max()),
    )


def _depends(equations: Assembled, form: Recognised, width: int) -> Indices:
    """The parameters of a data set on which the first ``width`` of what the form knows of its units depend."""
    found, first = [], 0
    for number, group in enumerate(equations.groups):
        acts = np.zeros(group.parameters.shape[1], dtype=bool)
        for each in form.form.maps or ():
            if each.group == number:
                acts |= (each.matrix[:-1, :width] != 0.0).any(axis=1)
        found.append(first + np.flatnonzero(np.tile(acts, group.rows)))
        first += group.parameters.size
    return np.concatenate(found)
