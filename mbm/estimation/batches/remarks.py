"""What is to be said of clean solves among many: warnings whose numbers follow from columns, solve by solve."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.losses import rooted_residuals
from mbm.estimation.batches.portion import Portion
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import Remarks
from mbm.estimation.minimise.native.tails import solver_code
from mbm.estimation.trust import faults
from mbm.estimation.trust.lags import correlated, in_order, lag_scores
from mbm.estimation.trust.plausibility import improbable, improbable_noise, overstated
from mbm.problem.types import Problem
from mbm.text.types import Diagnostic

REMARKED = frozenset(
    code.name for code in (faults.AUTOCORRELATED_RESIDUALS, faults.IMPROBABLE_NOISE, faults.SMALL_SAMPLE)
)
"""The codes of these warnings."""


@np.errstate(all="ignore")
def remarks(
    problem: Problem,
    stack: Stack,
    which: range,
    portion: Portion,
    residuals: Floats,
    basis: Floats,
    fit: tuple[Floats, Floats],
    poor: Mask,
) -> Remarks:
    """The warnings about the K solves ``which``.

    ``residuals`` (K, m) are plain, ``basis`` (K, m, n) are the directions in which those with losses in square-root
    form follow estimates; ``fit`` is the root mean square of the residuals per degree of freedom (K,), and the
    probability of a χ² as large (K,). ``poor`` (K,): the noise is told by too few rows.
    """
    sigma0, tail = fit
    found: dict[int, tuple[Diagnostic, ...]] = {}

    def add(place: int, diagnostic: Diagnostic) -> None:
        found[place] = (*found.get(place, ()), diagnostic)

    for place in np.flatnonzero(improbable(tail, sigma0, lossy=portion.equations.lossy)).tolist():
        add(place, improbable_noise(problem.span, float(sigma0[place]), float(tail[place])))
    following = _following(problem, stack, which, portion)
    if following is not None:
        lag, expected, spread = lag_scores(
            solver_code(stack.equations), rooted_residuals(portion, residuals), basis, following
        )
        over = overstated(tail, sigma0)
        for place in np.flatnonzero(correlated(lag, expected, spread)).tolist():
            numbers = (float(each[place]) for each in (lag, expected, spread))
            small = bool(over[place])
            add(place, faults.autocorrelated_residuals(problem.span, *numbers, overstated=small))
    said = faults.small_sample(problem.span) if poor.any() else None
    for place in np.flatnonzero(poor).tolist():
        if said is not None:
            add(place, said)
    return found


def _following(problem: Problem, stack: Stack, which: range, portion: Portion) -> Indices | None:
    """The places (K, m) of the residuals after each, -1 for none; None where no rows are in order, or none is normal.

    Windows are stacked by time, and a solve by itself has its rows as the table has them.
    """
    if portion.consensus or stack.equations.likely:
        return None
    following = np.full((portion.count, portion.most), -1, dtype=np.int64)
    for number, (owner, solve, slots) in enumerate(portion.groups()):
        positions, table = stack.equations.groups[number].positions, problem.blocks[owner].table
        if in_order(problem, owner) and len(solve) > 1 and positions is not None and table is not None:
            rows = stack.tables[table].rows[positions[stack.lines(number, which)[1]]]
            order = np.lexsort((rows, solve))
            solve, slots = solve[order], slots[order]
            same = solve[1:] == solve[:-1]
            following[solve[:-1][same][:, None], slots[:-1][same]] = slots[1:][same]
    return following if bool((following >= 0).any()) else None
