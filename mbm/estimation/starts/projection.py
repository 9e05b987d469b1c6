"""Random starts of models that are linear in some of their unknowns: variable projection (Golub and Pereyra 1973).

The cost is seen as one of the nonlinear unknowns alone: at each of their values the linear ones are solved for. Among
many points those are kept that cost less than all near them (Rinnooy Kan and Timmer 1987). From each, one nonlinear
unknown after the other then takes the best of many values, which finds the next peak, decay or period that is missing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbm.equations.affine_part import projected
from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.starts.magnitudes import Magnitudes, magnitudes
from mbm.estimation.starts.random_starts import costs, numbers_at, random_points

FEW, MOST = 128, 2048
"""Points that are looked at: twice as many with each nonlinear unknown, but no more than these."""

WITHOUT_LINEAR, WITH_LINEAR = 8, 40
"""Nonlinear unknowns up to which this is done: random points seldom are near a minimum in more of them, unless parts
of a sum, such as the decays of different samples, are found one after the other."""

NUMBERS = 10_000_000
"""Residuals that are computed at the random points at most, those of all columns together."""

VALUES, FEWEST_VALUES = 512, 96
"""Values that all nonlinear unknowns take, and those that each takes at least."""

SCANNED_NUMBERS = 30_000_000
"""Residuals that are computed at these values at most: a second or so."""

NEAR = 0.5
"""Distance within which the lower of two points stands for both, in mean distances of the points."""


EQUALLY_GOOD = 1e-9
"""Costs whose difference is rounding, as a share of them."""


def projected_points(
    equations: Assembled, base: Floats, missing: Mask, linear: Mask, seed: int, kept: int
) -> Floats | None:
    """Points (some, N) to start from, the best first; None where there are too many unknowns or rows for it."""
    layout = equations.layout
    bent = np.flatnonzero(missing & ~linear)
    width = len(bent)
    each = max(equations.whole, 1) * (int(linear.sum()) + 1)
    count = min(FEW * 2 ** min(width, 8), MOST, NUMBERS // each)
    most = WITH_LINEAR if linear.any() else WITHOUT_LINEAR
    if not 0 < width <= most or bool((layout.number[missing] < 0).any()) or count < FEW:
        return None
    sizes = magnitudes(equations, base, missing)
    profile = _Profile(equations, linear, sizes)
    points, found = profile.at(random_points(equations, base, missing, count, seed, sizes))
    order = np.argsort(found, kind="stable")[: int(np.isfinite(found).sum())]
    chosen = order[_apart(points[order][:, layout.number[bent]], kept)]
    points, found = points[chosen], found[chosen]
    if width > 1:
        values = max(VALUES // width, FEWEST_VALUES)
        grid = (np.arange(values) + 0.5)[:, None] / values
        tried = [numbers_at(equations, base, bent[k : k + 1], grid, sizes)[:, 0] for k in range(width)]
        for k in range(min(len(points), max(SCANNED_NUMBERS // (values * width * each), 1))):
            points[k], found[k] = profile.scanned(points[k], found[k], layout.number[bent], tried)
    points, found = profile.unsigned(points, found, layout.number[bent])
    return points[np.argsort(found, kind="stable")]


class _Profile:
    """The least cost as a function of the nonlinear unknowns."""

    def __init__(self, equations: Assembled, linear: Mask, sizes: Magnitudes) -> None:
        self._equations = equations
        self._linear = linear
        self._steps = sizes.middle

    def at(self, points: Floats) -> tuple[Floats, Floats]:
        """The points (T, N) with the linear unknowns solved for, and their costs (T,)."""
        if not self._linear.any():
            return points, costs(self._equations, points)
        found, plain = projected(self._equations, points, self._linear, self._steps)
        return found, costs(self._equations, found) if self._equations.lossy else plain

    def scanned(self, point: Floats, cost: float, places: Indices, values: Sequence[Floats]) -> tuple[Floats, float]:
        """A point (N,) no worse: each number at ``places`` takes the best of its ``values``, the others staying."""
        for place, each in zip(places, values, strict=True):
            tried = np.tile(point, (len(each), 1))
            tried[:, place] = each
            tried, found = self.at(tried)
            best = int(np.argmin(found))
            if found[best] < cost:
                point, cost = tried[best], float(found[best])
        return point, cost

    def unsigned(self, points: Floats, found: Floats, places: Indices) -> tuple[Floats, Floats]:
        """The points (T, N) with positive numbers at ``places`` where their sign makes no difference: widths."""
        for place in places:
            turned = points.copy()
            turned[:, place] = np.abs(turned[:, place])
            turned, after = self.at(turned)
            better = (points[:, place] < 0) & (after <= found + EQUALLY_GOOD * np.abs(found))
            points, found = np.where(better[:, None], turned, points), np.where(better, after, found)
        return points, found


def _apart(numbers: Floats, kept: int) -> Indices:
    """Which of the points (T, n), the best first, are the best near them, as their ranks tell; at most ``kept``."""
    count, width = numbers.shape
    ranks = np.argsort(np.argsort(numbers, axis=0, kind="stable"), axis=0, kind="stable") / max(count, 1)
    near = NEAR * max(count, 1) ** (-1.0 / width)
    chosen: list[int] = []
    for k in range(count):
        if not chosen or bool((np.abs(ranks[chosen] - ranks[k]).max(axis=1) > near).all()):
            chosen.append(k)
            if len(chosen) == kept:
                break
    return np.array(chosen, dtype=np.int64)
