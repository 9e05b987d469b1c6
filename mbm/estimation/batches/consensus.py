"""Consensus of many data sets at once, then the fit: `:robust`, and losses whose minimum may hide behind others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.components import Beginnings, Rounds, several_noises, told_by_residuals
from mbm.estimation.batches.descent import native_sets, plain_ends, weighted
from mbm.estimation.batches.portion import Portion
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import Ends, Kept, Solver, Which, places_of
from mbm.estimation.consensus.types import Asked, observed, with_loss
from mbm.estimation.settings import Settings
from mbm.problem.kinds import ConsensusKind
from mbm.problem.types import Consensus, Problem
from mbm.solver.decisions import CONSENSUS_ROUNDING, LEAST_SHARE, MANY_CONNECTED
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.estimation.consensus.native import ConsensusEnds
    from mbm.estimation.consensus.rules import Rules
    from mbm.estimation.minimise.native.system import NativeSystem
    from mbm.estimation.native.code import AnyCode


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Ruled:
    """Consensus for the data sets of a stack.

    ``native`` has all data sets, ``acting`` says which groups have units that may be left out; ``known`` (units, width)
    is what a closed form knows of the units of all groups (None: nothing), ``startless`` that it gives the starts,
    ``whole`` (T,) which data sets no part of is connected with nothing else: others are brought to agreement in parts.
    """

    stack: Stack
    native: NativeSystem
    code: AnyCode
    rules: Rules
    acting: tuple[bool, ...]
    known: Floats | None
    startless: bool
    whole: Mask
    settings: Settings

    def agree(self, which: Which, points: Floats) -> tuple[ConsensusEnds, Indices, Indices]:
        """What agrees in some solves, and solve and group of each unit (U,)."""
        from mbm.estimation.consensus.native import Begun, consensus_many

        mine = replace(self.native, rows=replace(self.native.rows, data=self.native.rows.data[places_of(which)]))
        solve, group, unit = self.stack.units(which, self.acting)
        known = None if self.known is None else self.known[unit]
        found = consensus_many(
            mine,
            self.code,
            self.rules,
            Begun(starts=points[:, None], forms=known, startless=self.startless),
            stopped=self.settings.stopped,
        )
        return found, solve, group


def consensus_solver(
    problem: Problem, stack: Stack, first: Assembled, points: Floats, settings: Settings
) -> Solver | None:
    """What finds the units that agree and fits them; None where native code does not.

    Args:
        problem: the problem, which asks for consensus.
        stack: all solves.
        first: the equations of one solve, from which closed forms are recognised.
        points: where the solves are to start (T, N), NaN where a closed form is to say.
        settings: how to solve.
    """
    if settings.robust is None or any(group.losses for group in stack.equations.groups):
        return None
    asked = Asked(problem=problem, settings=settings, consensus=settings.robust, ruled=observed)
    ruled = _ruled(asked, stack, first, points)
    if ruled is None:
        return None
    several, unknown = several_noises(problem), told_by_residuals(problem)

    def solve(which: Which, begun: Floats) -> Ends:
        found, owner, group = ruled.agree(which, begun)
        kept, good = _kept(ruled, which, found, owner, group, estimated=bool(len(unknown)))
        if several:
            factors = np.ones((len(which), len(problem.blocks)))
            begin = Beginnings(places=np.asarray(which), points=found.points, factors=factors, kept=kept)
            rounds = Rounds(stack, ruled.native, settings, unknown, begin)
            rounds.lost |= ~good
            return rounds.done()
        every, mine = np.arange(len(which)), weighted(stack, ruled.native, which, kept)
        ends = plain_ends(mine.solve(found.points, every, stopped=settings.stopped))
        return replace(ends, reason=np.where(good, ends.reason, -1), kept=kept)

    return solve


def loss_solver(problem: Problem, stack: Stack, first: Assembled, points: Floats, settings: Settings) -> Solver | None:
    """What fits with losses that are not convex, or of unknown noise, from the least median of squares; None as above.

    The arguments are those of `consensus_solver`, all points being known. The factors of unknown noise that go with
    losses are estimated from what agrees, once and for all, as `robust.consensus.scaled` does; those of other noise
    from the residuals of the fits that follow.
    """
    from mbm.estimation.consensus.units import without_losses
    from mbm.solver import consensus_records as c

    plain = replace(stack, equations=without_losses(stack.equations))
    consensus = Consensus(kind=ConsensusKind.LMEDS)
    asked = Asked(problem=problem, settings=settings, consensus=consensus, ruled=with_loss)
    ruled = _ruled(asked, plain, without_losses(first), points)
    lossy = native_sets(stack, settings)
    if ruled is None or lossy is None:
        return None

    scaled = tuple(i for i, block in enumerate(problem.blocks) if block.unknown_factor and block.loss is not None)
    unknown = told_by_residuals(problem)
    convex = all(loss.convex for group in stack.equations.groups for loss in group.losses)

    def solve(which: Which, begun: Floats) -> Ends:
        found, solve_of, group = ruled.agree(which, begun)
        # without enough equations no minimal subset gives a start, and the general path begins at a plain fit
        agreed = found.agreed & (stack.residuals[places_of(which)] >= first.dimension)
        agreed &= ruled.whole[places_of(which)]
        agreed &= (found.states[:, c.Verdict.ambiguous] == 0) | convex  # the general path warns of it
        places = np.asarray(which)
        if not scaled and not len(unknown):
            ends = plain_ends(lossy.solve(found.points, places))
            return replace(ends, reason=np.where(agreed, ends.reason, -1))
        factors, told = _factors(ruled, which, found, (solve_of, group), scaled, len(problem.blocks))
        begin = Beginnings(places=places, points=found.points, factors=factors)
        rounds = Rounds(stack, lossy, settings, unknown, begin)
        rounds.lost |= ~(agreed & told)
        return rounds.done()

    return solve


def _ruled(asked: Asked, stack: Stack, first: Assembled, points: Floats) -> _Ruled | None:
    from mbm.estimation.consensus.consensus import SAMPLE
    from mbm.estimation.consensus.forms import known_form
    from mbm.estimation.consensus.rules import NO_FORM, rules_of
    from mbm.estimation.native.code import native_code

    settings, groups, acting = asked.settings, stack.equations.groups, asked.acting(stack.equations)
    if int(stack.residuals.max(initial=0)) > SAMPLE or not any(acting):
        return None
    ruled = [group for group, mine in zip(groups, acting, strict=True) if mine]
    if any(group.positions is None or group.left_out.any() for group in ruled):
        return None
    whole = _in_one_piece(stack)
    if first.dimension > MANY_CONNECTED or not whole.any():
        return None
    native = native_sets(stack, settings)
    if native is None:
        return None
    form = known_form(first, settings.closed_forms)
    known = None
    if form is not None:
        # forms whose data do not follow from the rows alone are left to the general path
        every = (True,) * len(groups)
        known = form.of_rows(stack.equations, every, settings.closed_forms) if form.maps is not None else None
        if known is None:
            return None
    startless = not bool(np.isfinite(points).all()) or bool(stack.equations.layout.guessed.any())
    if startless and (form is None or asked.consensus.kind is ConsensusKind.GNC):  # whose starts decide more
        return None
    return _Ruled(
        stack=stack,
        settings=settings,
        native=native,
        code=native_code(groups[0].cache).consensus,
        rules=rules_of(asked, first, acting, form=NO_FORM if form is None else form.form),
        acting=acting,
        known=known,
        startless=startless,
        whole=whole,
    )


@np.errstate(all="ignore")
def _factors(
    ruled: _Ruled,
    which: Which,
    found: ConsensusEnds,
    units: tuple[Indices, Indices],
    scaled: Sequence[int],
    blocks: int,
) -> tuple[Floats, Mask]:
    """The noise factors (K, blocks) of the ``scaled`` blocks (1 of others), and where what agrees tells them for sure.

    ``units`` are the solve and the group of each unit.
    """
    count, equations, (solve, group) = len(which), ruled.stack.equations, units
    portion = Portion(ruled.stack, which)
    residuals, slopes = portion.linearised(found.points)
    places = equations.layout.number[equations.free]
    numbers = np.abs(np.where(places >= 0, found.points[:, places], 0.0))
    terms = np.abs(residuals) + np.einsum("kmn,kn->km", np.abs(slopes), numbers)
    agreeing = np.zeros(count)
    for number, each in enumerate(equations.groups):
        mine = np.flatnonzero(group == number)
        sizes = np.array([w.last - w.first for w in each.whiteners])
        components = np.tile(sizes, len(mine) // max(len(sizes), 1))
        agreeing += np.bincount(solve[mine], weights=found.inside[mine] * components, minlength=count)
    factors, told = np.ones((count, blocks)), agreeing > equations.dimension
    owners = np.array([each.kernel.owner for each in equations.groups])[group]
    for owner in scaled:
        mine = np.flatnonzero(owners == owner)
        size = np.bincount(solve[mine], minlength=count)
        variance = np.bincount(solve[mine], weights=found.variances[mine], minlength=count) / size
        inside = np.bincount(solve[mine], weights=found.inside[mine], minlength=count)
        where, slot = portion.block_slots(owner)
        largest = np.zeros(count)
        np.maximum.at(largest, where, terms[where, slot])
        own = (inside > 0) & (variance > np.square(CONSENSUS_ROUNDING * largest))
        factors[:, owner] = np.where(own, np.sqrt(variance), 1.0)
        told &= own
    return factors, told


def _kept(
    ruled: _Ruled, which: Which, found: ConsensusEnds, solve: Indices, group: Indices, *, estimated: bool
) -> tuple[Kept, Mask]:
    """What agrees in each solve, and the solves (K,) in which that is plainly so; ``estimated``: some noise is."""
    from mbm.estimation.consensus.units import consistency
    from mbm.solver import consensus_records as c

    stack, count = ruled.stack, len(which)
    outputs: list[Mask | None] = []
    left: list[Floats | None] = []
    information: list[Floats | None] = []
    kept, scalars, inliers = np.zeros(count), np.zeros(count), np.zeros(count)
    for number, (each, mine) in enumerate(zip(stack.equations.groups, ruled.acting, strict=True)):
        rows = stack.rows[number, places_of(which)]
        if not mine:
            outputs.append(None)
            left.append(None)
            information.append(None)
            kept += rows * each.kernel.outputs
            continue
        sizes = np.array([w.last - w.first for w in each.whiteners])
        units = np.flatnonzero(group == number)
        ratio = found.limits[units] / found.variances[units]
        lines = (-1, len(sizes))
        components = np.tile(sizes, len(units) // len(sizes))
        kappa = consistency(components, np.where(np.isfinite(ratio), ratio, 0.0))
        outputs.append(np.repeat(found.inside[units].reshape(lines), sizes, axis=1))
        left.append(np.repeat(kappa.reshape(lines), sizes, axis=1))
        information.append(np.repeat(found.information[units].reshape(lines), sizes, axis=1))
        inliers += np.bincount(solve[units], weights=found.inside[units] * components, minlength=count)
        scalars += rows * int(sizes.sum())
    every = np.bincount(solve, minlength=count)
    agreeing = np.bincount(solve, weights=found.inside, minlength=count)
    good = found.agreed & (found.states[:, c.Verdict.ambiguous] == 0) & (every > 0)
    good &= ruled.whole[places_of(which)]
    good &= agreeing >= np.maximum(LEAST_SHARE * every, 1)
    if estimated:  # what is fitted exactly has no noise, and roundings decide which of such fits is taken
        good &= inliers > stack.equations.dimension
    if not ruled.startless:
        # a solve that no more scalars than unknowns could contradict is not asked for agreement by the general path
        good &= scalars > stack.equations.dimension
    every_kept = (kept + inliers).astype(np.int64)
    told = Kept(outputs=tuple(outputs), left=tuple(left), information=tuple(information), count=every_kept)
    return told, good


def _in_one_piece(stack: Stack) -> Mask:
    """The solves (T,) in which equations connect all coordinates."""
    from mbm.estimation.consensus.parts import connections

    equations, solves = stack.equations, stack.solves
    place = equations.columns
    touched = []
    for number, group in enumerate((*equations.groups, *equations.constraints)):
        columns = place[group.touched]
        if len(columns) == 1:  # all rows alike
            solve = np.flatnonzero(stack.rows[number] > 0)
        else:
            solve, rows = stack.lines(number, range(solves))
            columns = columns[rows]
        touched.append(np.where(columns >= 0, columns + equations.dimension * solve[:, None], -1))
    label = connections(touched, equations.dimension * solves).reshape(solves, equations.dimension)
    return np.asarray((label == label[:, :1]).all(axis=1), dtype=bool)
