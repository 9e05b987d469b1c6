"""Starts → the best minimum, the other ones, and how often each was found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbm.solution.assembly import Assembled
from mbm.solution.minimise import minimise
from mbm.solution.settings import Settings
from mbm.solution.starting import Beginning
from mbm.solution.types import Minimum
from mbm.text.types import Place


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alternative:
    """Another minimum, and how many starts led to it."""

    minimum: Minimum
    starts: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Tally:
    """How many starts were tried, how many converged, how many led to the best minimum."""

    tried: int
    converged: int
    best_found: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found:
    """What a search answers; ``tally`` is None where a single start was given. Work is summed over all starts."""

    minimum: Minimum
    alternatives: tuple[Alternative, ...]
    tally: Tally | None
    origin: str
    iterations: int
    evaluations: int


def search(equations: Assembled, starts: tuple[Beginning, ...], settings: Settings, place: Place | None) -> Found:
    """The best of the minima that the starts lead to."""
    minima = [minimise(equations, start.point, settings, place) for start in starts]
    costs = [m.cost if np.isfinite(m.cost) else np.inf for m in minima]
    best = int(np.argmin(costs))
    return Found(
        minimum=minima[best],
        alternatives=(),
        tally=None,
        origin=starts[best].origin,
        iterations=sum(m.iterations for m in minima),
        evaluations=sum(m.evaluations for m in minima),
    )
