"""The profile of a likelihood → how much of it lies on each side of its greatest value, and the interval that holds a
share of it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Protocol

import numpy as np

from mbm.equations.types import Floats
from mbm.estimation.uncertainty.student import Law, coverage_factors
from mbm.values import dataclass

NOTHING_LEFT, MOST_LOOKED_AT = 12.0, 30.0
"""−log of the share of the greatest likelihood where it is followed to, between 1e-5 and 1e-13."""

PLATEAU = 1e-3
"""−log of that share below which a likelihood without an end has not fallen: it has no maximum."""

LEVEL = 1e-8
"""−log of that share that is rounding: a likelihood that has fallen by less is level."""

FIRST_STEP = 1e-3
"""Share of its size by which a coordinate is moved first where no standard deviation is known."""

WITHOUT_END = 1e30
"""Distance that a likelihood reaches at least if it has no end, whatever the unit."""

NO_SIDE = 1e-6
"""Share of the reach to one side below which there is no other side: a likelihood begins at its greatest value."""

AIMED_AT = 16.0
"""−log of that share that steps aim at: aimed at the least, they hit it, and rounding decides what follows."""

LONGEST, SHORTEST = 1e3, 0.125
"""The next step as a multiple of the last one at most, and at least."""

AS_GOOD_AS_NONE = 1e5
"""Multiple of the first distance beyond which an end without enough growth is one of the search, not of a limit."""

HEAVY = 1e4
"""Multiple of the distance at which a likelihood has begun to fall, from which on what has not fallen to nothing has no
end: that of one degree of freedom takes 300, of half a degree 2000."""

BEGUN = 1.0
"""−log of the share of the greatest likelihood at which it has."""

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Side:
    """One side of a likelihood: ``surprise`` (k,), −log of what is left of it, at distances ``places`` (k,) from 0 on.

    ``endless``: it does not fall to nothing.
    """

    places: Floats
    surprise: Floats
    endless: bool

    def end(self, surprise: float) -> float:
        """Where that is; infinite where it never is."""
        inside = int(np.searchsorted(self.surprise, surprise, side="right"))
        if inside == len(self.places):
            return np.inf if self.endless else float(self.places[-1])
        return float(np.interp(surprise, self.surprise[inside - 1 : inside + 1], self.places[inside - 1 : inside + 1]))

    def within_reach(self, surprise: Floats) -> Floats:
        """What lies within where so much is reached, ascending, not normalised."""
        left = np.exp(-self.surprise)
        shares = np.concatenate([[0.0], np.cumsum(0.5 * (left[1:] + left[:-1]) * np.diff(self.places))])
        return np.asarray(np.interp(surprise, self.surprise, shares))


class Followed(Protocol):
    """What a profile is asked for here."""

    @property
    def value(self) -> float:
        """What it is a profile about."""
        ...

    @property
    def centre(self) -> float:
        """The step to where it is least."""
        ...

    def growth(self, step: float) -> float:
        """By how many variances the cost grows with a step."""
        ...


def share_between(below: Side, above: Side, law: Law, level: float, certain: float) -> tuple[float, float]:
    """How far the interval of a level reaches below and above; NaN where the likelihood tells nothing.

    ``certain`` is −log of the probability of data that would be certain elsewhere (NaN: there are none).
    """
    one_sided = min(len(below.places), len(above.places)) == 1
    least = max(-float(np.log1p(-level)) - certain, 0.0) if one_sided and not np.isnan(certain) else 0.0
    if below.endless or above.endless:
        flat = any(each.endless and each.surprise[-1] < PLATEAU for each in (below, above))
        factor = coverage_factors(level, np.array([law.dof]))[0]
        most = max(law.of_square(float(-2.0 * np.log1p(-level) if flat else factor**2)), least)
        ends = below.end(most), above.end(most)
        return (np.nan, np.nan) if np.isinf(ends).all() else ends
    grid = np.sort(np.concatenate([below.surprise, above.surprise]))
    within = below.within_reach(grid) + above.within_reach(grid)
    most = max(float(np.interp(level * within[-1], within, grid)), least, LEVEL)
    return below.end(most), above.end(most)


def grown_enough(
    profile: Followed, law: Law, level: float, first: float, inside: tuple[float, float]
) -> tuple[float, float]:
    """How far below and above the cost stays low enough for a level; infinite where it always does.

    What bends has another share of its likelihood for every function of it, and the same growth of the cost for all.
    The ``first`` step is such a distance, in whose proportion no distance is counted. It stays so at least to the
    distances ``inside``.
    """
    most = law.of_square(float(coverage_factors(level, np.array([law.dof]))[0]) ** 2)
    ways = (partial(_surprise, profile, law, sign) for sign in (-1.0, 1.0))
    below, above = (_reach(way, first, most, each) for way, each in zip(ways, inside, strict=True))
    return below, above


def _reach(surprise: Callable[[float], float], first: float, most: float, inside: float) -> float:
    """The distance at which ``surprise`` is so much, from one on where it is less."""
    near, far, step = (inside, surprise(inside) if inside else 0.0), (np.inf, np.inf), inside + first
    for _ in range(STEPS):
        found = surprise(step)
        if abs(np.sqrt(found / most) - 1.0) <= AS_FAR:
            return step
        near, far = (near, (step, found)) if found > most else ((step, found), far)
        if near[0] > WITHOUT_END:
            return np.inf
        if far[0] - near[0] <= NO_SIDE * near[0] or far[0] < NO_SIDE * first:
            break
        if np.isinf(far[0]):
            step = near[0] * min(LONGEST, max(2.0, np.sqrt(most / max(near[1], PLATEAU))))
        elif far[1] < MOST_LOOKED_AT:
            # the root of the growth is nearly a straight line
            low, wanted, high = np.sqrt([near[1], most, far[1]])
            step = float(near[0] + (wanted - low) / (high - low) * (far[0] - near[0]))
        else:
            step = 0.5 * (near[0] + far[0]) if near[0] > 0.0 else SHORTEST * far[0]
    return near[0] if near[0] <= AS_GOOD_AS_NONE * first else np.inf


def sides(profile: Followed, law: Law, limits: tuple[float, float], sigma: float) -> tuple[Side, Side]:
    """Below and above the estimate; the side on which the likelihood falls slowly tells how near the other one ends."""
    first = sigma if sigma > 0.0 else FIRST_STEP * (abs(profile.value) or 1.0)
    ways = tuple(partial(_surprise, profile, law, sign) for sign in (-1.0, 1.0))
    near = [way(min(first, limit)) if limit > 0.0 else np.inf for way, limit in zip(ways, limits, strict=True)]
    begin = 1 if near[0] > near[1] else 0
    one = _side(ways[begin], limits[begin], first, 0.0)
    least = 0.0 if one.endless else NO_SIDE * float(one.places[-1])
    other = _side(ways[1 - begin], limits[1 - begin], first, least)
    return (other, one) if begin else (one, other)


def _surprise(profile: Followed, law: Law, sign: float, distance: float) -> float:
    """What is left at a distance; where a likelihood has no value, far out, as little as is ever looked at."""
    found = law.surprise(profile.growth(profile.centre + sign * distance))
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
        begun = min((place for place, left in known.items() if left > BEGUN), default=np.inf)
        if inside > HEAVY * begun:
            return _refined(surprise, known, endless=True)
        if np.isfinite(outside):
            step = max(SHORTEST * outside, np.sqrt(inside * outside))
        else:
            step = min(inside * min(LONGEST, max(2.0, AIMED_AT / max(found, PLATEAU))), limit)
    if inside < limit <= (1.0 + AS_FAR) * inside:
        known[limit] = known[inside]
        inside = limit
    endless = 0.0 < inside < limit and np.isinf(outside) and known[inside] < NOTHING_LEFT
    return _refined(surprise, {0.0: 0.0, inside: known[inside]}, endless=endless)


def _refined(surprise: Callable[[float], float], known: dict[float, float], *, endless: bool) -> Side:
    """The side that is ``known`` at its first and last place and some between, with as many more as it takes."""
    # Loaded by likelihoods at limits only, so that the others start at once.
    from scipy.interpolate import Akima1DInterpolator

    places = np.array(sorted(known))
    if len(places) == 1:
        return Side(places=places, surprise=np.zeros(1), endless=endless)
    pieces = list(pairwise(places.tolist()))
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
