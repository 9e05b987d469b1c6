"""Which candidates to measure: of few sets the best one, else greedily, with exchanges (Fedorov 1972)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from enum import StrEnum
from itertools import combinations, combinations_with_replacement
from math import comb, inf
from typing import TypeAlias

import numpy as np

from mbm.equations.layout import Layout
from mbm.equations.types import Floats, Indices, Mask, Minimum, Observability
from mbm.estimation.uncertainty.gauge import with_gauge
from mbm.estimation.uncertainty.observability import covariance, observed_at, propagate, triangle
from mbm.problem.kinds import Gauge
from mbm.solver.decisions import SHARE, decided_rank
from mbm.values import dataclass

SAFE = 1e-6
"""Smallest eigenvalue of I − leverage of the rows left out down to which a covariance without them follows from the one
with them: ten digits are left."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Expected:
    """What a set of measurements tells of q numbers: their ``matrix`` (q, q), NaN where it does not determine them.

    ``missing`` counts the independent combinations of them that are free; ``estimable`` (q,) are determined.
    """

    matrix: Floats
    estimable: Mask
    missing: int

    @property
    def determined(self) -> bool:
        """Whether all numbers are."""
        return bool(self.estimable.all())

    @property
    def sigma(self) -> Floats:
        """Standard deviations (q,)."""
        return np.asarray(np.sqrt(np.diag(self.matrix)))

    def gain(self, then: Expected) -> float | None:
        """By which factor the standard deviations shrink, in their geometric mean; correlations count."""
        if not (self.determined and then.determined):
            return None
        count, logarithm = volume(self.matrix)
        return float(np.exp((logarithm - volume(then.matrix)[1]) / (2 * max(count, 1))))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Information:
    """The whitened Jacobian at a point: ``rows`` (m, n) of what is measured, and (k, n) of each of the ``candidates``.

    ``gradient`` (q, n) is that of the quantity by the free coordinates ``free``, NaN of numbers without a value, which
    nothing determines; ``minimum`` has the point and its constraints. ``moves`` (q, c) are what a standard deviation of
    each uncertain constant does to the numbers in a solve with all rows and candidates; what it leaves of their
    residuals stands in c further columns of ``rows`` and ``candidates``.
    """

    minimum: Minimum
    layout: Layout
    free: Indices
    gauge: Gauge
    rows: Floats
    candidates: tuple[Floats, ...]
    gradient: Floats
    moves: Floats

    def compressed(self) -> Information:
        """The same with n + c rows at most that tell what the measured ones do: R of their QR decomposition."""
        rows = triangle(self.rows) if len(self.rows) > 2 * self.rows.shape[1] > 0 else self.rows
        return replace(self, rows=rows)

    def stacked(self, counts: Indices) -> Floats:
        """The rows with those of each candidate as often as ``counts`` (one for each) says: (p, n + c)."""
        taken = [np.sqrt(count) * each for count, each in zip(counts.tolist(), self.candidates, strict=True) if count]
        return np.vstack([self.rows, *taken])

    def expected(self, counts: Indices) -> Expected:
        """What the measurements tell together with the candidates, each so many times."""
        return self.told(self.stacked(counts))

    @np.errstate(all="ignore")
    def told(self, rows: Floats) -> Expected:
        """What some rows (p, n + c) tell.

        From the numbers of all rows, moved with the constants, to those of some is a step −C·Jᵀr of least squares with
        the residuals r that all rows leave; it keeps to the constraints, as C does.
        """
        jacobian, left = np.split(rows, [self.gradient.shape[1]], axis=1)
        observed = self._observed(jacobian)
        there: Mask = np.asarray(np.isfinite(self.gradient).all(axis=1))
        gradient = np.where(there[:, None], self.gradient, 0.0)
        estimated = covariance(observed)
        found = propagate(gradient, observed, estimated)
        shift = self.moves - (gradient @ estimated.factor) @ (estimated.factor.T @ (jacobian.T @ left))
        weighted = gradient / observed.scale
        lengths = np.sqrt(np.square(weighted).sum(axis=1, keepdims=True))
        along = (weighted / np.where(lengths > 0.0, lengths, 1.0)) @ observed.null_space
        missing = int(np.linalg.matrix_rank(along, tol=SHARE)) if along.size else 0
        matrix = np.where(there[:, None] & there, found.matrix + shift @ shift.T, np.nan)
        return Expected(matrix=matrix, estimable=found.estimable & there, missing=missing + int((~there).sum()))

    def _observed(self, jacobian: Floats) -> Observability:
        """The rank decision for some rows."""
        minimum = replace(self.minimum, jacobian=jacobian, residuals=np.zeros(len(jacobian)))
        observed = observed_at(minimum, np.zeros(jacobian.shape[1]))
        return with_gauge(observed, self.layout, self.free, minimum.point, self.gauge)

    def volume(self, counts: Indices, scale: Floats) -> tuple[int, float]:
        """Rank, and the logarithm of the product of the singular values above zero, of the rows by a ``scale`` (n,)."""
        singular = np.asarray(
            np.linalg.svd(self._slopes(self.stacked(counts)) / scale, compute_uv=False), dtype=np.float64
        )
        rank = decided_rank(len(singular), singular, 0)
        return rank, float(np.log(singular[:rank]).sum())

    def scale(self) -> Floats:
        """The column norms (n,) of all rows and candidates, 1 for empty columns."""
        norms = np.sqrt(sum(np.square(self._slopes(each)).sum(axis=0) for each in (self.rows, *self.candidates)))
        return np.where(norms > 0.0, norms, 1.0)

    def _slopes(self, rows: Floats) -> Floats:
        """Rows (p, n + c) without what belongs to the constants."""
        return rows[:, : self.gradient.shape[1]]

    def without(self, units: tuple[Indices, ...]) -> Floats:
        """Variances (u, q) without the rows of each unit; infinite where they do not determine the number any more.

        With A = rows·factor of the covariance, leaving out the rows A takes ``C(I + Aᵀ(I − AAᵀ)⁻¹A)Cᵀ`` (Sherman,
        Morrison and Woodbury) unless the unit alone determines something: then the rank is decided anew.
        """
        jacobian, left_over = np.split(self.rows, [self.gradient.shape[1]], axis=1)
        observed = self._observed(jacobian)
        estimated = covariance(observed)
        whole = propagate(self.gradient, observed, estimated)
        image, lines = self.gradient @ estimated.factor, jacobian @ estimated.factor
        found = np.empty((len(units), len(self.gradient)))
        for number, places in enumerate(units):
            part = lines[places]
            left = np.eye(len(places)) - part @ part.T
            values, vectors = np.linalg.eigh(left)
            if values[0] < SAFE or not bool(whole.estimable.all()):
                told = self.told(np.delete(self.rows, places, axis=0))
                found[number] = np.where(told.estimable, np.diag(told.matrix), np.inf)
                continue
            moved = (image @ part.T) @ vectors
            found[number] = np.square(image).sum(axis=1) + (np.square(moved) / values).sum(axis=1)
            pulled = lines.T @ left_over - part.T @ left_over[places]
            shift = self.moves - (image + (moved / values) @ vectors.T @ part) @ pulled
            found[number] += np.square(shift).sum(axis=1)
        return found


