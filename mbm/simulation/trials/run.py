"""Trials in blocks, until there are as many as were asked for, or until the results have settled."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil

import numpy as np

from mbm.equations.types import Floats
from mbm.estimation.batches.trials import TrialSolver
from mbm.simulation.trials import faults
from mbm.simulation.trials.coverage import Spreads, block_size, scatter, spreads, tolerances, wanting
from mbm.simulation.trials.drawn import Drawn
from mbm.text.types import MbmError
from mbm.values import dataclass

MOST_NUMBERS = 100_000_000
"""Numbers that samples may hold: 0.8 GB, and as much again while they are sorted."""

MOST_ADAPTIVE = 2_000_000
"""Trials after which an adaptive propagation ends, settled or not."""

Scalars = Callable[[Floats], Floats]
"""From points (T, N) to the scalars that are reported (T, S)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """How many ``trials`` (None: until settled), at which level of ``coverage``, from which ``seed``.

    ``words`` name the solve. ``workers`` threads share the trials (None: one a processor). ``progress`` hears of the
    trials done and those to be expected; ``stopped`` is asked between blocks.
    """

    trials: int | None
    coverage: float
    seed: int
    words: tuple[str, ...]
    workers: int | None
    progress: Callable[[int, int], None]
    stopped: Callable[[], bool]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sampled:
    """The ``samples`` (T, S) of the trials that converged, and what they say.

    ``failed`` trials did not converge, or have no finite value. ``settled``: the results hold to the meaningful digits
    (None: nobody asked).
    """

    samples: Floats
    spreads: Spreads
    failed: int
    settled: bool | None
    stopped: bool

    @property
    def trials(self) -> int:
        """All trials that were made."""
        return len(self.samples) + self.failed


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
            ratio = _wanting(drawn, blocks)
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
        failed=failed,
        settled=settled if asked.trials is None else None,
        stopped=stopped,
    )


def _wanting(drawn: Drawn, blocks: list[Spreads]) -> float:
    """By how much the results have not settled, the worst of them."""
    moments = drawn.varies
    middle = np.mean([each.sigma for each in blocks], axis=0)
    if not moments:
        middle = np.mean([np.diff(each.interval, axis=1)[:, 0] / 4.0 for each in blocks], axis=0)
    return float(wanting(scatter(blocks), tolerances(middle), moments=moments).max(initial=0.0))


@np.errstate(all="ignore")
def _block(drawn: Drawn, solver: TrialSolver, scalars: Scalars, count: int, number: int, asked: Asked) -> Floats:
    """The scalars (K, S) of those trials of a block that converged and have finite values."""
    points, shifts = drawn.draws(count, asked.seed, asked.words, number)
    parameters = np.tile(solver.parameters, (count, 1))
    parameters[:, drawn.cells] -= shifts  # what was measured is more by as much
    ends, converged = solver.solved(points, parameters, asked.workers)
    found = scalars(ends)
    return found[converged & np.isfinite(found).all(axis=1)]
