"""Intervals of what bends with uncertain constants, or follows one whose law is not normal, after GUM Supplement 1.

Where some solves with all constants moved together are not what the derivatives promise, the problem is solved at
points all over the laws of the constants. Cubic radial basis functions go through what is found there (Powell 1992),
and hold between these points, never beyond; variates of all laws then give the distribution of the number, whose
quantiles are the interval.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from math import erf, inf, sqrt
from typing import TypeVar

import numpy as np

from mbm.equations.faults import too_nonlinear
from mbm.equations.types import Indices, Mask
from mbm.estimation.starts.random_starts import sobol
from mbm.estimation.trust.nonlinearity import TOLERATED
from mbm.estimation.trust.plausibility import reaches, still
from mbm.estimation.uncertainty.student import coverage_factor, coverage_factors
from mbm.problem.overrides import NORMAL_LAW, Law
from mbm.report.elements import difference, element_names
from mbm.report.spreads import Floats
from mbm.report.types import DerivedValue, Estimate, Examined, Result, SolveReport
from mbm.simulation.noise import standard_variates
from mbm.text.types import Diagnostic, Span
from mbm.values import dataclass, replace

Item = TypeVar("Item", Estimate, DerivedValue)

Solved = Callable[[Floats], Result | None]
"""The problem solved again with all constants moved by so many standard deviations (n,); None: it cannot be."""

BENT = 0.2
"""How far solves may be from what derivatives promise, in standard deviations of the number: it is a tenth of what
intervals of 95 % reach."""

BENT_BY_ROUNDING = 1e-9
"""The same, as a share of the number, that may be a rounding."""

KURTOSIS = 0.3
"""Excess of the kurtosis of a number from which the laws of its constants count: a rectangular one that has half of the
variance makes it so much flatter than normal."""

VARIATES = 16384
"""Of the Latin hypercube: quantiles are off by some thousandths of a standard deviation."""

DRAWN = 2**17
"""Variates by which the quantiles of a law are found."""

SOLVES = 128
"""Points at which what bends is looked at: ends of products of three constants at zero, and of norms of six, are off by
no more than 4 % of the interval's width; with twice as many by 2 %."""

WIDER = 1.3
"""How much wider than the constants these points are spread, as normal deviates: to 3.4 standard deviations."""

FAILED = 0.05
"""Share of these points at which nothing may be found: they are spread wider than the constants."""

GOLDEN = 0.6180339887498949
"""By whose multiples steps differ that are made together, so that pairs do not cancel, as those of (a − c) b would."""


@lru_cache(maxsize=32)
def quantiles(law: Law) -> Floats:
    """Those of a law of mean 0 and standard deviation 1 at the middles of `VARIATES` shares."""
    drawn = standard_variates(law, np.random.default_rng(1), (DRAWN,))
    return np.asarray(np.quantile(drawn, (np.arange(VARIATES) + 0.5) / VARIATES))


@lru_cache(maxsize=1024)
def _variates(law: Law, place: int) -> Floats:
    """The quantiles in an order of their own for each ``place``."""
    return np.asarray(np.random.default_rng(place).permutation(quantiles(law)))


def _steps(laws: Sequence[Law], deviates: Floats) -> Floats:
    """Steps of constants in standard deviations (k, n), at the shares of their laws that normal ``deviates`` have."""
    shares = np.vectorize(lambda each: 0.5 * (1.0 + erf(each / sqrt(2.0))), otypes=[np.float64])(deviates)
    middles = (np.arange(VARIATES) + 0.5) / VARIATES
    return np.stack([np.interp(shares[:, j], middles, quantiles(law)) for j, law in enumerate(laws)], axis=1)


def _looks(laws: Sequence[Law]) -> Floats:
    """Four steps of all constants together (4, n), two and their opposites, about as far out as the 95 % are."""
    count = len(laws)
    turns = GOLDEN * np.arange(1, 2 * count + 1).reshape(2, count) % 1.0
    signs = np.random.default_rng(1).choice([-1.0, 1.0], (2, count))
    deviates = signs * (0.5 + turns) * (1.0 + 1.0 / sqrt(count))
    return _steps(laws, np.concatenate([deviates, -deviates]))


