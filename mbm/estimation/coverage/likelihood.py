"""Intervals of coordinates whose likelihood a limit cuts off, or falls to nothing on one side only or from a plateau.

Where an estimate is at its limit, the curvature there says nothing of how far its likelihood reaches. Its profile, the
greatest likelihood over all other coordinates within their own limits, is followed to where nothing is left of it; the
interval is the shortest that holds the wanted share of it between the limits. Of a normal likelihood that is the
shortest of the normal distribution between the limits. It holds the truth in (1 − α)/(1 + α) of all cases at least, and
in more than 1 − α near a limit (Roe and Woodroofe 2001, Physical Review D 63, 013009; Zhang and Woodroofe 2003, Journal
of Statistical Planning and Inference 115, 479–490). If nothing is counted it ends at 3.00 for 95 %, as the exact
one-sided limit does. The deviance has grown by 3.84 at 1.92, where nothing is counted in 15 % of all cases.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.spreads import Freedom, Limited
from mbm.equations.types import Floats, Mask, Minimum
from mbm.estimation.coverage.student import coverage_factors
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.settings import Settings
from mbm.estimation.trust.nonlinearity import MOST_FOLLOWED, OF_LIKELIHOODS
from mbm.estimation.uncertainty.statistics import Statistics
from mbm.values import dataclass

NOTHING_LEFT, MOST_LOOKED_AT = 12.0, 30.0
"""−log of the share of the greatest likelihood where it is followed to, between 1e-5 and 1e-13."""

PLATEAU = 1e-3
"""−log of that share below which a likelihood without an end has not fallen: it has no maximum."""

FIRST_STEP = 1e-3
"""Share of its size by which a coordinate is moved first where no standard deviation is known."""

WITHOUT_END = 1e30
"""Distance that a likelihood reaches at least if it has no end, whatever the unit."""

NO_SIDE = 1e-6
"""Share of the reach to one side below which there is no other side: a likelihood begins at its greatest value."""

LONGEST, SHORTEST = 1e3, 0.125
"""The next step as a multiple of the last one at most, and at least."""

STEPS = 60
"""Steps on the way to where nothing is left."""

AS_FAR = 1e-3
"""Accuracy of where the model has no value any more, as a share of its distance."""

AGREES = 0.01
"""Error of −log L between the places where it is known, which moves an end by less than 1 % of a standard deviation."""

LEAST_PLACES, MOST_PLACES = 5, 60
"""Places on one side where the likelihood is known."""

FINE = 100
"""Pieces between two such places over which it is summed up."""

HALVINGS = 60

SHORTER_STEPS = 40
"""Steps to where a likelihood has a value, those that are halved as they lead to none counted."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Likelihood:
    """The likelihood about a ``minimum``, with the ``limits`` of its coordinates (None: there are none).

    ``variance`` is that of the residuals; one scale that is an unknown counts as in `Profiles` if it is ``scaled``.
    """

    equations: Assembled
    minimum: Minimum
    limits: Limited | None
    variance: float
    scaled: bool
    settings: Settings

    def put_in(self, ends: tuple[Floats, Floats], sigma: Floats, freedom: Freedom, level: float) -> None:
        """Put the ``ends`` of intervals (n,), below and above, of coordinates that a limit cuts or without a ``sigma``,
        and of those that reach farther where a limit that holds another one lets go of it.

        Others have their ends, NaN where these are linear. Of ``sigma`` (n,) and ``freedom`` (n,).
        """
        equations, count = self.equations, len(sigma)
        k = coverage_factors(level, freedom.dof)
        numbers = equations.layout.number[equations.free]
        places = np.where(numbers >= 0, self.minimum.point[numbers], np.nan)
        lower, upper = np.full(count, -np.inf), np.full(count, np.inf)
        below, above = (np.where(np.isnan(each), k * freedom.inflation * sigma, each) for each in ends)
        held: Mask = np.asarray(self.minimum.at_bound != 0)
        if self.limits is not None:
            lower, upper = self.limits.lower, self.limits.upper
            held |= ~np.isnan(self.limits.step)
        wanted = held | np.isnan(sigma) | (places - below < lower) | (places + above > upper)
        asked = numbers >= 0 if held.any() else wanted & (numbers >= 0)
        others = np.flatnonzero(asked & ~wanted)[:MOST_FOLLOWED]
        for which in [*np.flatnonzero(asked & wanted).tolist(), *others.tolist()]:
            law = Law(dof=float(freedom.dof[which]), inflation=float(freedom.inflation[which]), scaled=self.scaled)
            profile = Profile(self.equations, self.minimum, which, self.variance, self.settings)
            reached = law.of_square(float(k[which]) ** 2)
            there = (law.surprise(profile.growth(step)) for step in (-below[which], above[which]))
            if wanted[which] or any(abs(np.sqrt(each / reached) - 1.0) > OF_LIKELIHOODS for each in there):
                limits = places[which] - lower[which], upper[which] - places[which]
                ends[0][which], ends[1][which] = _interval(profile, law, limits, float(sigma[which]), level)


