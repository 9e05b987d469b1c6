"""Intervals of coordinates whose likelihood a limit cuts off, or falls to nothing on one side only or from a plateau.

Where an estimate is at its limit, the curvature there says nothing of how far its likelihood reaches. Its profile, the
greatest likelihood over all other coordinates within their own limits, is followed to where nothing is left of it; the
interval is the shortest that holds the wanted share of it between the limits. Of a normal likelihood that is the
shortest of the normal distribution between the limits. It holds the truth in (1 − α)/(1 + α) of all cases at least, and
in more than 1 − α near a limit (Roe and Woodroofe 2001, Physical Review D 63, 013009; Zhang and Woodroofe 2003, Journal
of Statistical Planning and Inference 115, 479–490). Data that would be certain beyond a limit (no counts,
no success, all readings below the limit of detection) keep what gives them a probability of α, too: of no counts
the shortest ends there as well, but it holds a value one σ above a limit of detection in 83 % only. The deviance has
grown by 3.84 at 1.92, where nothing is counted in 15 % of all cases.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.spreads import Freedom, Limited
from mbm.equations.types import Floats, Indices, Mask, Minimum
from mbm.estimation.coverage.certain import Certain, certain
from mbm.estimation.coverage.student import Law, coverage_factors, shortest
from mbm.estimation.coverage.within_limits import Profile, Quantities, QuantityProfile, quantities
from mbm.estimation.search.solution import DerivedSolution
from mbm.estimation.settings import Settings
from mbm.estimation.trust.nonlinearity import MOST_FOLLOWED, OF_LIKELIHOODS
from mbm.estimation.trust.unexamined import unfollowed
from mbm.estimation.uncertainty.derived import Propagation
from mbm.estimation.uncertainty.observability import limited, pinned_coordinates
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

AIMED_AT = 16.0
"""−log of that share that steps aim at: aimed at the least, they hit it, and rounding decides what follows."""

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Own:
    """The coordinates (n,) with their linear ``sigma`` and its ``freedom``, and the ``ends`` of intervals of a level.

    The ends, below and above, are NaN where they are linear.
    """

    ends: tuple[Floats, Floats]
    sigma: Floats
    freedom: Freedom
    level: float

    @property
    def linear(self) -> Floats:
        """How far linear intervals reach to both sides (n,)."""
        return coverage_factors(self.level, self.freedom.dof) * self.freedom.inflation * self.sigma

    def law(self, which: int, *, scaled: bool) -> Law:
        """That of one of them."""
        return Law(dof=float(self.freedom.dof[which]), inflation=float(self.freedom.inflation[which]), scaled=scaled)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Likelihood:
    """The likelihood about a ``minimum``, with the ``limits`` of its coordinates.

    ``pinned`` (n,) are those that limits hold; something is ``held`` where none is, too, as by a limit of several.
    ``variance`` is that of the residuals; one scale that is an unknown counts as in `Profiles` if it is ``scaled``.
    ``certain`` knows the probability of data that other values would make certain (None: none would).
    ``alone`` (n,) are standard deviations of coordinates if all others are known; ``derived`` gives the quantities that
    are looked at, by their numbers. Profiles are ``followed`` unless that would take too long, and not of
    coordinates (n,) that are free in combination with others, ``combined``.
    """

    equations: Assembled
    minimum: Minimum
    limits: Limited
    pinned: Mask
    held: bool
    variance: float
    scaled: bool
    certain: Certain | None
    alone: Floats
    combined: Mask
    settings: Settings
    followed: bool
    derived: Callable[[int], Quantities | None]

    def put_in(self, own: Own) -> None:
        """Put in the ends of coordinates that a limit cuts or without a sigma, and of those that reach farther where a
        limit that holds something lets go of it.
        """
        released = np.isfinite(self.limits.step) & (self.limits.sigma > 0.0)
        for which in np.flatnonzero(released).tolist():
            # of what a limit holds, what is between the limits is left of its distribution without them
            step, sigma = float(self.limits.step[which]), float(self.limits.sigma[which])
            own.ends[0][which], own.ends[1][which] = self._shortest(own, which, step, sigma)
        plain, cut = self.equations.layout.number[self.equations.free] >= 0, self._cut(own)
        # what is near a limit of normal errors has the linear interval up to it
        wanted = plain & ~released & (cut if self.equations.likely else self.pinned)
        others = plain & ~(wanted | released) & (own.sigma > 0.0) & self.held
        if not self.followed:
            return
        for which in [*np.flatnonzero(wanted).tolist(), *np.flatnonzero(others)[:MOST_FOLLOWED].tolist()]:
            profile = Profile(self.equations, self.minimum, which, self.variance, self.settings)
            law = own.law(which, scaled=self.scaled)
            limits = profile.value - self.limits.lower[which], self.limits.upper[which] - profile.value
            if wanted[which] or not _agrees(profile, law, own, which):
                asked = own.level, self._certain(np.array([which]))
                own.ends[0][which], own.ends[1][which] = _interval(profile, law, limits, float(own.sigma[which]), asked)

    def put_in_derived(self, owner: int, numbers: Own, own: Own) -> None:
        """The same of the ``numbers`` of a derived quantity, beside the coordinates of their ``own`` ends.

        A number that is made of one coordinate alone goes as far as that takes it. Nobody looks at one that equations
        make certain; one without a slope where several leave their limits at once has no interval.
        """
        found = self.derived(owner)
        if found is None:
            return
        cut, index = self._cut(own), self.equations.layout.number[self.equations.free]
        reached: dict[int, tuple[Floats, Floats]] = {}
        followed = 0
        for place in np.flatnonzero(np.isfinite(found.values)).tolist():
            touched = found.touched(place)
            if not len(touched) or not (self.held or bool(cut[touched].any())):
                continue
            if np.isnan(numbers.sigma[place]) and bool(self.combined[touched].any()):
                continue
            which = int(touched[0])
            if len(touched) == 1 and index[which] >= 0:
                if which not in reached and (cut[which] or not np.isnan(own.ends[0][which])):
                    reached[which] = found.reach(int(index[which]), *self._whole(own, which))
                if which in reached:
                    for end, far in zip(numbers.ends, reached[which], strict=True):
                        end[place] = far[place]
            elif self.followed and followed < MOST_FOLLOWED and numbers.sigma[place] != 0.0:
                if not found.felt(place, self.equations, self.alone):
                    continue
                followed += 1
                told = bool(numbers.sigma[place] > 0.0)
                fewest = int(touched[own.freedom.dof[touched].argmin()])
                law = numbers.law(place, scaled=self.scaled) if told else own.law(fewest, scaled=self.scaled)
                profile = QuantityProfile(self.equations, self.minimum, (found, place), self.variance, self.settings)
                alone = float(np.linalg.norm(found.gradient[place] * self.alone))
                if not told or not _agrees(profile, law, numbers, place):
                    first = float(numbers.sigma[place]) if told else alone
                    ends = _interval(profile, law, (np.inf, np.inf), first, (own.level, self._certain(touched)))
                    numbers.ends[0][place], numbers.ends[1][place] = ends

    def _certain(self, coordinates: Indices) -> float:
        return np.nan if self.certain is None else self.certain.of(coordinates)

    def _cut(self, own: Own) -> Mask:
        """Coordinates (n,) that limits hold or are near to, and those without a sigma."""
        places = self.equations.coordinates(self.minimum.point)
        below, above = (np.where(np.isnan(each), own.linear, each) for each in own.ends)
        near = (places - below < self.limits.lower) | (places + above > self.limits.upper)
        return np.asarray(self.pinned | near | (np.isnan(own.sigma) & ~self.combined))

    def _whole(self, own: Own, which: int) -> tuple[float, float]:
        """How far the interval of a coordinate reaches, as it is stated."""
        if np.isnan(own.ends[0][which]):
            return self._shortest(own, which, 0.0, float(own.sigma[which]))
        return float(own.ends[0][which]), float(own.ends[1][which])

    def _shortest(self, own: Own, which: int, step: float, sigma: float) -> tuple[float, float]:
        """How far the shortest interval of a linear distribution between the limits reaches, which begins with a step
        from the estimate.
        """
        scale = sigma * float(own.freedom.inflation[which])
        place = float(self.equations.coordinates(self.minimum.point)[which])
        limits = [float(each[which]) - place for each in (self.limits.lower, self.limits.upper)]
        down, up = ((limit - step) / scale for limit in limits)
        low, high = shortest(down, up, own.level, float(own.freedom.dof[which]))
        # Up to a limit, the end is the limit itself, not what is left of it by a step there and back.
        return -(limits[0] if low == down else step + low * scale), limits[1] if high == up else step + high * scale


def _agrees(profile: Profile, law: Law, own: Own, which: int) -> bool:
    """Whether the ends that a number has, or the linear ones, are those of its profile."""
    linear = float(own.linear[which])
    below, above = (linear if np.isnan(each[which]) else float(each[which]) for each in own.ends)
    reached = law.of_square(float(coverage_factors(own.level, np.array([law.dof]))[0]) ** 2)
    there = (law.surprise(profile.growth(step)) for step in (-below, above))
    return all(abs(np.sqrt(each / reached) - 1.0) <= OF_LIKELIHOODS for each in there)


@np.errstate(all="ignore")
def likelihood(
    propagation: Propagation,
    minimum: Minimum,
    limits: Limited | None,
    derived: tuple[DerivedSolution, ...],
    settings: Settings,
) -> Likelihood | None:
    """What finds such intervals; None where nothing is cut, or nothing is known of the likelihood."""
    outcome = propagation.outcome
    equations = outcome.influence.equations
    observed, count = outcome.observed, equations.dimension
    followed = unfollowed(equations, minimum) is None
    if not followed and (limits is None or not np.isfinite(limits.step).any()):
        return None
    if not minimum.feasible or not minimum.reason.converged:
        return None
    if not (equations.likely or limited(observed)) or not outcome.sigma_known or not outcome.covariance.variance > 0.0:
        return None
    if limits is None:
        none = np.full(count, np.nan)
        limits = Limited(lower=np.full(count, -np.inf), upper=np.full(count, np.inf), step=none, sigma=none)
    by_owner = {one.owner: one for one in derived}
    return Likelihood(
        equations=equations,
        minimum=minimum,
        limits=limits,
        pinned=np.asarray(~np.isnan(limits.step) | pinned_coordinates(observed)),
        held=limited(observed),
        variance=outcome.covariance.variance,
        scaled=outcome.freedoms.scaled,
        certain=certain(equations, minimum) if equations.likely else None,
        alone=np.sqrt(outcome.covariance.variance) / observed.scale,
        combined=~observed.estimable & (np.square(minimum.jacobian).sum(axis=0) > 0.0) & (minimum.at_bound == 0),
        settings=settings,
        followed=followed,
        derived=lambda owner: quantities(propagation, by_owner[owner], minimum.point),
    )


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
    profile: Profile, law: Law, limits: tuple[float, float], sigma: float, asked: tuple[float, float]
) -> tuple[float, float]:
    """How far the interval reaches below and above; NaN where the likelihood tells nothing.

    ``asked`` are its level, and −log of the probability of data that would be certain elsewhere.
    """
    below, above = _sides(profile, law, limits, sigma)
    level, certain = asked
    one_sided = min(len(below.places), len(above.places)) == 1
    least = max(-float(np.log1p(-level)) - certain, 0.0) if one_sided and not np.isnan(certain) else 0.0
    if below.endless or above.endless:
        flat = any(each.endless and each.surprise[-1] < PLATEAU for each in (below, above))
        factor = coverage_factors(level, np.array([law.dof]))[0]
        most = max(law.of_square(float(-2.0 * np.log1p(-level) if flat else factor**2)), least)
        ends = below.end(most), above.end(most)
        return (np.nan, np.nan) if np.isinf(ends).all() else ends
    shares = below.shares(), above.shares()
    wanted = level * float(shares[0][-1] + shares[1][-1])
    low, high = 0.0, MOST_LOOKED_AT
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        held = sum(np.interp(s.end(middle), s.places, share) for s, share in zip((below, above), shares, strict=True))
        low, high = (middle, high) if held < wanted else (low, middle)
    most = max(high, least)
    return below.end(most), above.end(most)


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
            step = min(inside * min(LONGEST, max(2.0, AIMED_AT / max(found, PLATEAU))), limit)
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
