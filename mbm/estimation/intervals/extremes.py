"""How far the set of a network reaches at least: sequential linear programmes from point to point of the set.

They prove nothing of what lies outside, and bounds do not rest on them. Bisection stops where a box cannot reach beyond
what is attained. A point counts that meets the demands but for rounding: equations hold at no double for certain.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Indices, Mask
from mbm.estimation.intervals import points
from mbm.estimation.intervals.arithmetic import Floats
from mbm.estimation.intervals.contraction import Boxes
from mbm.estimation.intervals.network import Network
from mbm.values import dataclass

MOST_STEPS = 12
"""Linear programmes for one side of one quantity."""

FINE_STEP = 1e-6
"""Steps of difference quotients as a part of the box."""

SHORTER = (1.0, 0.95, 0.8, 0.5, 0.25, 0.1, 0.03)
"""Parts of a step that are tried: curved demands are left by the whole one."""

LEAST_SIZE = 1e-300
"""In place of a slope of zero, to divide by."""

SLACK = 1e-10
"""What rounding may leave of a demand, as a part of what its value ranges over in the first box."""

CORRECTIONS = 5
"""Newton steps back to the equations after a step along them."""

MOST_ENTRIES = 200_000
"""Derivatives of all demands: beyond, the programmes would take longer than the bisection they save."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reach:
    """Points (2, Q) at which each of Q scalars is least and greatest so far, their values, NaN where none is known."""

    low: Floats
    high: Floats
    low_points: Floats
    high_points: Floats

    @staticmethod
    def nowhere(scalars: int, numbers: int) -> Reach:
        """No point is known."""
        none = np.full((scalars, numbers), np.nan)
        return Reach(
            low=np.full(scalars, np.inf), high=np.full(scalars, -np.inf), low_points=none, high_points=none.copy()
        )

    @property
    def known(self) -> bool:
        """Whether a point is."""
        return bool(len(self.low)) and bool(np.isfinite(self.low).any())

    def with_points(self, found: Floats, least: Floats, greatest: Floats) -> Reach:
        """The same with more certain points (n, N), whose scalars lie between ``least`` and ``greatest`` (n, Q)."""
        if not len(found) or not least.shape[1]:
            return self
        first, last = np.argmin(greatest, axis=0), np.argmax(least, axis=0)
        every = np.arange(least.shape[1])
        lower, higher = greatest[first, every] < self.low, least[last, every] > self.high
        return Reach(
            low=np.where(lower, greatest[first, every], self.low),
            high=np.where(higher, least[last, every], self.high),
            low_points=np.where(lower[:, None], found[first], self.low_points),
            high_points=np.where(higher[:, None], found[last], self.high_points),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Probe:
    """A network, and what is demanded of it (M,), with the ``slack`` (M,) that rounding has."""

    network: Network
    least: Floats
    greatest: Floats
    slack: Floats

    @staticmethod
    def of(network: Network, first: Boxes) -> Probe:
        """The probe of a network for points in the ``first`` box (1, N)."""
        least, greatest = points.allowed(network)
        low, high = (ends[0] for ends in points.values(network, first.low, first.high).demanded)
        range_ = np.where(np.isfinite(low) & np.isfinite(high), high - low, 1.0)
        return Probe(network=network, least=least, greatest=greatest, slack=SLACK * range_)

    @property
    def equal(self) -> Mask:
        """Which demands are equations (M,)."""
        return np.asarray(self.least == self.greatest)

    def meets(self, found: points.Values) -> Mask:
        """Which points (n,) meet the demands."""
        low, high = found.demanded
        near = ((low >= self.least - self.slack) & (high <= self.greatest + self.slack)).all(axis=1)
        return np.asarray(found.inside & near)


def scalars_of(network: Network, low: Floats, high: Floats, derived: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """The scalars (n, Q) of boxes: the free numbers, then those of derived quantities."""
    free = network.free
    return np.concatenate([low[:, free], derived[0]], axis=1), np.concatenate([high[:, free], derived[1]], axis=1)


def probed(probe: Probe, reach: Reach, candidates: Floats) -> Reach:
    """The reach with those of the ``candidates`` (n, N) that are in the set."""
    found = points.values(probe.network, candidates, candidates)
    least, greatest = scalars_of(probe.network, candidates, candidates, found.derived)
    inside = probe.meets(found)
    return reach.with_points(candidates[inside], least[inside], greatest[inside])


def _corrected(probe: Probe, candidates: Floats, slopes: Floats, box: tuple[Floats, Floats, Indices]) -> Floats:
    """The candidates (n, N) taken back to the equations by Newton steps, with the ``slopes`` (M, n) of one place."""
    equal, (low, high, free) = probe.equal, box
    if not equal.any() or not np.isfinite(slopes[equal]).all():
        return candidates
    widths = (high - low)[free]
    back = np.linalg.pinv(slopes[equal] * widths, rcond=1e-10)
    for _ in range(CORRECTIONS):
        found = points.values(probe.network, candidates, candidates)
        wrong = ((found.demanded[0] + found.demanded[1]) / 2 - probe.least)[:, equal]
        step = -(np.where(np.isfinite(wrong), wrong, 0.0) @ back.T) * widths
        candidates = candidates.copy()
        candidates[:, free] = np.clip(candidates[:, free] + step, low[free], high[free])
    return candidates


def extended(probe: Probe, reach: Reach, low: Floats, high: Floats, tolerance: Floats) -> Reach:
    """The reach as far as linear programmes take it within a box (N,); ``tolerance`` (Q,) is what matters."""
    demands = len(probe.least)
    free = np.flatnonzero(probe.network.free & (high > low))
    if not len(free) or demands * len(free) * len(tolerance) > MOST_ENTRIES:
        return reach
    if not reach.known:
        reach = _feasible(probe, reach, low, high, free)
    for scalar in range(len(tolerance)):
        if np.isfinite(tolerance[scalar]):
            for side in (-1.0, 1.0):
                reach = _pushed(probe, reach, (scalar, side), (low, high, free), float(tolerance[scalar]))
    return reach


def _pushed(
    probe: Probe,
    reach: Reach,
    aim: tuple[int, float],
    box: tuple[Floats, Floats, Indices],
    tolerance: float,
) -> Reach:
    """The reach with one scalar pushed to one side."""
    low, high, free = box
    scalar, side = aim
    radius = 1.0
    for _ in range(MOST_STEPS):
        point = (reach.low_points if side < 0 else reach.high_points)[scalar]
        if np.isnan(point).any():
            return reach
        before = (reach.low if side < 0 else reach.high)[scalar]
        demanded, slopes, scalar_slopes = _linearised(probe.network, point, box)
        step = _program(
            probe, demanded, slopes, (-side * scalar_slopes[scalar], None), (point, low, high, free, radius)
        )
        if step is None:
            return reach
        moves = np.zeros((len(SHORTER), len(point)))
        moves[:, free] = np.multiply.outer(SHORTER, step)
        moved = _corrected(probe, np.clip(point + moves, low, high), slopes, box)
        reach = probed(probe, reach, moved)
        gain = abs((reach.low if side < 0 else reach.high)[scalar] - before)
        if gain < 0.05 * tolerance:
            if radius < 0.05:
                return reach
            radius *= 0.2
    return reach


def _feasible(probe: Probe, reach: Reach, low: Floats, high: Floats, free: Indices) -> Reach:
    """A first certain point, from the middle of the box, by least violation."""
    point = np.where(high > low, (low + high) / 2, low)
    for _ in range(MOST_STEPS):
        reach = probed(probe, reach, point[None])
        if reach.known:
            return reach
        demanded, slopes, _ = _linearised(probe.network, point, (low, high, free))
        step = _program(probe, demanded, slopes, (np.zeros(len(free)), 1.0), (point, low, high, free, 1.0))
        if step is None:
            return reach
        point = point.copy()
        point[free] += step
    return reach


def _linearised(network: Network, point: Floats, box: tuple[Floats, Floats, Indices]) -> tuple[Floats, Floats, Floats]:
    """Demanded values (M,) at a point, their slopes (M, n) and those of the scalars (Q, n), by differences."""
    low, high, free = box
    step = FINE_STEP * (high - low)[free]
    moved = np.repeat(point[None], 2 * len(free) + 1, axis=0)
    moved[np.arange(len(free)), free] += step
    moved[len(free) + np.arange(len(free)), free] -= step
    found = points.values(network, moved, moved)
    middle = (found.demanded[0] + found.demanded[1]) / 2
    least, greatest = scalars_of(network, moved, moved, found.derived)
    scalars = (least + greatest) / 2
    n = len(free)
    slopes = (middle[:n] - middle[n : 2 * n]) / (2 * step[:, None])
    scalar_slopes = (scalars[:n] - scalars[n : 2 * n]) / (2 * step[:, None])
    return middle[-1], slopes.T, scalar_slopes.T


def _program(
    probe: Probe,
    demanded: Floats,
    slopes: Floats,
    goal: tuple[Floats, float | None],
    room: tuple[Floats, Floats, Floats, Indices, float],
) -> Floats | None:
    """The step (n,) that lessens the goal most where the demands are linear; None where there is none.

    With a weight for it, the largest violation is a variable too.
    """
    from scipy.optimize import linprog

    slope, weight = goal
    point, low, high, free, radius = room
    least, greatest = probe.least, probe.greatest
    upper, lower = np.isfinite(greatest), np.isfinite(least)
    rows = np.concatenate([slopes[upper], -slopes[lower]])
    limits = np.concatenate([(greatest - demanded)[upper], (demanded - least)[lower]])
    if not (np.isfinite(rows).all() and np.isfinite(limits).all() and np.isfinite(slope).all()):
        return None
    widths = (high - low)[free]
    rows = rows * widths
    sizes = np.maximum(np.abs(rows).max(axis=1, initial=0.0), LEAST_SIZE)
    rows, limits = rows / sizes[:, None], limits / sizes
    bounds = [
        (max(a, -radius), min(b, radius))
        for a, b in zip((low[free] - point[free]) / widths, (high[free] - point[free]) / widths, strict=True)
    ]
    objective = slope * widths
    objective = objective / max(float(np.abs(objective).max(initial=0.0)), LEAST_SIZE)
    if weight is not None:
        rows = np.concatenate([rows, -np.ones((len(rows), 1))], axis=1)
        objective, bounds = np.append(objective, weight), [*bounds, (None, None)]
    inequalities = {"A_ub": rows, "b_ub": limits} if len(rows) else {}
    found = linprog(objective, bounds=bounds, method="highs", **inequalities)
    return np.asarray(found.x[: len(free)] * widths) if found.status == 0 else None