def _points(laws: Sequence[Law]) -> Floats:
    """The points all over the laws (N, n), more than the coefficients of a plane."""
    count = len(laws)
    grid = (np.arange(VARIATES) + 0.5) / VARIATES
    shares = sobol(max(SOLVES, 2 * (count + 1)), count, 1)
    return _steps(laws, WIDER * np.interp(shares, grid, quantiles(NORMAL_LAW)))


def _interpolation(points: Floats, wanted: Floats) -> Floats:
    """What leads from values at ``points`` (N, n) to those at ``wanted`` (V, n), within the box of these: (V, N)."""

    def functions(at: Floats) -> Floats:
        squares = np.square(at).sum(axis=1)[:, None] + np.square(points).sum(axis=1) - 2.0 * at @ points.T
        return np.hstack([np.maximum(squares, 0.0) ** 1.5, np.ones((len(at), 1)), at])

    count, width = points.shape
    system = np.zeros((count + width + 1, count + width + 1))
    system[:count] = functions(points)
    system[count:, :count] = system[:count, count:].T
    inside = np.clip(wanted, points.min(axis=0), points.max(axis=0))
    return np.asarray(np.linalg.solve(system, functions(inside).T)[:count].T)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Responses:
    """Of P numbers to n constants: derivatives ``slopes`` (n, P) along their standard deviations; at ``points`` (N, n)
    the changes ``found`` (N, P), NaN where there are none. ``dof`` (n,) are those of the constants.
    """

    slopes: Floats
    points: Floats
    found: Floats
    laws: Sequence[Law]
    dof: Floats

    def known(self) -> Mask:
        """Which numbers (P,) are found at most of the points."""
        return np.asarray(np.isfinite(self.found).sum(axis=0) > (1.0 - FAILED) * max(len(self.points), 1))

    def abnormal(self, places: Indices, sigma: Floats) -> Mask:
        """Which numbers, with standard deviations (k,), are not normal for the laws of their constants."""
        excess = np.array([0.0 if law == NORMAL_LAW else np.mean(quantiles(law) ** 4) - 3.0 for law in self.laws])
        return np.asarray(np.abs(excess) @ self.slopes[:, places] ** 4 > KURTOSIS * sigma**4)

    def ends(self, places: Indices, curved: Mask, level: float, reach: Floats) -> Floats:
        """How far intervals of numbers (k,) reach below and above (2, k), to whose own part ``reach`` (2, k) belongs.

        Those that are ``curved`` (k,) follow what was found, the others their derivatives.
        """
        normal, middle = coverage_factor(level, inf), (1.0 - level) / 2.0
        own = _variates(NORMAL_LAW, len(self.laws))
        factors = coverage_factors(level, self.dof) / normal
        steps = np.stack([_variates(law, j) * factors[j] for j, law in enumerate(self.laws)], axis=1)
        weights: dict[bytes, Floats] = {}
        ends = np.empty((2, len(places)))
        for k, place in enumerate(places.tolist()):
            if curved[k]:
                there = np.isfinite(self.found[:, place])
                key = there.tobytes()
                if key not in weights:
                    weights[key] = _interpolation(self.points[there], steps)
                known = self.found[there, place]
                total = np.clip(weights[key] @ known, known.min(), known.max())
            else:
                total = steps @ self.slopes[:, place]
            total = total + own * np.where(own < 0.0, reach[0, k], reach[1, k]) / normal
            low, high = np.quantile(total, (middle, 1.0 - middle))
            ends[:, k] = -low, high
        return ends


