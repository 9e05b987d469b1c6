"""Intervals of what bends with uncertain constants, or follows one whose law is not normal, after GUM Supplement 1.

The response of a number to a constant is a polynomial through five solves: at the value, a little beside it, and at the
ends of 95 % of the constant; that to two of them has the mixed derivative besides. Variates of all laws, the same in
every solve (a Latin hypercube), then give the distribution of the number, whose quantiles are the interval.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from itertools import combinations
from math import inf
from typing import TypeVar

import numpy as np
from numpy.polynomial import Polynomial

from mbm.equations.faults import too_nonlinear
from mbm.equations.types import Indices, Mask
from mbm.estimation.trust.nonlinearity import TOLERATED
from mbm.estimation.trust.plausibility import reaches, still
from mbm.estimation.uncertainty.student import coverage_factor, coverage_factors
from mbm.problem.overrides import NORMAL_LAW, Law
from mbm.report.considered import share_of
from mbm.report.elements import difference, element_names
from mbm.report.spreads import ConsideredConstant, Floats
from mbm.report.types import DerivedValue, Estimate, Examined, Result, SolveReport
from mbm.simulation.noise import standard_variates
from mbm.text.types import Diagnostic, Span
from mbm.values import dataclass, replace

Item = TypeVar("Item", Estimate, DerivedValue)

Solved = Callable[[Mapping[int, float]], Result]
"""The problem solved again with some constants, by their places, moved by so many standard deviations."""

BENT = 0.1
"""Second derivative along a standard deviation of a constant, in standard deviations of the number, from which it is
looked at: at it, an end of the 95 % interval is off by a tenth."""

BENT_BY_ROUNDING = 1e-9
"""The same, as a share of the number, that may be a rounding of second differences."""

KURTOSIS = 0.3
"""Excess of the kurtosis of a number from which the laws of its constants count: a rectangular one that has half of the
variance makes it so much flatter than normal."""

POINTS = 16384
"""Of the Latin hypercube: quantiles are off by some thousandths of a standard deviation."""

DRAWN = 2**17
"""Variates by which the quantiles of a law are found."""

TAIL = 0.025

GOLDEN = 0.6180339887498949
"""By whose multiples steps differ that are made together, so that pairs do not cancel, as those of (a − c) b would."""

SPREAD_OUT = 0.1
"""Share of the limit of a mixed derivative that the mean of all pairs may have, as most may be zero."""


@lru_cache(maxsize=32)
def quantiles(law: Law) -> Floats:
    """Those of a law of mean 0 and standard deviation 1 at the middles of `POINTS` shares."""
    drawn = standard_variates(law, np.random.default_rng(1), (DRAWN,))
    return np.asarray(np.quantile(drawn, (np.arange(POINTS) + 0.5) / POINTS))


@lru_cache(maxsize=1024)
def _variates(law: Law, place: int) -> Floats:
    """The quantiles in an order of their own for each ``place``."""
    return np.asarray(np.random.default_rng(place).permutation(quantiles(law)))


def ends_of(law: Law) -> tuple[float, float]:
    """Those of the 95 % interval of a law of mean 0 and standard deviation 1."""
    low, high = np.quantile(quantiles(law), (TAIL, 1.0 - TAIL))
    return float(low), float(high)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Responses:
    """Of P numbers to n constants: first and second derivatives ``slopes`` and ``bends`` (n, P) along their standard
    deviations, changes ``far`` (2, n, P) at the ends of their laws (NaN: not looked at), ``mixed`` (n, n, P) second
    derivatives of pairs. ``dof`` (n,) are those of the constants.
    """

    slopes: Floats
    bends: Floats
    far: Floats
    mixed: Floats
    laws: Sequence[Law]
    dof: Floats

    def curved(self, limit: Floats) -> Mask:
        """Which numbers (P,) bend by more than a ``limit`` (P,)."""
        return np.asarray((np.abs(self.bends) > limit).any(axis=0) | (np.abs(self.mixed) > limit).any(axis=(0, 1)))

    def abnormal(self, places: Indices, sigma: Floats) -> Mask:
        """Which numbers, with standard deviations (k,), are not normal for the laws of their constants."""
        excess = np.array([0.0 if law == NORMAL_LAW else np.mean(quantiles(law) ** 4) - 3.0 for law in self.laws])
        return np.asarray(np.abs(excess) @ self.slopes[:, places] ** 4 > KURTOSIS * sigma**4)

    def ends(self, place: int, level: float, below: float, above: float) -> tuple[float, float]:
        """How far the interval of a number reaches, to whose own part ``below`` and ``above`` belong."""
        normal = coverage_factor(level, inf)
        own = _variates(NORMAL_LAW, len(self.laws))
        total = own * np.where(own < 0.0, below, above) / normal
        factors = coverage_factors(level, self.dof) / normal
        steps = [_variates(law, j) * factors[j] for j, law in enumerate(self.laws)]
        for j, step in enumerate(steps):
            total = total + self._response(j, place, step)
        for i, j in combinations(range(len(steps)), 2):
            total = total + self.mixed[i, j, place] * steps[i] * steps[j]
        low, high = np.quantile(total, ((1.0 - level) / 2.0, (1.0 + level) / 2.0))
        return -float(low), float(high)

    def _response(self, j: int, place: int, step: Floats) -> Floats:
        """The change of a number as a constant moves by ``step`` (p,); a parabola beyond what was solved."""
        own = Polynomial([0.0, self.slopes[j, place], self.bends[j, place] / 2.0])
        ends = np.array(ends_of(self.laws[j]))
        rest = self.far[:, j, place] - own(ends)
        if not np.isfinite(rest).all():
            return np.asarray(own(step))
        third, fourth = np.linalg.solve(np.stack([ends**3, ends**4], axis=1), rest)
        own = own + Polynomial([0.0, 0.0, 0.0, third, fourth])
        inside = np.clip(step, *ends)
        beyond = step - inside
        return np.asarray(own(inside) + own.deriv()(inside) * beyond + own.deriv(2)(inside) * beyond**2 / 2.0)


def with_bends(
    linear: Result,
    result: Result,
    moved: Sequence[tuple[ConsideredConstant, Result, Result]],
    solved: Solved,
    spans: Mapping[str, Span],
) -> Result:
    """The ``linear`` answer with intervals that mind how numbers bend with constants, and doubts where they do.

    ``result`` is that with exact constants, ``moved`` has each of them and the results with it `share_of` below and
    above; doubts are said at the ``spans`` of what they speak of.
    """
    constants = [constant for constant, _, _ in moved]
    laws, shares = [each.law for each in constants], np.array([share_of(each) for each in constants])
    places = [i for i, solve in enumerate(linear.solves) if solve.considered and not _held(solve)]
    found = {}
    for i in places:
        here = result.solves[i]
        back = np.stack([_changes(here, below.solves[i]) for _, below, _ in moved])
        forth = np.stack([_changes(here, above.solves[i]) for _, _, above in moved])
        share = shares[:, None]
        found[i] = Responses(
            slopes=(forth - back) / (2.0 * share),
            bends=np.nan_to_num(forth + back) / share**2,
            far=np.full((2, *back.shape), np.nan),
            mixed=np.zeros((len(moved), *back.shape)),
            laws=laws,
            dof=np.array([each.dof for each in constants]),
        )
    limits = {i: _limit(linear.solves[i]) for i in places}
    _mix(found, limits, result, shares, solved)
    for j, law in enumerate(laws):
        if any(bool((np.abs(found[i].bends[j]) > limits[i]).any()) for i in places):
            there = [solved({j: end}) for end in ends_of(law)]
            for i in places:
                found[i].far[:, j] = [_changes(result.solves[i], each.solves[i]) for each in there]
    solves = list(linear.solves)
    for i in places:
        solves[i] = _bent(solves[i], result.solves[i], found[i], limits[i], spans)
    return replace(linear, solves=tuple(solves))


def _mix(
    found: Mapping[int, Responses], limits: Mapping[int, Floats], result: Result, shares: Floats, solved: Solved
) -> None:
    """Put in the mixed derivatives: all pairs, if all constants moved together do other than one by one."""

    def beside(steps: Mapping[int, float]) -> dict[int, Floats]:
        """What constants that move by so many standard deviations do together beyond what they do alone."""
        moved, which = solved(steps), list(steps)
        own = np.array(list(steps.values()))[:, None]
        return {
            i: np.nan_to_num(
                _changes(result.solves[i], moved.solves[i])
                - (each.slopes[which] * own + each.bends[which] * own**2 / 2.0).sum(axis=0)
            )
            for i, each in found.items()
        }

    pairs = list(combinations(range(len(shares)), 2))
    if not pairs or not any(bool((np.count_nonzero(each.slopes, axis=0) > 1).any()) for each in found.values()):
        return
    steps = {j: float(share * (1.0 + GOLDEN * (j + 1) % 1.0)) for j, share in enumerate(shares)}
    size = sum(steps[i] * steps[j] for i, j in pairs)
    every = beside(steps)
    if not any(bool((np.abs(every[i]) > SPREAD_OUT * size * limits[i]).any()) for i in found):
        return
    for pair in pairs:
        rest = every if len(pairs) == 1 else beside({j: steps[j] for j in pair})
        for i, each in found.items():
            each.mixed[pair] = rest[i] / (steps[pair[0]] * steps[pair[1]])


def _held(solve: SolveReport) -> bool:
    """Whether limits hold something: it bends there as it leaves them, which the ends of its interval mind already."""
    return any(each.spread is not None and each.spread.released is not None for each in solve.estimates)


def _items(solve: SolveReport) -> tuple[Estimate | DerivedValue, ...]:
    return (*solve.estimates, *solve.derived)


def _changes(here: SolveReport, there: SolveReport) -> Floats:
    """What leads from the numbers of a solve to those of another (P,); NaN where that is not trusted."""
    pairs = zip(_items(here), _items(there), strict=True)
    each = [difference(a.quantity, np.asarray(a.value), np.asarray(b.value)).ravel() for a, b in pairs]
    found = np.concatenate(each) if each else np.zeros(0)
    return found if there.status.trusted else np.full_like(found, np.nan)


def _limit(solve: SolveReport) -> Floats:
    """Second derivatives (P,) above which numbers bend; infinite where they have no standard deviation."""

    def limit(item: Estimate | DerivedValue) -> Floats:
        values = np.asarray(item.value, dtype=np.float64)
        if item.sigma is None or item.spread is None:
            return np.full(np.shape(difference(item.quantity, values, values)), np.inf).ravel()
        size = np.abs(values) if values.shape == item.sigma.shape else np.ones(item.sigma.shape)
        return np.nan_to_num(BENT * item.sigma + BENT_BY_ROUNDING * size, nan=np.inf).ravel()

    return np.concatenate([limit(item) for item in _items(solve)])


def _bent(
    solve: SolveReport, exact: SolveReport, found: Responses, limit: Floats, spans: Mapping[str, Span]
) -> SolveReport:
    """A solve with such intervals; ``exact`` is that with exact constants."""
    doubts: list[Diagnostic] = []
    curved, first = found.curved(limit), 0

    def bent(item: Item, own: Item) -> Item:
        nonlocal first
        names = element_names(item.quantity, item.keys)
        places = np.arange(first, first + len(names))
        first += len(names)
        if item.sigma is None or item.spread is None:
            return item
        which = np.isfinite(limit[places]) & (curved[places] | found.abnormal(places, item.sigma.ravel()))
        if not which.any():
            return item
        ends = _Ends(item=item, own=own, found=found, places=places, which=which)
        said = _missed(item, ends(solve.coverage), solve.coverage, names, which & curved[places])
        if said:
            doubts.append(too_nonlinear(spans[item.quantity.name], said))
        return replace(item, spread=replace(item.spread, ends=ends))

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
    """The ends of the intervals of an ``item``, whose own part is that of ``own``; ``places`` are those of its numbers
    in ``found``, ``which`` (k,) those that bend.
    """

    item: Estimate | DerivedValue
    own: Estimate | DerivedValue
    found: Responses
    places: Indices
    which: Mask

    def __call__(self, level: float) -> tuple[Floats, Floats]:
        """How far those of a level reach below and above, NaN where they are linear."""
        below, above = (each.ravel().copy() for each in _reach(self.item, level, linear=np.nan))
        mine = [each.ravel() for each in _reach(self.own, level, linear=1.0)]
        for k in np.flatnonzero(self.which).tolist():
            below[k], above[k] = self.found.ends(int(self.places[k]), level, float(mine[0][k]), float(mine[1][k]))
        shape = np.asarray(self.item.sigma).shape
        return below.reshape(shape), above.reshape(shape)


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
