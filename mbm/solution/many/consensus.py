"""Consensus of many data sets at once, then the fit to what agrees: `:robust` for the solves of ``for-each``."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mbm.problem.types import BlockRole, ConsensusKind, Problem
from mbm.solution.assembly import Assembled
from mbm.solution.many.descent import native_sets, plain_ends
from mbm.solution.many.stack import Stack
from mbm.solution.many.types import Descent, Ends, Kept
from mbm.solution.settings import Settings
from mbm.solution.types import Floats, Mask
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.solution.native.consensus import ConsensusEnds
    from mbm.solution.native.consensus_rules import Rules
    from mbm.solution.native.system import NativeSystem


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Ruled:
    """Consensus for the data sets of one group of equations.

    ``native`` has all data sets; ``known`` (units, width) is what a closed form knows of the units (None: nothing),
    ``startless`` that it gives the starts.
    """

    native: NativeSystem
    rules: Rules
    known: Floats | None
    startless: bool


def consensus_descent(
    problem: Problem, stack: Stack, first: Assembled, points: Floats, settings: Settings
) -> Descent | None:
    """What finds the units that agree and fits them; None where native code does not.

    Args:
        problem: the problem, which asks for consensus.
        stack: all solves; with one group of equations, whose noise is stated.
        first: the equations of one solve, from which closed forms are recognised.
        points: where each solve starts (T, N), NaN where a closed form is to say.
        settings: how to solve.
    """
    ruled = _ruled(problem, stack, first, points, settings)
    if ruled is None:
        return None
    from mbm.solution.native.consensus import consensus_many
    from mbm.solution.native.system import native_code

    cache = stack.equations.groups[0].cache
    code = native_code(cache.native, getattr(cache.backend, "store", None)).consensus
    unit_ends = np.concatenate([[0], np.cumsum(stack.rows[0] * len(stack.equations.groups[0].whiteners))])

    def descent(which: range) -> Ends:
        native, units = ruled.native, slice(unit_ends[which.start], unit_ends[which.stop])
        mine = replace(native, rows=replace(native.rows, data=native.rows.data[which.start : which.stop]))
        found = consensus_many(
            mine,
            code,
            ruled.rules,
            points[which.start : which.stop, None],
            None if ruled.known is None else ruled.known[units],
            startless=ruled.startless,
        )
        kept, good = _kept(stack, which, found)
        ends = plain_ends(_of_kept(stack, which, mine, kept).solve(found.points, np.arange(len(which))))
        return replace(ends, reason=np.where(good, ends.reason, -1), kept=kept)

    return descent


def _ruled(problem: Problem, stack: Stack, first: Assembled, points: Floats, settings: Settings) -> _Ruled | None:
    from mbm.solution.native.agreeing import left_out
    from mbm.solution.native.consensus_forms import known_form
    from mbm.solution.native.consensus_rules import NO_FORM, rules_of
    from mbm.solution.robust.consensus import SAMPLE
    from mbm.solution.robust.parts import parts_of

    if settings.robust is None or len(stack.equations.groups) != 1:
        return None
    if any(block.role is not BlockRole.OBSERVATION or block.unknown_factor for block in problem.blocks):
        return None
    if int(stack.residuals.max(initial=0)) > SAMPLE or left_out(stack.equations.groups[0]):
        return None
    if first.dimension > 1 and len(parts_of(first)) > 1:
        return None
    native = native_sets(stack, settings)
    if native is None:
        return None
    form = known_form(first, settings.closed_forms)
    known = None
    if form is not None:
        # forms whose data do not follow from the rows alone are left to the general path
        known = form.of_rows(stack.equations, (True,), settings.closed_forms) if form.maps is not None else None
        if known is None:
            return None
    startless = not bool(np.isfinite(points).all()) or bool(stack.equations.layout.guessed.any())
    if startless and (form is None or settings.robust.kind is ConsensusKind.GNC):  # whose starts decide more
        return None
    rules = rules_of(
        problem,
        first,
        settings.robust,
        (True,),
        seed=settings.seed,
        starts=1,
        form=NO_FORM if form is None else form.form,
    )
    return _Ruled(native=native, rules=rules, known=known, startless=startless)


def _kept(stack: Stack, which: range, found: ConsensusEnds) -> tuple[Kept, Mask]:
    """What agrees in each solve, and the solves (K,) in which that is plainly so."""
    from mbm.solution.robust.consensus import LEAST_SHARE
    from mbm.solution.robust.units import consistency
    from mbm.target.solver import consensus_description as c

    whiteners = stack.equations.groups[0].whiteners
    sizes = np.array([each.last - each.first for each in whiteners])
    rows = stack.rows[0, which.start : which.stop]
    units = np.diff(found.units_at)
    solve = np.repeat(np.arange(len(which)), units)
    ratio = found.limits / found.variances
    kappa = consistency(np.tile(sizes, int(rows.sum())), np.where(np.isfinite(ratio), ratio, 0.0))
    there = units > 0
    least, most = np.ones(len(which)), np.ones(len(which))
    least[there] = np.minimum.reduceat(kappa, found.units_at[:-1][there])
    most[there] = np.maximum.reduceat(kappa, found.units_at[:-1][there])
    agreeing = np.bincount(solve, weights=found.inside, minlength=len(which))
    good = found.agreed & (found.states[:, c.AMBIGUOUS] == 0) & (least == most) & there
    good &= agreeing >= np.maximum(LEAST_SHARE * units, 1)
    count = np.bincount(solve, weights=found.inside * np.tile(sizes, int(rows.sum())), minlength=len(which))
    # a solve that no more scalars than unknowns could contradict is not asked for agreement by the general path
    good &= rows * int(sizes.sum()) > stack.equations.dimension
    inside = found.inside.reshape(-1, len(whiteners))
    return Kept(outputs=np.repeat(inside, sizes, axis=1), information=least, count=count.astype(np.int64)), good


def _of_kept(stack: Stack, which: range, native: NativeSystem, kept: Kept) -> NativeSystem:
    """The data sets of these solves without what does not agree."""
    from mbm.target.solver import description as of

    whiteners = stack.equations.groups[0].whiteners
    first = int(stack.first[0, which.start])
    width = int(native.system[int(native.system[of.BLOCKS_AT]) + of.BLOCK_WEIGHTS])
    spread = [np.repeat(kept.outputs[:, each.first], each.weights[0].size) for each in whiteners]
    mask = np.hstack([part.reshape(len(kept.outputs), -1) for part in spread])
    begin = first * width
    weights = native.rows.weights[begin : begin + mask.size] * mask.ravel()
    data = native.rows.data.copy()
    data[:, of.DATA_COUNT] = kept.count
    data[:, of.DATA_HEAD + of.DATA_WEIGHTS] -= begin
    rows = replace(native.rows, weights=np.append(weights, 0.0), data=data)
    return replace(native, rows=rows)
