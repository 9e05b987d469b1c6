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
from mbm.equations.spreads import Freedom, Limited, Moved
from mbm.equations.types import Covariance, Floats, Indices, Mask, Minimum, Observability, Reason
from mbm.estimation.coverage.certain import Certain, certain
from mbm.estimation.coverage.limits import Edges, edges
from mbm.estimation.coverage.parabolas import Parabolas, Pieces, parabolas
from mbm.estimation.coverage.quantities import Coordinates, Quantities, quantities
from mbm.estimation.coverage.shares import Followed, grown_enough, share_between, sides
from mbm.estimation.coverage.within_limits import Profile, QuantityProfile
from mbm.estimation.search.solution import DerivedSolution
from mbm.estimation.settings import Settings
from mbm.estimation.trust.curvature import directions
from mbm.estimation.trust.nonlinearity import MOST_FOLLOWED, OF_LIKELIHOODS
from mbm.estimation.trust.unexamined import unfollowed
from mbm.estimation.uncertainty.derived import Propagation
from mbm.estimation.uncertainty.observability import limited, pinned_coordinates
from mbm.estimation.uncertainty.student import Law, coverage_factors, shortest
from mbm.values import dataclass

END_AT = 1e-9
"""Share of an interval by which its end may differ from a limit that it ends at."""

OF_SUMS = 1e-3
"""Share by which the end of a linear interval may be off where it takes nothing to find the right one."""

MORE_WAYS = 64
"""Random directions from the estimates in which what bends is looked at, too."""

