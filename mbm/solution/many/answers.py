"""The ends of many descents → what is known of them, in columns, and which of them need a look by themselves."""

from __future__ import annotations

from collections.abc import Sequence
from time import perf_counter

import numpy as np

from mbm.problem.types import Problem
from mbm.solution.challenge import USUAL
from mbm.solution.many.derived import derived_columns
from mbm.solution.many.doubts import doubtful
from mbm.solution.many.factor import factors
from mbm.solution.many.losses import outlying, rooted_slopes, sandwiches
from mbm.solution.many.stack import Portion, Stack
from mbm.solution.many.tails import chi_square_tails
from mbm.solution.many.types import REASONS, Columns, Descent, Ends, Outliers
from mbm.solution.plausibility import IMPROBABLE
from mbm.solution.types import Floats, Indices, Mask


@np.errstate(all="ignore")
def answers(problem: Problem, stack: Stack, which: range, descent: Descent) -> Columns:
    """The answers of some consecutive solves."""
    began = perf_counter()
    ends = descent(which)
    portion = Portion(stack, which, ends.kept)
    count, information = stack.residuals[which.start : which.stop], np.ones(len(which))
    if ends.kept is not None:
        count, information = ends.kept.count, ends.kept.information
    residuals, slopes = portion.linearised(ends.points)
    lossy = stack.equations.lossy
    found = factors(rooted_slopes(portion, residuals, slopes) if lossy else slopes)
    solved = _converged(ends) & found.good & np.isfinite(ends.cost) & ~ends.held
    freedom = count - stack.equations.dimension
    solved &= freedom >= 0
    stated = not any(block.unknown_factor for block in problem.blocks)
    noise = np.ones(len(which))
    if not stated:
        solved &= (freedom > 0) & (ends.cost > 0.0)
        noise = np.sqrt(ends.cost / np.maximum(freedom, 1))
    spread = noise / np.sqrt(information)
    factor, cost, looked_at = found.root * spread[:, None, None], ends.cost, np.ones(len(which), dtype=bool)
    if lossy:
        bread = sandwiches(portion, residuals, slopes, found.root)
        factor, cost, looked_at = bread.factor, np.square(residuals).sum(axis=1), bread.plain
        spread = bread.deviation
        solved &= bread.sound & np.isfinite(cost)
    derived = tuple(
        derived_columns(quantity, owner, stack, ends.points, factor) for owner, quantity in enumerate(problem.derived)
    )
    solved &= _all_finite([one.sigma for one in derived], len(which))
    sigma0 = np.where(freedom > 0, np.sqrt(cost / np.maximum(freedom, 1)), np.nan)
    tested = stated and not lossy
    chi2_p = _tails(cost / information, freedom, solved) if tested else np.full(len(which), np.nan)
    clean = solved & ~(chi2_p < IMPROBABLE)
    clean &= ~doubtful(problem, portion, ends, found, spread, derived, residuals, looked_at)
    return Columns(
        points=ends.points,
        cost=cost,
        robust_cost=ends.cost,
        offset=ends.offset,
        reason=ends.reason,
        iterations=ends.iterations,
        evaluations=ends.evaluations,
        dof=freedom,
        sigma0=sigma0,
        chi2_p=chi2_p,
        noise=noise,
        sigma=np.sqrt(np.square(factor).sum(axis=2)),
        factor=factor,
        root=found.root,
        scale=found.scale,
        derived=tuple((one.values, one.sigma, one.image) for one in derived),
        rms=_mean_roots(problem, portion, residuals) / noise[:, None],
        used=_used(problem, stack, which, ends),
        outliers=_outliers(problem, stack, which, _bad_rows(portion, ends, residuals)),
        clean=clean,
        solved=solved,
        expected=_expected(ends, freedom, stated=stated, lossy=lossy),
        seconds=np.full(len(which), (perf_counter() - began) / len(which)),
    )


def _mean_roots(problem: Problem, portion: Portion, residuals: Floats) -> Floats:
    """Root mean squares of the residuals of each block (K, blocks); NaN where it has none."""
    found = np.empty((portion.count, len(problem.blocks)))
    for owner in range(len(problem.blocks)):
        solve, slot = portion.block_slots(owner)
        squares = np.bincount(solve, weights=np.square(residuals[solve, slot]), minlength=portion.count)
        found[:, owner] = np.sqrt(squares / np.bincount(solve, minlength=portion.count))
    return found


def _converged(ends: Ends) -> Mask:
    converged = np.array([reason.converged for reason in REASONS])
    return np.asarray((ends.reason >= 0) & converged[ends.reason])


def _expected(ends: Ends, freedom: Indices, *, stated: bool, lossy: bool) -> Mask:
    """Solves (K,) that `challenge` leaves alone: outliers are no surprise, or they fit as stated noise lets expect."""
    if ends.kept is not None or lossy or not stated:
        return np.full(len(freedom), ends.kept is not None or lossy)
    usual = np.maximum(freedom, 1)
    return np.asarray(ends.cost < usual + USUAL * np.sqrt(2.0 * usual))


def _used(problem: Problem, stack: Stack, which: range, ends: Ends) -> Indices:
    """Rows (K, blocks) of which some equation counts."""
    used = stack.used(len(problem.blocks))[which.start : which.stop]
    if ends.kept is not None:
        solve = np.repeat(np.arange(len(which)), stack.rows[0, which.start : which.stop])
        counts = np.bincount(solve, weights=ends.kept.outputs.any(axis=1), minlength=len(which))
        used[:, stack.equations.groups[0].kernel.owner] = counts.astype(np.int64)
    return used


def _bad_rows(portion: Portion, ends: Ends, residuals: Floats) -> Mask | None:
    """The rows (R,) of which an equation was left out, or is far off under a loss; None if none are looked for."""
    if ends.kept is not None:
        return ~np.asarray(ends.kept.outputs.all(axis=1), dtype=bool)
    return outlying(portion, residuals) if portion.equations.lossy else None


def _outliers(problem: Problem, stack: Stack, which: range, wrong: Mask | None) -> Outliers | None:
    """The rows that are ``wrong`` (R,), by solve."""
    group = stack.equations.groups[0]
    table = problem.blocks[group.kernel.owner].table
    if wrong is None or table is None or group.positions is None:
        return None
    rows = stack.rows[0, which.start : which.stop]
    solve = np.repeat(np.arange(len(which)), rows)
    bad = np.flatnonzero(wrong)
    ends = np.cumsum(np.bincount(solve[bad], minlength=len(which)))
    return Outliers(
        table=stack.tables[table],
        positions=group.positions[int(stack.first[0, which.start]) + bad],
        first=np.concatenate([np.zeros(1, dtype=np.int64), ends]),
    )


def _tails(cost: Floats, freedom: Indices, solved: Mask) -> Floats:
    """P(χ² > cost) (K,); NaN without degrees of freedom, and where nothing is solved."""
    result = np.full(len(cost), np.nan)
    asked = solved & (freedom > 0)
    result[asked] = chi_square_tails(cost[asked], freedom[asked])
    return result


def _all_finite(parts: Sequence[Floats], count: int) -> Mask:
    found = np.ones(count, dtype=bool)
    for part in parts:
        found &= np.isfinite(part).all(axis=1)
    return found