EXHAUSTIVE = 3_000
"""Sets that are all looked at: a second or two of decompositions of small matrices."""

RESTARTS = 4
"""Random sets from which exchanges start, beside the greedy one: exchanges end at local optima."""

PASSES = 50
"""Rounds of exchanges: each must improve, and a handful do."""

BETTER = 1e-9
"""Relative improvement that counts: less is rounding, and would exchange equal candidates for ever."""

DEPENDENT = 1e-12
"""Share of a variance that is rounding where the numbers before decide a number."""

MOST_REPEATS = 10**9
"""Repeats up to which a standard deviation is sought: more measurements than anybody makes."""

Score: TypeAlias = tuple[int, float]
"""Combinations that are missing, and what is to be small; the first decides."""


class Criterion(StrEnum):
    """What is to be small: the variance of one number, the sum of variances, the determinant of the covariance."""

    A = "A"
    C = "c"
    D = "D"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wish:
    """What may be chosen: ``count`` candidates (None: any number) whose ``costs`` (c,) add up to at most a ``budget``.

    ``repeats``: a candidate may be chosen more than once.
    """

    criterion: Criterion
    costs: Floats
    count: int | None = None
    budget: float = inf
    repeats: bool = False

    def affordable(self, counts: Indices) -> bool:
        """Whether a set is within the budget."""
        return float(self.costs @ counts) <= self.budget * (1.0 + 1e-12)

    def allows(self, counts: Indices) -> bool:
        """Whether a set may be chosen."""
        single = self.repeats or not bool((counts > 1).any())
        return single and self.affordable(counts) and (self.count is None or int(counts.sum()) <= self.count)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Choice:
    """How often each candidate is to be measured (c,), what is then to be expected, and how the set was found."""

    counts: Indices
    expected: Expected
    exhaustive: bool