@np.errstate(all="ignore")
def likelihood(
    equations: Assembled, minimum: Minimum, outcome: Statistics, limits: Limited | None, settings: Settings
) -> Likelihood | None:
    """What finds such intervals; None where there is no likelihood, or nothing is known of it."""
    if not equations.likely or equations.lossy or minimum.blocks is not None or not minimum.feasible:
        return None
    if (
        not (minimum.reason.converged or minimum.reason.under_way)
        or not outcome.sigma_known
        or not outcome.covariance.variance > 0.0
    ):
        return None
    return Likelihood(
        equations=equations,
        minimum=minimum,
        limits=limits,
        variance=outcome.covariance.variance,
        scaled=outcome.freedoms.scaled,
        settings=settings,
    )


class Profile:
    """The profile of the likelihood of the coordinate ``which`` (of the free ones) about a minimum."""

    def __init__(self, equations: Assembled, minimum: Minimum, which: int, variance: float, settings: Settings) -> None:
        free = equations.free
        self._number = int(equations.layout.number[free[which]])
        self._others = equations.freed(np.delete(free, which), minimum.point)
        self._settings = settings
        self._least = minimum.cost
        self._variance = variance
        self._points = {0.0: minimum.point}
        self.value = float(minimum.point[self._number])

    def growth(self, step: float) -> float:
        """By how many variances the cost grows with a step of the coordinate, least over all others; infinite where
        there is no value.

        Where there is none with the others as they are at the nearest step so far, shorter steps lead there.
        """
        near, there = min(self._points, key=lambda each: abs(each - step)), step
        for _ in range(SHORTER_STEPS):
            start = self._points[near].copy()
            start[self._number] = self.value + there
            residuals = self._others.residuals(start)
            cost = float(residuals @ residuals)
            if not self._others.dimension:
                return self._told(cost)
            if not np.isfinite(cost):
                there = 0.5 * (near + there)
                continue
            found = minimise(self._others, start, self._settings)
            if not found.feasible:
                break
            self._points[there] = found.point
            if there == step:
                return self._told(found.cost)
            near, there = there, step
        return np.inf

    def _told(self, cost: float) -> float:
        return max(cost - self._least, 0.0) / self._variance if np.isfinite(cost) else np.inf


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Law:
    """What the growth of the cost, in variances, is taken for: the square of Student's t of ``dof`` degrees of freedom.

    ``inflation`` is that of the standard deviation, and ``scaled`` as of `Profiles`.
    """

    dof: float
    inflation: float
    scaled: bool

    def surprise(self, growth: float) -> float:
        """−log of the share of the greatest density that is left."""
        if not np.isfinite(self.dof):
            return 0.5 * growth / self.inflation**2
        if self.scaled:
            return 0.5 * (self.dof + 1.0) * growth / (self.dof * self.inflation**2)
        return self.of_square(growth / self.inflation**2)

    def of_square(self, squared: float) -> float:
        """The same where t² is so much."""
        if not np.isfinite(self.dof):
            return 0.5 * squared
        return 0.5 * (self.dof + 1.0) * float(np.log1p(squared / self.dof))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Side:
    """One side of a likelihood: ``surprise`` (k,), −log of what is left of it, at distances ``places`` (k,) from 0 on.

    ``endless``: it does not fall to nothing.
    """

    places: Floats
    surprise: Floats
    endless: bool

    def within(self, surprise: float) -> int:
        """How many of the places it takes to where so much is reached."""
        return int(np.searchsorted(self.surprise, surprise, side="right"))

    def end(self, surprise: float) -> float:
        """Where that is; infinite where it never is."""
        inside = self.within(surprise)
        if inside == len(self.places):
            return np.inf if self.endless else float(self.places[-1])
        return float(np.interp(surprise, self.surprise[inside - 1 : inside + 1], self.places[inside - 1 : inside + 1]))

    def shares(self) -> Floats:
        """What lies within each of the places (k,), not normalised."""
        left = np.exp(-self.surprise)
        return np.concatenate([[0.0], np.cumsum(0.5 * (left[1:] + left[:-1]) * np.diff(self.places))])