ROUNDED_MOVES = 1e-3
"""Share of what a constant does that is no part of its own: differences of solves are right to ten thousandths."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Own:
    """The coordinates (n,) with their linear ``sigma`` and its ``freedom``, and the ``ends`` of intervals of a level.

    The ends, below and above, are NaN where they are linear.
    """

    ends: tuple[Floats, Floats]
    sigma: Floats
    freedom: Freedom
    level: float

    def beside(self, moves: Floats, dof: Floats) -> Own:
        """The same with uncertain constants that move them by ``moves`` (m, n), known by ``dof`` (m,)."""
        parts = np.square(moves)
        sigma = np.sqrt(np.square(self.sigma) + parts.sum(axis=0))
        return replace(self, sigma=sigma, freedom=self.freedom.beside(self.sigma, parts, dof))

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
    are looked at, by their numbers. ``edges`` are limits of several coordinates, ``linear`` has the profiles where all
    is linear (None: it is not); ``leaving`` (n, q) are steps in the directions that limits take away. Profiles are
    ``followed`` unless that would take too long, and not of coordinates (n,) that are free in combination with others,
    ``combined``. What uncertain constants do is in ``moved``.
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
    leaving: Floats
    moved: Moved

    @property
    def decisive(self) -> bool:
        """Whether the likelihood has a say in all intervals, not of what is derived near a limit alone."""
        return self.followed and (self.held or self.equations.likely)

    def free_steps(self) -> Floats:
        """The steps (n,) to where the coordinates would be without the limits that hold them; NaN: not known."""
        return self.limits.alone if self.linear is None else self.linear.free_steps

    def put_in(self, own: Own) -> None:
        """Put in the ends of coordinates that a limit cuts or without a sigma, and of those that reach farther where a
        limit that holds something lets go of it.
        """
        moved = self.moved
        released = np.isfinite(self.limits.step) & (self.limits.sigma > 0.0)
        if self.followed and (len(moved.dof) or self.linear is not None):
            # constants move each of them as it is without all limits, and others may meet or leave theirs, too
            released &= ~self.edges.beside()
        alone = replace(own, sigma=self.limits.sigma).beside(moved.free, moved.dof)
        for which in np.flatnonzero(released).tolist():
            # of what a limit holds, what is between the limits is left of its distribution without them
            own.ends[0][which], own.ends[1][which] = self._shortest(alone, which, float(self.limits.step[which]))
        wide, places = own.beside(moved.coordinates, moved.dof), self.equations.coordinates(self.minimum.point)
        lower, upper = self.limits.lower - places, self.limits.upper - places
        plain, cut = self.equations.layout.number[self.equations.free] >= 0, self._cut(wide)
        # what is near a limit of normal errors has the linear interval up to it
        wanted = plain & ~released & (cut if self.equations.likely else self.pinned)
        passed = self._knows_limits() and self.edges.passed(np.eye(len(plain)), own.linear, own=False)
        others = plain & ~(wanted | released) & (own.sigma > 0.0) & (self.held | passed)
        if not self.followed:
            return
        for which in [*np.flatnonzero(wanted).tolist(), *np.flatnonzero(others)[:MOST_FOLLOWED].tolist()]:
            gradient, direct = np.eye(len(plain))[which], np.zeros(len(moved.dof))
            law = own.law(which, scaled=self.scaled)
            spread = float(self.alone[which]) if self.linear is None else self.linear.spread(gradient)
            law = self._law(law, spread, moved.free @ gradient)
            pieces = self._pieces(gradient, direct, places[which], law)
            profile: Followed = pieces or self._profile(which, direct, law)
            if wanted[which] or not _agrees(profile, law, wide, which):
                limits = [far - profile.centre for far in (lower[which], upper[which])]
                two = pieces.sides(law) if pieces else sides(profile, law, (-limits[0], limits[1]), wide.sigma[which])
                below, above = share_between(*two, law, own.level, self._certain(np.array([which])))
                own.ends[0][which], own.ends[1][which] = below - profile.centre, above + profile.centre

    def put_in_derived(self, owner: int, numbers: Own, own: Own) -> None:
        """The same of the ``numbers`` of a derived quantity, beside the coordinates of their ``own`` ends.

        A number that is made of one coordinate alone goes as far as that takes it. Nobody looks at one that equations
        make certain; one without a slope where several leave their limits at once has no interval.
        """
        moved = self.moved
        every, wide = own.beside(moved.coordinates, moved.dof), numbers.beside(moved.own, moved.dof)
        cut = self._cut(every)
        index = self.equations.layout.number[self.equations.free]
        found = self.derived(owner) if self.held or len(self.edges.room) or cut.any() else None
        if found is None:
            return
        passed = self.edges.passed(found.gradient, numbers.linear, own=True)
        direct, alone = self._direct(found)
        reached: dict[int, tuple[Floats, Floats]] = {}
        followed = 0
        for place in np.flatnonzero(np.isfinite(found.values)).tolist():
            touched = found.touched(place)
            single = len(touched) == 1 and bool(alone[:, place].all()) and index[touched[0]] >= 0
            if not len(touched) or not (self.held or single or (self._knows_limits() and bool(passed[place]))):
                continue
            if np.isnan(numbers.sigma[place]) and bool(self.combined[touched].any()):
                continue
            which = int(touched[0])
            if single:
                told = bool(own.sigma[which] > 0.0) and bool(cut[which])
                if which not in reached and (told or not np.isnan(own.ends[0][which])):
                    reached[which] = found.reach(int(index[which]), *self._whole(every, which))
                if which in reached:
                    for end, far in zip(numbers.ends, reached[which], strict=True):
                        end[place] = far[place]
            elif self.followed and followed < MOST_FOLLOWED and wide.sigma[place] != 0.0:
                felt, told = found.felt(place, self.equations, self.alone), bool(numbers.sigma[place] > 0.0)
                paths = [] if felt and found.straight else found.paths(place, self.equations, self.leaving)
                lost = not felt and (not paths or self.leaving.shape[1] != 1)
                if lost or found.beyond_all(place, paths):
                    continue
                fewest = int(touched[own.freedom.dof[touched].argmin()])
                law = numbers.law(place, scaled=self.scaled) if told else own.law(fewest, scaled=self.scaled)
                gradient, first = found.gradient[place], float(wide.sigma[place])
                if not first > 0.0:
                    first = float(np.linalg.norm(gradient * self.alone)) if felt else min(map(abs, paths[0]))
                spread = first if self.linear is None else self.linear.spread(gradient)
                law = self._law(law, spread, direct[:, place] + moved.free @ gradient)
                pieces = (
                    self._pieces(gradient, direct[:, place], float(found.values[place]), law)
                    if found.straight
                    else None
                )
                own_moves = np.where(alone[:, place], 0.0, direct[:, place]) / law.inflation
                profile = pieces or QuantityProfile(
                    self.equations,
                    self.minimum,
                    (found, place),
                    (moved.free / law.inflation, own_moves),
                    self.variance,
                    self.settings,
                    paths,
                )
                followed += pieces is None
                if told and _agrees(profile, law, wide, place):
                    continue
                if isinstance(profile, Pieces) or found.straight or not np.isnan(self._certain(touched)):
                    two = pieces.sides(law) if pieces else sides(profile, law, (np.inf, np.inf), first)
                    below, above = share_between(*two, law, own.level, self._certain(touched))
                else:
                    below, above = self._grown((found, place), profile, law, own.level, first)
                numbers.ends[0][place], numbers.ends[1][place] = below - profile.centre, above + profile.centre

    def _grown(
        self, which: tuple[Quantities, int], profile: QuantityProfile, law: Law, level: float, first: float
    ) -> tuple[float, float]:
        """How far the cost stays low enough for a level below and above, also behind places where it does not."""
        ends = grown_enough(profile, law, level, first, (0.0, 0.0))
        most = law.of_square(float(coverage_factors(level, np.array([law.dof]))[0]) ** 2)

        def inside(point: Floats) -> bool:
            residuals = self.equations.residuals(point)
            return law.surprise((float(residuals @ residuals) - self.minimum.cost) / self.variance) <= most

        size = self.edges.factor.shape[1]
        all_over = np.random.default_rng(1).standard_normal((MORE_WAYS, size))
        ways = np.vstack([directions(size), all_over / np.linalg.norm(all_over, axis=1, keepdims=True)])
        steps = self.edges.factor @ ways.T
        behind = which[0].behind(which[1], self.equations, steps, ends, inside)
        if behind:
            profile = profile.begun_at(behind)
            ends = grown_enough(profile, law, level, first, (-min(0.0, *behind), max(0.0, *behind)))
        endless = which[0].endless(which[1], self.equations, steps, profile.reached(), inside)
        return np.inf if endless[0] else ends[0], np.inf if endless[1] else ends[1]

    @np.errstate(all="ignore")
    def _direct(self, found: Quantities) -> tuple[Floats, Mask]:
        """What constants do to numbers themselves (m, k), and where that is nothing."""
        moved, slopes = self.moved, found.gradient.T
        direct = moved.own - moved.coordinates @ slopes
        # a number at its limit does not move at all: what is its own of that is rounding
        whole = np.abs(moved.own) + np.abs(moved.free) @ np.abs(slopes)
        return direct, np.asarray(np.abs(direct) <= ROUNDED_MOVES * whole)

    def _knows_limits(self) -> bool:
        """Whether the profile is known of what only meets a limit on its way, beside uncertain constants, too."""
        return self.linear is not None or not len(self.moved.dof)

    def _profile(self, which: int, direct: Floats, law: Law) -> Profile:
        """That of a coordinate."""
        if not len(direct):
            return Profile(self.equations, self.minimum, which, self.variance, self.settings)
        numbers = self.equations.layout.number[self.equations.free]
        one = Coordinates(numbers=numbers, values=self.minimum.point[numbers]), which
        moves = self.moved.free / law.inflation, direct
        return QuantityProfile(self.equations, self.minimum, one, moves, self.variance, self.settings)

    def _law(self, law: Law, spread: float, moves: Floats) -> Law:
        """The same beside constants, which move by ``moves`` (m,) what else has the standard deviation ``spread``."""
        freedom = Freedom(dof=np.array(law.dof), inflation=np.array(law.inflation))
        return replace(law, dof=float(freedom.beside(np.array(spread), np.square(moves), self.moved.dof).dof))

    def _pieces(self, gradient: Floats, direct: Floats, value: float, law: Law) -> Pieces | None:
        """The profile of what has a gradient (n,) everywhere, and is moved ``direct``ly (m,) by constants, in closed
        form; None: it has none.
        """
        if self.linear is None:
            return None
        linear = self.linear.beside(self.moved.free / law.inflation)
        return linear.along(gradient, direct / law.inflation, value, law)

    def _certain(self, coordinates: Indices) -> float:
        return np.nan if self.certain is None else self.certain.of(coordinates)

    @np.errstate(all="ignore")
    def _cut(self, own: Own) -> Mask:
        """Coordinates (n,) that limits hold or are near to, and those without a sigma."""
        places = self.equations.coordinates(self.minimum.point)
        below, above = (np.where(np.isnan(each), own.linear, each) for each in own.ends)
        rounding = END_AT * (below + above)
        near = (places - below < self.limits.lower + rounding) | (places + above > self.limits.upper - rounding)
        return np.asarray(self.pinned | near | (np.isnan(own.sigma) & ~self.combined))

    def _whole(self, own: Own, which: int) -> tuple[float, float]:
        """How far the interval of a coordinate reaches, as it is stated."""
        if np.isnan(own.ends[0][which]):
            return self._shortest(own, which, 0.0)
        return float(own.ends[0][which]), float(own.ends[1][which])

    def _shortest(self, own: Own, which: int, step: float) -> tuple[float, float]:
        """How far the shortest interval of a linear distribution between the limits reaches, which begins with a step
        from the estimate.
        """
        scale = float(own.sigma[which] * own.freedom.inflation[which])
        place = float(self.equations.coordinates(self.minimum.point)[which])
        limits = [float(each[which]) - place for each in (self.limits.lower, self.limits.upper)]
        down, up = ((limit - step) / scale for limit in limits)
        low, high = shortest(down, up, own.level, float(own.freedom.dof[which]))
        # Up to a limit, the end is the limit itself, not what is left of it by a step there and back.
        return -(limits[0] if low == down else step + low * scale), limits[1] if high == up else step + high * scale


def _agrees(profile: Followed, law: Law, own: Own, which: int) -> bool:
    """Whether the ends that a number has, or the linear ones, are those of its profile."""
    share = OF_LIKELIHOODS if isinstance(profile, Profile) else OF_SUMS
    linear = float(own.linear[which])
    below, above = (linear if np.isnan(each[which]) else float(each[which]) for each in own.ends)
    reached = law.of_square(float(coverage_factors(own.level, np.array([law.dof]))[0]) ** 2)
    there = (law.surprise(profile.growth(step)) for step in (-below, above))
    return all(abs(np.sqrt(each / reached) - 1.0) <= share for each in there)


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
    if not minimum.feasible or not (minimum.reason.converged or minimum.reason is Reason.ENDLESS):
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
        leaving=_leaving(observed, minimum, outcome.covariance),
        edges=edges(equations, minimum, limits, outcome.covariance.factor),
        moved=Moved(coordinates=np.zeros((0, count)), free=np.zeros((0, count)), own=np.zeros((0, 1)), dof=np.zeros(0)),
    )


def _leaving(observed: Observability, minimum: Minimum, covariance: Covariance) -> Floats:
    """Steps (n, q) of about a standard deviation each in the directions that limits take away; all else follows."""
    space = np.eye(len(observed.fixed))[:, observed.fixed]
    steps = (space if observed.limited_space is None else observed.limited_space) / observed.scale[:, None]
    if steps.shape[1] and minimum.blocks is None and bool(np.isfinite(covariance.factor).all()):
        image = minimum.jacobian @ covariance.factor
        steps = steps - covariance.factor @ np.linalg.lstsq(image, minimum.jacobian @ steps)[0]
        steps = steps / np.sqrt(np.square(minimum.jacobian @ steps).sum(axis=0))
    return np.asarray(steps * np.sqrt(covariance.variance))