def choose(information: Information, wish: Wish, seed: int) -> Choice:
    """The best set of candidates that a wish allows, as far as the search can tell; ``seed`` draws its starts."""
    information = information.compressed()
    score = _scores(information, wish.criterion)
    size = len(information.candidates)
    if wish.count is not None and not wish.repeats:
        wish = replace(wish, count=min(wish.count, size))
    every = _every(wish, size)
    if every is not None:
        best = every[0] if every else np.zeros(size, dtype=np.int64)
        for counts in every:
            best = counts if _better(score(counts), score(best)) else best
        return Choice(counts=best, expected=information.expected(best), exhaustive=True)
    found = _exchanged(_greedy(np.zeros(size, dtype=np.int64), wish, score), wish, score)
    rng = np.random.default_rng(seed)
    for _ in range(RESTARTS):
        other = _exchanged(_greedy(_random(rng, wish, size), wish, score), wish, score)
        found = other if _better(score(other), score(found)) else found
    return Choice(counts=found, expected=information.expected(found), exhaustive=False)


def repeats_for(information: Information, candidate: int, wanted: float) -> int | None:
    """How often a candidate has to be measured until every standard deviation is at most ``wanted``; None: never."""
    size = len(information.candidates)

    def enough(count: int) -> bool:
        counts = np.zeros(size, dtype=np.int64)
        counts[candidate] = count
        told = information.expected(counts)
        return bool(told.estimable.all()) and float(told.sigma.max(initial=0.0)) <= wanted

    if enough(0):
        return 0
    below, above = 0, 1
    while not enough(above):
        below, above = above, 2 * above
        if above > MOST_REPEATS:
            return None
    while above - below > 1:
        middle = (below + above) // 2
        below, above = (below, middle) if enough(middle) else (middle, above)
    return above


def objective(expected: Expected, criterion: Criterion) -> float:
    """What a criterion makes small of a set that determines all numbers."""
    return volume(expected.matrix)[1] if criterion is Criterion.D else float(np.trace(expected.matrix))


def volume(matrix: Floats) -> tuple[int, float]:
    """How many numbers of a covariance are free of those before them, and the logarithm of the determinant of theirs.

    Constraints, and numbers derived from one another, leave the same combinations without variance in every set.
    """
    left, count, logarithm = matrix.copy(), 0, 0.0
    for place, variance in enumerate(np.diag(matrix).tolist()):
        remains = float(left[place, place])
        if remains > DEPENDENT * variance:
            count, logarithm = count + 1, logarithm + float(np.log(remains))
            left -= np.outer(left[:, place], left[place] / remains)
    return count, logarithm