def with_bends(linear: Result, result: Result, solved: Solved, spans: Mapping[str, Span]) -> Result:
    """The ``linear`` answer with intervals that mind how numbers bend with constants, and doubts where they do.

    ``result`` is that with exact constants; doubts are said at the ``spans`` of what they speak of.
    """
    places = [i for i, solve in enumerate(linear.solves) if solve.considered]
    if not places:
        return linear
    constants = linear.solves[places[0]].considered
    laws, dof = [each.law for each in constants], np.array([each.dof for each in constants])

    stopped = {i: np.zeros(len(_limit(linear.solves[i])), dtype=bool) for i in places}

    def changes(points: Floats) -> dict[int, Floats]:
        there = [solved(point) for point in points]
        for i in places:
            if any(each is not None and _at_limits(each.solves[i]) != _at_limits(result.solves[i]) for each in there):
                stopped[i] |= _told_by_data(result.solves[i])
        return {i: np.stack([_changes(result.solves[i], each, i) for each in there]) for i in places}

    looks = _looks(laws)
    seen = changes(looks)
    slopes, curved = {}, {}
    for i in places:
        moves = [(*each.estimates, *each.derived) for each in linear.solves[i].considered]
        slopes[i] = np.stack([np.concatenate([part.ravel() for part in each]) for each in moves])
        limit = _limit(linear.solves[i])
        near = (np.abs(seen[i] - looks @ slopes[i]) <= limit).all(axis=0)
        curved[i] = np.isfinite(limit) & ~near
    points = _points(laws) if any(bool(each.any()) for each in curved.values()) else looks[:0]
    found = changes(points) if len(points) else {i: seen[i][:0] for i in places}
    solves = list(linear.solves)
    for i in places:
        responses = Responses(slopes=slopes[i], points=points, found=found[i], laws=laws, dof=dof)
        solves[i] = _bent(solves[i], result.solves[i], responses, curved[i] & ~stopped[i], spans)
    return replace(linear, solves=tuple(solves))


def _limited(solve: SolveReport, item: Estimate | DerivedValue) -> Mask:
    """Which numbers (k,) of a solve with limits have intervals that these decide: they bend as they leave them."""
    spread, size = item.spread, np.asarray(item.sigma).size
    if spread is None or all(each.spread is None or each.spread.released is None for each in solve.estimates):
        return np.zeros(size, dtype=bool)
    below, above = (each.ravel() for each in _reach(item, solve.coverage, linear=1.0))
    decided = np.zeros(size, dtype=bool)
    if spread.ends is not None:
        decided |= np.isfinite(np.stack([each.ravel() for each in spread.ends(solve.coverage)])).any(axis=0)
    values = np.asarray(item.value).ravel()
    if spread.lower is not None and spread.upper is not None and values.size == size:
        decided |= (values - below <= spread.lower.ravel()) | (values + above >= spread.upper.ravel())
    return decided


def _at_limits(solve: SolveReport) -> bytes:
    """Which estimates are at their limits. Others than these: a limit decides how far numbers follow constants."""
    return b"".join(b"" if each.at_bound is None else np.asarray(each.at_bound).tobytes() for each in solve.estimates)


def _told_by_data(solve: SolveReport) -> Mask:
    """Which numbers (P,) of a solve with exact constants have standard deviations."""

    def told(item: Estimate | DerivedValue) -> Mask:
        values = np.asarray(item.value, dtype=np.float64)
        if item.sigma is None:
            return np.ones(np.shape(difference(item.quantity, values, values)), dtype=bool).ravel()
        return np.asarray(np.ravel(item.sigma) != 0.0)

    return np.concatenate([told(item) for item in _items(solve)])


def _items(solve: SolveReport) -> tuple[Estimate | DerivedValue, ...]:
    return (*solve.estimates, *solve.derived)


def _changes(here: SolveReport, there: Result | None, place: int) -> Floats:
    """What leads from the numbers of a solve to those of another (P,); NaN where that is not trusted."""
    other = here if there is None else there.solves[place]
    pairs = zip(_items(here), _items(other), strict=True)
    each = [difference(a.quantity, np.asarray(a.value), np.asarray(b.value)).ravel() for a, b in pairs]
    found = np.concatenate(each) if each else np.zeros(0)
    return found if there is not None and other.status.trusted else np.full(found.shape, np.nan)


def _limit(solve: SolveReport) -> Floats:
    """How far numbers (P,) may be from what derivatives promise; infinite where they have no standard deviation."""

    def limit(item: Estimate | DerivedValue) -> Floats:
        values = np.asarray(item.value, dtype=np.float64)
        if item.sigma is None or item.spread is None:
            return np.full(np.shape(difference(item.quantity, values, values)), np.inf).ravel()
        size = np.abs(values) if values.shape == item.sigma.shape else np.ones(item.sigma.shape)
        return np.nan_to_num(BENT * item.sigma + BENT_BY_ROUNDING * size, nan=np.inf).ravel()

    return np.concatenate([limit(item) for item in _items(solve)])


