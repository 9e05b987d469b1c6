"""Random starts of models that are linear in some of their unknowns: variable projection (Golub and Pereyra 1973).

The cost is seen as one of the nonlinear unknowns alone: at each of their values the linear ones are solved for. Among
many points those are kept that cost less than all near them (Rinnooy Kan and Timmer 1987). From each, one nonlinear
unknown after the other then takes the best of many values, which finds the next peak, decay or period that is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mbm.equations.affine_part import projected
from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.starts.magnitudes import Magnitudes, magnitudes
from mbm.estimation.starts.random_starts import costs, numbers_at, random_points
from mbm.expression.nodes import Outlined

FEW, MOST = 128, 2048
"""Points that are looked at: twice as many with each nonlinear unknown, but no more than these."""

WITHOUT_LINEAR, WITH_LINEAR = 12, 40
"""Nonlinear unknowns up to which this is done: random points seldom are near a minimum in more of them, unless parts
of a sum, such as the decays of different samples, are found one after the other."""

NUMBERS = 10_000_000
"""Residuals that are computed at the random points at most, and together; those of all columns."""

VALUES, FEWEST_VALUES, COARSE_VALUES = 512, 96, 24
"""Values that all nonlinear unknowns take, those that each takes at least, and where even one point takes long."""

FREQUENCIES = 8192
"""Frequencies that are tried at most."""

CLOSER, SHARES = 6, np.linspace(-1.0, 1.0, 17)
"""How often frequencies are narrowed down, and shares of the distance to the next that are tried: far from 0, the phase
of an oscillation follows its frequency so steeply that steps in both together find no minimum."""

SCANNED_NUMBERS = 30_000_000
"""Residuals that are computed at these values at most, or what takes as long: a second or so."""

OUTLINE = 300_000
"""Residuals that take as long as the outline of a curved model: some 10 ms."""

SOLVED = 20
"""Products in the normal equations of the linear unknowns that take as long as one residual."""

NEAR = 0.5
"""Distance within which the lower of two points stands for both, in mean distances of the points."""

EQUALLY_GOOD = 1e-9
"""Costs whose difference is rounding, as a share of them."""


def projected_points(
    equations: Assembled,
    base: Floats,
    missing: Mask,
    linear: Mask,
    seed: int,
    kept: int,
    stopped: Callable[[], bool],
) -> Floats | None:
    """Points (some, N) to start from, the best first; None where there are too many unknowns or rows for it.

    Those found so far once ``stopped()``.
    """
    layout = equations.layout
    bent = np.flatnonzero(missing & ~linear)
    width = len(bent)
    columns = int(linear.sum()) + 1
    outlines = sum(isinstance(call.external, Outlined) for group in equations.groups for call in group.kernel.calls)
    each = (max(equations.whole, 1) + OUTLINE * outlines) * columns
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
    affordable = SCANNED_NUMBERS // (each + each * columns // SOLVED)
    tried = _tried(equations, base, bent, sizes, affordable)
    for k in range(min(len(points), max(affordable // max(sum(map(len, tried)), 1), 1) if width > 1 else 1)):
        if stopped():
            break
        points[k], found[k] = profile.scanned(points[k], found[k], layout.number[bent], tried, stopped)
    if len(points):
        k = int(np.argmin(found))
        for place in bent[~np.isnan(sizes.turn[bent])]:
            points[k], found[k] = profile.closer(points[k], found[k], int(place), sizes, stopped)
    points, found = profile.unsigned(points, found, layout.number[bent])
    return points[np.argsort(found, kind="stable")]


def _tried(equations: Assembled, base: Floats, bent: Indices, sizes: Magnitudes, affordable: int) -> list[Floats]:
    """The values that each of the nonlinear coordinates takes, of its size and frequencies; a single one only these."""
    width = len(bent)
    values = max(VALUES // width, min(FEWEST_VALUES, max(affordable // width, COARSE_VALUES))) if width > 1 else 0
    grid = (np.arange(values) + 0.5)[:, None] / max(values, 1)
    layout, tried = equations.layout, []
    for k in bent:
        among = numbers_at(equations, base, np.array([k]), grid, sizes)[:, 0]
        turns = sizes.frequencies(int(k), min(FREQUENCIES, affordable // width))
        inside = (turns >= layout.lower[k]) & (turns <= layout.upper[k])
        tried.append(np.concatenate([among, turns[inside]]))
    return tried


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
        step = max(NUMBERS // (max(self._equations.whole, 1) * (int(self._linear.sum()) + 1)), 1)
        blocks = [points[i : i + step] for i in range(0, max(len(points), 1), step)]
        parts = [projected(self._equations, block, self._linear, self._steps) for block in blocks]
        found, plain = (np.concatenate(each) for each in zip(*parts, strict=True))
        return found, costs(self._equations, found) if self._equations.lossy else plain

    def scanned(
        self, point: Floats, cost: float, places: Indices, values: Sequence[Floats], stopped: Callable[[], bool]
    ) -> tuple[Floats, float]:
        """A point (N,) no worse: each number at ``places`` takes the best of its ``values``, the others staying."""
        for place, each in zip(places, values, strict=True):
            if not len(each) or stopped():
                continue
            tried = np.tile(point, (len(each), 1))
            tried[:, place] = each
            tried, found = self.at(tried)
            best = int(np.argmin(found))
            if found[best] < cost:
                point, cost = tried[best], float(found[best])
        return point, cost

    def closer(
        self, point: Floats, cost: float, coordinate: int, sizes: Magnitudes, stopped: Callable[[], bool]
    ) -> tuple[Floats, float]:
        """A point (N,) no worse: a frequency or period at the least cost between those next to it."""
        layout = self._equations.layout
        place = layout.number[coordinate]
        apart = sizes.apart(coordinate, float(point[place]))
        for k in range(CLOSER):
            tried = point[place] + apart * (SHARES[-1] - SHARES[-3]) ** k * SHARES
            inside = (tried >= layout.lower[coordinate]) & (tried <= layout.upper[coordinate])
            inside &= (tried > 0) | ~layout.positive[coordinate]
            point, cost = self.scanned(point, cost, np.array([place]), [tried[inside]], stopped)
        return point, cost

    def unsigned(self, points: Floats, found: Floats, places: Indices) -> tuple[Floats, Floats]:
        """The points (T, N) with positive numbers at ``places`` where their sign makes no difference: widths."""
        for place in places:
            negative = np.flatnonzero(points[:, place] < 0)
            if negative.size:
                turned = points[negative]
                turned[:, place] *= -1.0
                turned, after = self.at(turned)
                better = after <= found[negative] + EQUALLY_GOOD * np.abs(found[negative])
                points[negative[better]], found[negative[better]] = turned[better], after[better]
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