def _scores(information: Information, criterion: Criterion) -> Callable[[Indices], Score]:
    """The score of a set. Where something is missing, the set that tells most of the rest is the better one."""
    scale, known = information.scale(), dict[bytes, Score]()

    def score(counts: Indices) -> Score:
        found = known.get(counts.tobytes())
        if found is None:
            told = information.expected(counts)
            if told.missing or not bool(told.estimable.all()):
                rank, volume = information.volume(counts, scale)
                found = (max(told.missing, 1), -1e6 * rank - volume)
            else:
                found = (0, objective(told, criterion))
            known[counts.tobytes()] = found
        return found

    return score


def _better(one: Score, other: Score) -> bool:
    """Whether a score is better by more than rounding; logarithms and variances may be negative and tiny."""
    if one[0] != other[0]:
        return one[0] < other[0]
    return one[1] < other[1] - BETTER * max(abs(one[1]), abs(other[1]))


def _every(wish: Wish, size: int) -> list[Indices] | None:
    """All sets that are allowed and complete, if they are few; None otherwise."""
    if wish.count is None and (wish.repeats or size > int(np.log2(EXHAUSTIVE))):
        return None
    numbers = range(size + 1) if wish.count is None or wish.budget < inf else [wish.count]
    numbers = [each for each in numbers if wish.count is None or each <= wish.count]
    several = wish.repeats and wish.count is not None
    total = sum(comb(size + n - 1, n) if several else comb(size, n) for n in numbers)
    if total > EXHAUSTIVE:
        return None
    draws: Iterator[tuple[int, ...]] = (
        each
        for n in numbers
        for each in (combinations_with_replacement(range(size), n) if several else combinations(range(size), n))
    )
    found = [np.bincount(np.array(each, dtype=np.int64), minlength=size) for each in draws]
    return [counts for counts in found if wish.affordable(counts)]


def _greedy(counts: Indices, wish: Wish, score: Callable[[Indices], Score]) -> Indices:
    """A set with the candidate added again and again that gains most, for its cost where costs are bounded.

    Where any number may be chosen, it ends with the one that loses: with uncertain constants, weights are not the best.
    """
    while True:
        now = score(counts)
        best: tuple[int, float, int] | None = None
        for place in range(len(counts)):
            more = counts.copy()
            more[place] += 1
            if not wish.allows(more):
                continue
            then = score(more)
            gain = now[1] - then[1] if then[0] == now[0] else -then[1]
            price = wish.costs[place] if wish.budget < inf else 1.0
            rate = gain / price if price > 0.0 and then[0] == now[0] else gain
            key = (then[0], -rate, place)
            best = key if best is None or key < best else best
        if best is None or (wish.count is None and (best[0], best[1]) > (now[0], 0.0)):
            return counts
        counts = counts.copy()
        counts[best[2]] += 1


def _exchanged(counts: Indices, wish: Wish, score: Callable[[Indices], Score]) -> Indices:
    """A set after exchanges of one candidate for another, each the best there is, until none improves it."""
    for _ in range(PASSES):
        best, reached = counts, score(counts)
        for out in np.flatnonzero(counts).tolist():
            for place in range(len(counts)):
                other = counts.copy()
                other[out] -= 1
                other[place] += 1
                if place != out and wish.allows(other) and _better(score(other), reached):
                    best, reached = other, score(other)
        if best is counts:
            return counts
        counts = _greedy(best, wish, score)
    return counts


def _random(rng: np.random.Generator, wish: Wish, size: int) -> Indices:
    """A random set that a wish allows."""
    counts = np.zeros(size, dtype=np.int64)
    places = rng.integers(0, size, wish.count) if wish.repeats and wish.count is not None else rng.permutation(size)
    for place in places.tolist():
        more = counts.copy()
        more[place] += 1
        counts = more if wish.allows(more) else counts
    return counts
