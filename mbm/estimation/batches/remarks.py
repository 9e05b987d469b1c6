"""What is to be said of clean solves among many: warnings whose numbers follow from columns, solve by solve."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from mbm.equations.binding import measured_side
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.factor import rooted_residuals
from mbm.estimation.batches.portion import Portion
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import Remarks, Which
from mbm.estimation.minimise.native.tails import solver_code
from mbm.estimation.trust import faults
from mbm.estimation.trust.coarse import correlated, in_order, lag_scores
from mbm.estimation.trust.plausibility import improbable, improbable_noise, overstated
from mbm.estimation.trust.uneven import (
    TELLING_ROWS,
    Clauses,
    has_noise,
    outlier,
    outlying_row,
    pool,
    suspects,
    table_rows,
    told_apart,
    uneven_clause,
)
from mbm.problem.types import Problem
from mbm.text.types import Diagnostic

REMARKED = frozenset(
    code.name
    for code in (
        faults.AUTOCORRELATED_RESIDUALS,
        faults.IMPROBABLE_NOISE,
        faults.OUTLYING_ROW,
        faults.SMALL_SAMPLE,
        faults.UNEVEN_NOISE,
    )
)
"""The codes of these warnings."""


@np.errstate(all="ignore")
def remarks(
    problem: Problem,
    stack: Stack,
    which: Which,
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
    found: dict[int, tuple[Callable[[], Diagnostic], ...]] = {}

    def add(place: int, make: Callable[[], Diagnostic]) -> None:
        found[place] = (*found.get(place, ()), make)

    for place in np.flatnonzero(improbable(tail, sigma0, lossy=portion.equations.lossy)).tolist():
        add(place, partial(improbable_noise, problem.span, float(sigma0[place]), float(tail[place])))
    alike: set[int] = set()
    following = _following(problem, stack, which, portion)
    if following is not None:
        lag, expected, spread = lag_scores(
            solver_code(stack.equations), rooted_residuals(portion, residuals), basis, following
        )
        over = overstated(tail, sigma0)
        for place in np.flatnonzero(correlated(lag, expected, spread)).tolist():
            alike.add(place)
            numbers = (float(each[place]) for each in (lag, expected, spread))
            small = bool(over[place])
            add(place, partial(faults.autocorrelated_residuals, problem.span, *numbers, overstated=small))
    for place, make in _uneven(problem, stack, which, portion, residuals, basis):
        if place not in alike:
            add(place, make)
    for place, make in _outlying(problem, stack, which, portion, residuals, basis):
        add(place, make)
    for place in np.flatnonzero(poor).tolist():
        add(place, partial(faults.small_sample, problem.span))
    return found


def _uneven(
    problem: Problem, stack: Stack, which: Which, portion: Portion, residuals: Floats, basis: Floats
) -> Iterator[tuple[int, Callable[[], Diagnostic]]]:
    """Solves in which the errors of a clause are uneven, with what says so."""
    owners = () if portion.consensus or portion.most < TELLING_ROWS else told_apart(problem, stack.equations)
    if not owners:
        return
    leverage, deviations = np.einsum("kmn,kmn->km", basis, basis), portion.deviations()
    for owner in owners:
        sides: list[Floats | None] = []
        numbers: list[Indices | None] = []
        for number, group in enumerate(stack.equations.groups):
            lines = stack.lines(number, which)[1]
            side = measured_side(problem, group, stack.tables, lines) if group.kernel.owner == owner else None
            sides.append(side)
            numbers.append(None if side is None else table_rows(problem, group, stack.tables, lines)[:, None])
        measured, rows = portion.by_slot(sides), portion.by_slot(numbers, missing=-1)
        counts = (rows >= 0).sum(axis=1)
        errors = residuals * deviations
        fitted = measured + errors
        for count in np.unique(counts[counts >= TELLING_ROWS]).tolist():
            solves = np.flatnonzero(counts == count)
            there = None if count == portion.most else np.nonzero(rows[solves] >= 0)[1].reshape(-1, count)
            at = solves if there is None else (solves[:, None], there)
            alike = Clauses(
                fitted=fitted[at],
                errors=errors[at],
                residuals=residuals[at],
                leverage=leverage[at],
                rows=rows[at],
            )
            for place, grown, correlation in alike.uneven(len(owners)):
                yield int(solves[place]), partial(uneven_clause, problem, owner, grown, correlation)


def _outlying(
    problem: Problem, stack: Stack, which: Which, portion: Portion, residuals: Floats, basis: Floats
) -> Iterator[tuple[int, Callable[[], Diagnostic]]]:
    """Solves in which one row makes unknown noise large, with what says so."""
    blocks = () if portion.consensus else pool(problem, stack.equations)
    if not blocks:
        return
    own = np.zeros(residuals.shape, dtype=bool)
    for owner in blocks:
        own[portion.block_slots(owner)] = True
    suspected = np.flatnonzero(suspects(residuals, np.square(basis).sum(axis=2), own))
    if not len(suspected):
        return
    sides: list[Floats | None] = []
    rows: list[Indices | None] = []
    owners: list[Indices | None] = []
    for number, group in enumerate(stack.equations.groups):
        lines = stack.lines(number, which)[1]
        mine = group.kernel.owner in blocks
        sides.append(measured_side(problem, group, stack.tables, lines) if mine else None)
        rows.append(table_rows(problem, group, stack.tables, lines)[:, None] if mine else None)
        owners.append(np.array([[group.kernel.owner]]))
    measured, numbers, owned = (portion.by_slot(each) for each in (sides, rows, owners))
    errors = residuals * portion.deviations()
    for place in suspected.tolist():
        at = np.flatnonzero(own[place])
        found = outlier(residuals[place, at], basis[place, at])
        if found is not None and has_noise(measured[place, at], errors[place, at]):
            slot = place, at[found.place]
            yield place, partial(outlying_row, problem, int(owned[slot]), int(numbers[slot]), found)


def _following(problem: Problem, stack: Stack, which: Which, portion: Portion) -> Indices | None:
    """The places (K, m) of the residuals after each, -1 for none; None where no rows are in order, or none is normal.

    Windows are stacked by time, and a solve by itself has its rows as the table has them.
    """
    if portion.consensus or stack.equations.likely:
        return None
    none = np.full(1, -1, dtype=np.int64)
    every = []
    for number, (owner, solve, slots) in enumerate(portion.groups()):
        positions, table = stack.equations.groups[number].positions, problem.blocks[owner].table
        after = none
        if in_order(problem, owner) and len(solve) > 1 and positions is not None and table is not None:
            rows = stack.tables[table].rows[positions[stack.lines(number, which)[1]]]
            same = solve[1:] == solve[:-1]
            sorted_already = bool((rows[1:] > rows[:-1])[same].all())
            order = slice(None) if sorted_already else np.lexsort((rows, solve))
            after = np.full(slots.shape, -1, dtype=np.int64)
            after[order] = np.vstack([np.where(same[:, None], slots[order][1:], -1), after[:1]])
        every.append(after)
    following = portion.by_slot(every, missing=-1)
    return following if bool((following >= 0).any()) else None
