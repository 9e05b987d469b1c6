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
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.spreads import Freedom, Limited
from mbm.equations.types import Floats, Indices, Mask, Minimum
from mbm.estimation.coverage.certain import Certain, certain
from mbm.estimation.coverage.parabolas import Parabolas, Pieces, parabolas
from mbm.estimation.coverage.shares import Followed, grown_enough, share_between, sides
from mbm.estimation.coverage.within_limits import Profile, Quantities, QuantityProfile, quantities
from mbm.estimation.search.solution import DerivedSolution
from mbm.estimation.settings import Settings
from mbm.estimation.trust.nonlinearity import MOST_FOLLOWED, OF_LIKELIHOODS
from mbm.estimation.trust.unexamined import unfollowed
from mbm.estimation.uncertainty.derived import Propagation
from mbm.estimation.uncertainty.observability import limited, pinned_coordinates
from mbm.estimation.uncertainty.student import Law, coverage_factors, shortest
from mbm.values import dataclass


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


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Inequalities ``room`` (c,) away from the estimates, with ``slopes`` (c, n), and the ``sigma`` (c,) of them."""

    room: Floats
    slopes: Floats
    sigma: Floats

    def near(self, level: float, freedom: Freedom) -> Mask:
        """Coordinates (n,) that meet one of them within their intervals."""
        factors = coverage_factors(level, freedom.dof) * freedom.inflation
        met = self.room[:, None] < self.sigma[:, None] * factors
        return np.asarray((met & (self.slopes != 0.0)).any(axis=0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Likelihood:
    """The likelihood about a ``minimum``, with the ``limits`` of its coordinates.

    ``pinned`` (n,) are those that limits hold; something is ``held`` where none is, too, as by a limit of several.
    ``variance`` is that of the residuals; one scale that is an unknown counts as in `Profiles` if it is ``scaled``.
    ``certain`` knows the probability of data that other values would make certain (None: none would).
    ``alone`` (n,) are standard deviations of coordinates if all others are known; ``derived`` gives the quantities that
    are looked at, by their numbers. ``edges`` are limits of several coordinates, ``linear`` has the profiles where all
    is linear (None: it is not). Profiles are ``followed`` unless that would take too long, and not of coordinates (n,)
    that are free in combination with others, ``combined``. Variances ``added`` (n,) are those of `widened`.
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
    linear: Parabolas | None
    edges: Edges
    added: Floats

    @property
    def decisive(self) -> bool:
        """Whether the likelihood has a say in all intervals, not of what is derived near a limit alone."""
        return self.followed and (self.held or self.equations.likely)

    def widened(self, added: Floats) -> Likelihood:
        """The same with variances ``added`` (n,) to those of coordinates without the limits that hold them."""
        limits = replace(self.limits, sigma=np.hypot(self.limits.sigma, np.sqrt(added)))
        return replace(self, limits=limits, added=added)

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
            pieces = self._pieces(np.eye(len(plain))[which], profile.value, law)
            if wanted[which] or not _agrees(pieces or profile, law, own, which):
                two = pieces.sides(law) if pieces else sides(profile, law, limits, float(own.sigma[which]))
                ends = share_between(*two, law, own.level, self._certain(np.array([which])))
                own.ends[0][which], own.ends[1][which] = ends

    def put_in_derived(self, owner: int, numbers: Own, own: Own) -> None:
        """The same of the ``numbers`` of a derived quantity, beside the coordinates of their ``own`` ends.

        A number that is made of one coordinate alone goes as far as that takes it. Nobody looks at one that equations
        make certain; one without a slope where several leave their limits at once has no interval.
        """
        cut = self._cut(own) | self.edges.near(own.level, own.freedom)
        index = self.equations.layout.number[self.equations.free]
        found = self.derived(owner) if self.held or cut.any() else None
        if found is None:
            return
        reached: dict[int, tuple[Floats, Floats]] = {}
        followed = 0
        for place in np.flatnonzero(np.isfinite(found.values)).tolist():
            touched = found.touched(place)
            if not len(touched) or not (self.held or (bool(cut[touched].any()) and self._cuts(found, touched))):
                continue
            if np.isnan(numbers.sigma[place]) and bool(self.combined[touched].any()):
                continue
            which = int(touched[0])
            if len(touched) == 1 and index[which] >= 0:
                told = bool(own.sigma[which] > 0.0) and bool(cut[which])
                if which not in reached and (told or not np.isnan(own.ends[0][which])):
                    reached[which] = found.reach(int(index[which]), *self._whole(own, which))
                if which in reached:
                    for end, far in zip(numbers.ends, reached[which], strict=True):
                        end[place] = far[place]
            elif self.followed and followed < MOST_FOLLOWED and numbers.sigma[place] != 0.0:
                if not found.felt(place, self.equations, self.alone):
                    continue
                told = bool(numbers.sigma[place] > 0.0)
                fewest = int(touched[own.freedom.dof[touched].argmin()])
                law = numbers.law(place, scaled=self.scaled) if told else own.law(fewest, scaled=self.scaled)
                profile: Followed = QuantityProfile(
                    self.equations, self.minimum, (found, place), self.variance, self.settings
                )
                pieces = self._pieces(found.gradient[place], profile.value, law) if found.straight else None
                followed += pieces is None
                if told and _agrees(pieces or profile, law, numbers, place):
                    continue
                first = numbers.sigma[place] if told else np.linalg.norm(found.gradient[place] * self.alone)
                if found.straight or self.equations.likely:
                    two = pieces.sides(law) if pieces else sides(profile, law, (np.inf, np.inf), float(first))
                    ends = share_between(*two, law, own.level, self._certain(touched))
                else:
                    ends = grown_enough(profile, law, own.level, float(first))
                numbers.ends[0][place], numbers.ends[1][place] = ends

    def _cuts(self, found: Quantities, touched: Indices) -> bool:
        """Whether a limit that nothing is held by cuts what is made of coordinates: where the profile is known, and no
        uncertain constant has a part in it.
        """
        return not self.added.any() and (found.straight or len(touched) == 1)

    def _pieces(self, gradient: Floats, value: float, law: Law) -> Pieces | None:
        """The profile of what has a gradient (n,) everywhere, in closed form; None: it has none."""
        return None if self.linear is None else self.linear.along(gradient, value, law)

    def _certain(self, coordinates: Indices) -> float:
        return np.nan if self.certain is None else self.certain.of(coordinates)

    @np.errstate(all="ignore")
    def _cut(self, own: Own) -> Mask:
        """Coordinates (n,) that limits hold or are near to, and those without a sigma."""
        places = self.equations.coordinates(self.minimum.point)
        linear = own.linear * np.sqrt(1.0 + np.nan_to_num(self.added / np.square(own.sigma)))
        below, above = (np.where(np.isnan(each), linear, each) for each in own.ends)
        near = (places - below < self.limits.lower) | (places + above > self.limits.upper)
        return np.asarray(self.pinned | near | (np.isnan(own.sigma) & ~self.combined))

    def _whole(self, own: Own, which: int) -> tuple[float, float]:
        """How far the interval of a coordinate reaches, as it is stated."""
        if np.isnan(own.ends[0][which]):
            return self._shortest(own, which, 0.0, float(np.hypot(own.sigma[which], np.sqrt(self.added[which]))))
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


def _agrees(profile: Followed, law: Law, own: Own, which: int) -> bool:
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
    if not (followed or limits is not None):
        return None
    if not minimum.feasible or not minimum.reason.converged:
        return None
    if not outcome.sigma_known or not outcome.covariance.variance > 0.0:
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
        linear=parabolas(equations, minimum, outcome.covariance.variance) if followed else None,
        edges=_edges(equations, minimum, outcome.covariance.factor),
        added=np.zeros(count),
    )


def _edges(equations: Assembled, minimum: Minimum, factor: Floats) -> Edges:
    """The inequalities at a minimum, as far as its covariance is known."""
    state = minimum.constraints
    if state is None or minimum.blocks is not None:
        return Edges(np.zeros(0), np.zeros((0, equations.dimension)), np.zeros(0))
    limits = ~state.equality
    slopes = np.asarray(state.slopes)[limits]
    return Edges(-state.values[limits], slopes, np.sqrt(np.square(slopes @ factor).sum(axis=1)))
