"""Ends of streams: what comes back of many data sets, and how it is judged and shown."""

from __future__ import annotations

from math import ceil, pi
from typing import Any

import numpy as np

from mbm.equations.metric import roundings
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.minimise.native.system import NativeEnds
from mbm.solver import description as of
from mbm.solver.decisions import takes_over
from mbm.values import dataclass

TURN = 2.0 * pi

NO_CODE = "there is no native code for such equations, or none on this machine"
"""Why there is no stream."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StreamEnds:
    """Where T solves ended: ``numbers`` (T, N) in SI, angles in (-π, π]; ``covariance`` (T, n, n); ``cost`` (T,).

    ``clean`` (T,): a minimum of full rank, away from all bounds, that fits as stated noise lets expect; ``strained``
    (T,): one that does not fit so.
    """

    numbers: Floats
    covariance: Floats
    cost: Floats
    clean: Mask
    strained: Mask

    def beaten(self, which: Indices, others: StreamEnds, rounding: Floats) -> StreamEnds:
        """These, with the ``others`` of the solves ``which`` (K,) in their places where these take over.

        ``rounding`` (K,) is the rounding error of ``‖r‖`` of those that were there before.
        """
        costs = zip(self.cost[which].tolist(), others.cost.tolist(), rounding.tolist(), strict=True)
        lower = np.array([takes_over(*each) for each in costs], dtype=bool)
        self.put(which, others, lower)
        return self

    def put(self, which: Indices, others: StreamEnds, taken: Mask | slice = slice(None)) -> None:
        """Put the ``others`` of the solves ``which`` (K,) in their places, those ``taken`` (K,)."""
        for mine, other in (
            (self.numbers, others.numbers),
            (self.covariance, others.covariance),
            (self.cost, others.cost),
            (self.clean, others.clean),
        ):
            mine[which[taken]] = other[taken]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rules:
    """What an end is judged and finished by.

    ``usual`` is the largest cost that stated noise lets expect (infinite: nothing is expected), ``most`` the largest
    that asks for no look at other minima (infinite: there are none). ``estimated`` says whether one factor of the noise
    follows from the residuals, ``angles`` the numbers that are angles. ``places`` (n,) are
    those of the coordinates among the numbers, -1 for rotations and directions.
    """

    most: float
    estimated: bool
    angles: tuple[int, ...]
    places: Indices
    usual: float = np.inf

    def clean(self, cost: Any, reason: Any, deficient: Any, held: Any, freedom: Any) -> Any:
        """Whether nothing speaks against an end: numbers of one solve, or arrays of all."""
        return self.sound(cost, reason, deficient, held, freedom) & (cost < self.most)

    def sound(self, cost: Any, reason: Any, deficient: Any, held: Any, freedom: Any) -> Any:
        """The same, however well it fits."""
        good = (reason >= of.SMALL_OFFSET) & (reason <= of.ONE_STEP) & (deficient == 0) & (held == 0)
        return good & (freedom > 0) & (cost > 0.0) if self.estimated else good

    def judged(self, ends: NativeEnds, count: int) -> StreamEnds:
        """The first so many of some ends, in arrays of their own."""
        states = ends.states[:count]
        cost = ends.results[:count, of.COST].copy()
        freedom = states[:, of.FREEDOM]
        held = ends.sides[:count].any(axis=1)
        sound = np.asarray(self.sound(cost, states[:, of.REASON], states[:, of.DEFICIENT], held, freedom))
        covariance = ends.covariances[:count].copy()
        if self.estimated:
            covariance *= (cost / np.maximum(freedom, 1))[:, None, None]
        numbers = self.shown(ends.numbers[:count])
        fits = cost < self.most
        return StreamEnds(numbers=numbers, covariance=covariance, cost=cost, clean=sound & fits, strained=sound & ~fits)

    def roundings(self, ends: NativeEnds, which: Indices) -> Floats:
        """The rounding error of ``‖r‖`` of some ends (K,)."""
        columns = ends.triangles[which][:, :-1, :-1]
        norms = np.sqrt(np.square(columns).sum(axis=1))
        return roundings(norms, ends.numbers[which], self.places, ends.results[which, of.COST])

    def shown(self, numbers: Floats) -> Floats:
        """A copy of numbers (T, N) with angles in (-π, π]."""
        found = numbers.copy()
        for k in self.angles:
            found[:, k] -= TURN * np.ceil(found[:, k] / TURN - 0.5)
        return found

    def shown_one(self, numbers: Floats) -> Floats:
        """The same of one solve (N,), to the last bit."""
        found = numbers.copy()
        for k in self.angles:
            angle = found.item(k)
            turns = ceil(angle / TURN - 0.5)
            if turns:
                found[k] = angle - TURN * turns
        return found