def _bent(
    solve: SolveReport, exact: SolveReport, found: Responses, curved: Mask, spans: Mapping[str, Span]
) -> SolveReport:
    """A solve with such intervals of what is ``curved`` (P,) or not normal; ``exact`` is that with exact constants."""
    doubts: list[Diagnostic] = []
    known, first = found.known(), 0

    def bent(item: Item, own: Item) -> Item:
        nonlocal first
        names = element_names(item.quantity, item.keys)
        places = np.arange(first, first + len(names))
        first += len(names)
        if item.sigma is None or item.spread is None:
            return item
        sigma = item.sigma.ravel()
        free = np.isfinite(sigma) & ~_limited(solve, item)
        bends = free & curved[places]
        which = (bends & known[places]) | (free & ~bends & found.abnormal(places, sigma))
        said = [
            f"`{names[k]}` an unknown way, as constants within their uncertainty leave it without a value"
            for k in np.flatnonzero(bends & ~known[places]).tolist()
        ]
        if which.any():
            ends = _Ends(item=item, own=own, found=found, places=places[which], which=which, curved=bends[which])
            said += _missed(item, ends(solve.coverage), solve.coverage, names, which & bends)
            item = replace(item, spread=replace(item.spread, ends=ends))
        if said:
            doubts.append(too_nonlinear(spans[item.quantity.name], said))
        return item

    return replace(
        solve,
        estimates=tuple(bent(item, own) for item, own in zip(solve.estimates, exact.estimates, strict=True)),
        derived=tuple(bent(item, own) for item, own in zip(solve.derived, exact.derived, strict=True)),
        examination=lambda: _with(solve.examined(), doubts),
    )


@np.errstate(all="ignore")
def _missed(
    item: Estimate | DerivedValue, ends: tuple[Floats, Floats], level: float, names: Sequence[str], which: Mask
) -> list[str]:
    """What is said of the numbers among ``which`` (k,) whose linear intervals miss the ``ends``."""
    linear = _reach(item, level, linear=1.0)[0].ravel()
    lower, upper = (each.ravel() / linear for each in ends)
    off = ~(np.maximum(np.abs(lower - 1.0), np.abs(upper - 1.0)) <= TOLERATED)
    return [
        reaches(names[k], float(lower[k]), float(upper[k])) if linear[k] > 0.0 else still(names[k])
        for k in np.flatnonzero(which & off).tolist()
    ]


def _with(found: Examined, doubts: Sequence[Diagnostic]) -> Examined:
    """What was found around a minimum, with more doubts."""
    return replace(found, diagnostics=(*found.diagnostics, *doubts))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Ends:
    """The ends of the intervals of an ``item``, whose own part is that of ``own``: others where ``which`` (K,) says so,
    for numbers at ``places`` (k,) in ``found``, of which some are ``curved`` (k,).
    """

    item: Estimate | DerivedValue
    own: Estimate | DerivedValue
    found: Responses
    places: Indices
    which: Mask
    curved: Mask

    def __call__(self, level: float) -> tuple[Floats, Floats]:
        """How far those of a level reach below and above, NaN where they are linear."""
        reach = np.stack([each.ravel() for each in _reach(self.item, level, linear=np.nan)])
        mine = np.stack([each.ravel() for each in _reach(self.own, level, linear=1.0)])[:, self.which]
        reach[:, self.which] = self.found.ends(self.places, self.curved, level, mine)
        below, above = (each.reshape(np.asarray(self.item.sigma).shape) for each in reach)
        return below, above


@np.errstate(all="ignore")
def _reach(item: Estimate | DerivedValue, level: float, linear: float) -> tuple[Floats, Floats]:
    """How far intervals reach below and above; ``linear`` times as far as the linear ones where those hold."""
    sigma = np.asarray(item.sigma, dtype=np.float64)
    if item.spread is None:
        return sigma * np.nan, sigma * np.nan
    own = np.nan_to_num(coverage_factors(level, item.spread.dof) * item.spread.inflation * sigma) * linear
    if item.spread.ends is None:
        return own, own
    below, above = (np.where(np.isnan(each), own, each) for each in item.spread.ends(level))
    return below, above
