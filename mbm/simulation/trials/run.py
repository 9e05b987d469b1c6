"""Trials in blocks, until there are as many as were asked for, or until the results have settled; from samples to
estimate, standard deviation and coverage intervals (GUM Supplement 1, clauses 7.5 to 7.9 and 8).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import cached_property
from math import ceil, isfinite, sqrt

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.trials import TrialSolver
from mbm.simulation.trials import faults
from mbm.simulation.trials.drawn import Drawn
from mbm.text.types import MbmError
from mbm.values import dataclass

DIGITS = 2
"""Digits of a standard deviation that are meaningful."""

LEAST_BLOCK = 10_000
"""Trials of a block at least (7.9.4 a)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spreads:
    """Of samples (T, S): arrays (S,). The ``interval`` is probabilistically symmetric; both are (S, 2).

    ``chance`` (S, 2, 2) has for each of its ends where it may lie: the order statistics three standard deviations of
    their rank below and above.
    """

    mean: Floats
    sigma: Floats
    median: Floats
    interval: Floats
    shortest: Floats
    chance: Floats

    def of(self, columns: slice) -> Spreads:
        """Those of some of the scalars."""
        return Spreads(**{each.name: getattr(self, each.name)[columns] for each in fields(self)})


def spreads(samples: Floats, level: float) -> Spreads:
    """What samples (T, S) say at a level of coverage, each scalar by those that have a value of it."""
    missing = np.isnan(samples)
    if not bool(missing.any()):
        return _spreads(samples, level)
    there = (samples[~none, k] for k, none in enumerate(missing.T))
    alone = [_spreads((own if len(own) else np.array([np.nan]))[:, None], level) for own in there]
    return Spreads(
        **{each.name: np.concatenate([getattr(found, each.name) for found in alone]) for each in fields(Spreads)}
    )


@np.errstate(all="ignore")
def _spreads(samples: Floats, level: float) -> Spreads:
    """The same of samples that are all finite, by their order (7.6, 7.7)."""
    ordered = np.sort(samples, axis=0)
    count = len(ordered)
    held = min(max(int(level * count + 0.5), 1), count - 1) if count > 1 else 0
    first = max(int((count - held + 1) / 2), 1) - 1
    widths = ordered[held:] - ordered[: count - held]
    best = np.argmin(widths, axis=0)
    columns = np.arange(samples.shape[1])
    last = min(first + held, count - 1)
    reach = ceil(3.0 * sqrt(count * (1.0 - level) / 2.0 * (1.0 + level) / 2.0))
    ranks = np.clip([[first - reach, first + reach], [last - reach, last + reach]], 0, max(count - 1, 0))
    return Spreads(
        mean=samples.mean(axis=0),
        sigma=samples.std(axis=0, ddof=1) if count > 1 else np.full(samples.shape[1], np.nan),
        median=np.median(ordered, axis=0),
        interval=np.stack([ordered[first], ordered[last]], axis=1),
        shortest=np.stack([ordered[best, columns], ordered[best + held, columns]], axis=1),
        chance=np.moveaxis(ordered[ranks], 2, 0),
    )


def block_size(level: float) -> int:
    """Trials of a block (7.9.4 a): a hundred beyond an interval at least."""
    return max(ceil(100.0 / (1.0 - level)), LEAST_BLOCK)


def tolerances(sigma: Floats) -> Floats:
    """Half a unit of the last of the meaningful digits of standard deviations (S,) (7.9.2); 0 where nothing varies."""
    return np.array([_tolerance(each) for each in np.ravel(sigma).tolist()])


def _tolerance(sigma: float) -> float:
    if not (isfinite(sigma) and sigma > 0.0):
        return 0.0
    exponent = int(f"{sigma:.{DIGITS - 1}e}".partition("e")[2]) - (DIGITS - 1)
    return 0.5 * 10.0**exponent


def scatter(blocks: list[Spreads]) -> Spreads:
    """The standard deviations of the means of what h blocks say (7.9.4 f); infinite of one block."""
    count = len(blocks)
    found = {}
    for each in fields(Spreads):
        parts = np.stack([getattr(block, each.name) for block in blocks])
        found[each.name] = parts.std(axis=0, ddof=1) / np.sqrt(count) if count > 1 else np.full(parts.shape[1:], np.inf)
    return Spreads(**found)


def wanting(scattering: Spreads, tolerance: Floats, *, moments: Mask) -> Floats:
    """By how much (S,) twice the scatter of the results exceeds the tolerance; at most 1 where they have settled.

    ``moments`` (S,): mean and standard deviation exist. Of what some block has no value, nothing is awaited.
    """
    middle = np.where(moments, np.maximum(scattering.mean, scattering.sigma), scattering.median)
    worst = np.nan_to_num(np.max(np.stack([middle, *scattering.interval.T]), axis=0), nan=0.0, posinf=np.inf)
    still = worst == 0.0
    return np.where(
        still, 0.0, 2.0 * worst / np.where(still | (tolerance > 0.0), np.maximum(tolerance, 1e-300), 1e-300)
    )


LOOSE = 0.5
"""Of the width of an interval: where an end may lie so far apart, almost any other agrees. Of 500 normal samples the
ends of 95 % may lie 0.3 apart, of 10,000 (a block) 0.04."""