def _interval(
    profile: Profile, law: Law, limits: tuple[float, float], sigma: float, level: float
) -> tuple[float, float]:
    """How far the interval reaches below and above; NaN where the likelihood tells nothing."""
    below, above = _sides(profile, law, limits, sigma)
    if below.endless or above.endless:
        flat = any(each.endless and each.surprise[-1] < PLATEAU for each in (below, above))
        factor = coverage_factors(level, np.array([law.dof]))[0]
        most = law.of_square(float(-2.0 * np.log1p(-level) if flat else factor**2))
        ends = below.end(most), above.end(most)
        return (np.nan, np.nan) if np.isinf(ends).all() else ends
    shares = below.shares(), above.shares()
    wanted = level * float(shares[0][-1] + shares[1][-1])
    low, high = 0.0, MOST_LOOKED_AT
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        held = sum(np.interp(s.end(middle), s.places, share) for s, share in zip((below, above), shares, strict=True))
        low, high = (middle, high) if held < wanted else (low, middle)
    return below.end(high), above.end(high)


def _sides(profile: Profile, law: Law, limits: tuple[float, float], sigma: float) -> tuple[Side, Side]:
    """Below and above the estimate; the side on which the likelihood falls slowly tells how near the other one ends."""
    first = sigma if sigma > 0.0 else FIRST_STEP * (abs(profile.value) or 1.0)
    ways = tuple(partial(_surprise, profile, law, sign) for sign in (-1.0, 1.0))
    near = [way(min(first, limit)) if limit > 0.0 else np.inf for way, limit in zip(ways, limits, strict=True)]
    begin = 1 if near[0] > near[1] else 0
    one = _side(ways[begin], limits[begin], first, 0.0)
    least = 0.0 if one.endless else NO_SIDE * float(one.places[-1])
    other = _side(ways[1 - begin], limits[1 - begin], first, least)
    return (other, one) if begin else (one, other)


def _surprise(profile: Profile, law: Law, sign: float, distance: float) -> float:
    """What is left at a distance; where a likelihood has no value, far out, as little as is ever looked at."""
    found = law.surprise(profile.growth(sign * distance))
    return found if found < 2.0 * MOST_LOOKED_AT else 2.0 * MOST_LOOKED_AT


def _side(surprise: Callable[[float], float], limit: float, step: float, least: float) -> Side:
    """One side up to the ``limit``, on which ``surprise`` tells −log of what is left at a distance.

    The first ``step`` is such a distance; there is no such side if it is not longer than the ``least``.
    """
    step, outside, known = min(step, limit), np.inf, {0.0: 0.0}
    inside = 0.0
    for _ in range(STEPS):
        if not inside < limit or step < least:
            break
        found = surprise(step)
        if found > MOST_LOOKED_AT:
            outside = step
        else:
            inside, known[step] = step, found
        if known[inside] >= NOTHING_LEFT or outside <= (1.0 + AS_FAR) * inside or inside > WITHOUT_END:
            break
        if np.isfinite(outside):
            step = max(SHORTEST * outside, np.sqrt(inside * outside))
        else:
            step = min(inside * min(LONGEST, max(2.0, NOTHING_LEFT / max(found, PLATEAU))), limit)
    if inside < limit <= (1.0 + AS_FAR) * inside:
        known[limit] = known[inside]
        inside = limit
    endless = 0.0 < inside < limit and np.isinf(outside) and known[inside] < NOTHING_LEFT
    return _refined(surprise, {0.0: 0.0, inside: known[inside]}, endless)


def _refined(surprise: Callable[[float], float], known: dict[float, float], endless: bool) -> Side:
    """The side that is ``known`` at its first and last place, with as many between as it takes."""
    # Loaded by likelihoods at limits only, so that the others start at once.
    from scipy.interpolate import Akima1DInterpolator

    places = np.array(sorted(known))
    if len(places) == 1:
        return Side(places=places, surprise=np.zeros(1), endless=endless)
    pieces = [(float(places[0]), float(places[1]))]
    while pieces and len(known) < MOST_PLACES:
        curve = None if len(known) < LEAST_PLACES else Akima1DInterpolator(places, [known[each] for each in places])
        still = []
        for a, b in pieces:
            middle = 0.5 * (a + b)
            known[middle] = surprise(middle)
            if curve is None or abs(float(curve(middle)) - known[middle]) > AGREES:
                still += [(a, middle), (middle, b)]
        pieces, places = still, np.array(sorted(known))
    values = [known[each] for each in places]
    fine = np.concatenate([*(np.linspace(a, b, FINE, endpoint=False) for a, b in pairwise(places)), places[-1:]])
    every = np.maximum.accumulate(Akima1DInterpolator(places, values)(fine))
    return Side(places=fine, surprise=every, endless=endless)