def validated(linear: Floats, found: Spreads) -> tuple[bool | None, ...]:
    """Whether linear intervals (S, 2) agree with the symmetric ones to the meaningful digits (8.2), wherever within its
    chance the end of the latter is; None where that is anywhere (`LOOSE`): too few trials to tell.
    """
    tolerance = tolerances(found.sigma)[:, None]
    low, high = np.moveaxis(found.chance, 2, 0)
    inside = ((linear >= low - tolerance) & (linear <= high + tolerance)).all(axis=1)
    loose = (high - low > np.maximum(LOOSE * np.diff(found.interval, axis=1), tolerance)).any(axis=1)
    return tuple(None if far and same else same for far, same in zip(loose.tolist(), inside.tolist(), strict=True))


MOST_NUMBERS = 100_000_000
"""Numbers that samples may hold: 0.8 GB, and as much again while they are sorted."""

MOVED, UNMOVED = 20, 1e-9
"""Trials that show what an input moves: one without a variance does so by far more than solves are rounded."""

MOST_ADAPTIVE = 2_000_000
"""Trials after which an adaptive propagation ends, settled or not."""

Scalars = Callable[[Floats], Floats]
"""From points (T, N) to the scalars that are reported (T, S)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """How many ``trials`` (None: until settled), from which ``seed``.

    ``workers`` threads share the trials (None: one a processor). ``progress`` hears of the trials done and those to be
    expected; ``stopped`` is asked between blocks.
    """

    trials: int | None
    seed: int
    workers: int | None
    progress: Callable[[int, int], None]
    stopped: Callable[[], bool]


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked(Effort):
    """The trials of one solve, which ``words`` name, at which level of ``coverage``."""

    coverage: float
    words: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled:
    """The ``samples`` (T, S) of the trials that converged, NaN where a quantity has no value, and what they say.

    ``varies`` (S,): nothing without a variance is drawn for it. ``failed`` trials did not converge. ``settled``: the
    results hold to the meaningful digits (None: nobody asked).
    """

    samples: Floats
    spreads: Spreads
    varies: Mask
    failed: int
    settled: bool | None
    stopped: bool

    @property
    def trials(self) -> int:
        """All trials that were made."""
        return len(self.samples) + self.failed

    @cached_property
    def undefined(self) -> Indices:
        """In how many of the trials that converged each scalar (S,) has no value."""
        return np.asarray(np.isnan(self.samples).sum(axis=0))


def sampled(drawn: Drawn, solver: TrialSolver, scalars: Scalars, count: int, asked: Asked) -> Sampled:
    """The trials of one solve, of which ``count`` scalars are reported.

    Raises:
        MbmError: `too-many-trials`, or none that converged (`not-propagated`).

    """
    most = MOST_NUMBERS // max(count, 1)
    if asked.trials is not None and asked.trials > most:
        raise MbmError(faults.too_many_trials(asked.trials, count, most))
    size = block_size(asked.coverage)
    limit = asked.trials or min(MOST_ADAPTIVE, most // size * size)
    kept: list[Floats] = []
    blocks: list[Spreads] = []
    varies = _varying(drawn, solver, scalars, count, asked)
    failed = done = 0
    settled = stopped = False
    while done < limit and not settled:
        if asked.stopped():
            stopped = True
            break
        made = min(size, limit - done)
        found = _block(drawn, solver, scalars, made, len(kept), asked)
        failed, done = failed + made - len(found), done + made
        kept.append(found)
        if len(found) > 1 and made == size:
            blocks.append(spreads(found, asked.coverage))
        expected = limit
        if asked.trials is None and len(blocks) > 1:
            ratio = _wanting(varies, blocks)
            settled, expected = ratio < 1.0, min(limit, ceil(done * max(ratio, 1.0) ** 2))
        asked.progress(done, max(expected, done))
    whole = np.concatenate(kept) if kept else np.zeros((0, count))
    if len(whole) < 2:
        why = "no trial converged" if done else "it was interrupted"
        raise MbmError(
            faults.not_propagated(drawn.problem.span, f"`{drawn.problem.name}`", why, "look at its estimates")
        )
    return Sampled(
        samples=whole,
        spreads=spreads(whole, asked.coverage),
        varies=varies,
        failed=failed,
        settled=settled if asked.trials is None else None,
        stopped=stopped,
    )


def _wanting(varies: Mask, blocks: list[Spreads]) -> float:
    """By how much the results have not settled, the worst of them."""
    widths = [np.where(varies, each.sigma, np.diff(each.interval, axis=1)[:, 0] / 4.0) for each in blocks]
    return float(wanting(scatter(blocks), tolerances(np.mean(widths, axis=0)), moments=varies).max(initial=0.0))


def _varying(drawn: Drawn, solver: TrialSolver, scalars: Scalars, count: int, asked: Asked) -> Mask:
    """Which scalars (S,) stay where they are while only that is drawn which has no variance."""
    heavy = drawn.without_variance()
    if heavy is None:
        return np.ones(count, dtype=bool)
    moved = _block(heavy, solver, scalars, MOVED, 0, asked)
    if not len(moved):
        return np.zeros(count, dtype=bool)
    size = np.maximum(np.abs(moved).max(axis=0), np.finfo(float).tiny)
    return np.asarray((np.ptp(moved, axis=0) <= UNMOVED * size) | np.isnan(moved).all(axis=0))


@np.errstate(all="ignore")
def _block(drawn: Drawn, solver: TrialSolver, scalars: Scalars, count: int, number: int, asked: Asked) -> Floats:
    """The scalars (K, S) of those trials of a block that converged; NaN where one has no finite value."""
    points, shifts = drawn.draws(count, asked.seed, asked.words, number)
    parameters = np.tile(solver.parameters, (count, 1))
    parameters[:, drawn.cells] -= shifts  # what was measured is more by as much
    ends, converged = solver.solved(points, parameters, asked.workers)
    found = scalars(ends)[converged]
    return np.where(np.isfinite(found), found, np.nan)
