"""Unknown noises in many solves: the rounds of `variance.Helmert`, side by side, and degrees of freedom."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.likelihoods import Readings, larger, likely, untested
from mbm.equations.manifolds import of_arrays
from mbm.equations.metric import magnitudes_at
from mbm.equations.spreads import Freedom
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.descent import native_sets, plain_ends, weighted
from mbm.estimation.batches.factor import Spread, factors, rooted_slopes
from mbm.estimation.batches.portion import DerivedColumns, Portion
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import REASONS, DegreesColumns, Ends, Kept, Solver, Which
from mbm.estimation.settings import Settings
from mbm.estimation.solve.weighing import REWEIGHTED_SEARCHES
from mbm.estimation.starts.closed_forms.completion import plans
from mbm.estimation.starts.closed_forms.types import Situation
from mbm.estimation.uncertainty.degrees import (
    LEAST,
    effective,
    enough,
    few_told,
    of_scale,
    scaled,
    scaled_blocks,
    untold,
)
from mbm.estimation.uncertainty.variance import Helmert, Shares, starting_factors
from mbm.problem.likelihoods.types import SHIFT
from mbm.problem.types import BlockRole, Problem
from mbm.solver.noise_factors import NOISE_ROUNDS, starting
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.estimation.batches.forms import Formed
    from mbm.estimation.minimise.native.system import NativeSystem


def several_noises(problem: Problem) -> bool:
    """Whether some noise is unknown, and not all rows share it."""
    measured = [block for block in problem.blocks if block.role is not BlockRole.CONSTRAINT]
    return len(measured) > 1 and any(block.unknown_factor for block in measured)


def estimated_on_the_way(problem: Problem) -> bool:
    """Whether factors of unknown noise are known before the last fit: several, or one that a loss goes with."""
    lossy = any(block.unknown_factor and block.loss is not None for block in problem.blocks)
    return several_noises(problem) or lossy


def components_solver(
    problem: Problem, stack: Stack, first: Assembled, form: Callable[[], Formed | None], settings: Settings
) -> Solver | None:
    """What finds minima with noise factors that fit the residuals; None where native code or closed forms do not.

    ``form`` is the closed form that may fit better than a stated start leads to, but for losses. What is not plain is
    left to the general path: groups without redundancy, fitted exactly, or that do not settle.
    """
    native = native_sets(stack, settings)
    single = stack.equations.linear or stack.equations.lossy
    challenger = None if stack.equations.lossy else form()
    if native is None or (challenger is None and not single and _recognised(first, settings)):
        return None
    unknown = told_by_residuals(problem)

    def solve(which: Which, points: Floats) -> Ends:
        places = np.asarray(which)
        begin = Beginnings(places=places, points=points, factors=np.ones((len(places), len(problem.blocks))))
        rounds = Rounds(stack, native, settings, unknown, begin)
        if challenger is not None:
            rounds.lost |= challenger.best(places)[1] < rounds.ends.cost
        return rounds.done()

    return solve


def told_by_residuals(problem: Problem) -> Indices:
    """The blocks whose noise factor is that of their residuals: those of unknown noise without a loss."""
    found = [i for i, block in enumerate(problem.blocks) if block.unknown_factor and block.loss is None]
    return np.array(found, dtype=np.int64)


def _recognised(first: Assembled, settings: Settings) -> bool:
    """Whether a closed form is made for some of the unknowns."""
    numbers = np.where(first.moving(), np.nan, first.numbers)
    situation = Situation(layout=first.layout, groups=first.groups, numbers=numbers)
    return next(plans(situation, settings.closed_forms), None) is not None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beginnings:
    """Where K solves of a stack, at ``places`` (K,), begin: ``points`` (K, N), ``factors`` (K, blocks) of the noise.

    ``kept`` is what consensus left in (None: everything).
    """

    places: Indices
    points: Floats
    factors: Floats
    kept: Kept | None = None


class Rounds:
    """Minimisations of K solves, again for each round; those that are not plain are ``lost``.

    The factors of the ``unknown`` blocks are 1 at first; those of other blocks stay.
    """

    def __init__(
        self, stack: Stack, native: NativeSystem, settings: Settings, unknown: Indices, begin: Beginnings
    ) -> None:
        self._stack = stack
        self._native = native
        self._settings = settings
        self._unknown = unknown
        self._places = begin.places
        self._factors = begin.factors.copy()
        self._noise = Helmert(np.ones((len(begin.places), len(unknown))))
        self._kept = begin.kept
        self._rows = [stack.lines(number, begin.places)[0] for number in range(len(stack.equations.groups))]
        self.ends = self._minima(np.arange(len(begin.places)), begin.points)
        self.lost = ~_converged(self.ends)

    @np.errstate(all="ignore")
    def done(self) -> Ends:
        """The minima with factors that are settled."""
        active = np.flatnonzero(~self.lost & bool(len(self._unknown)))
        self._start(active)
        active = active[~self.lost[active]]
        for number in range(NOISE_ROUNDS):
            if not len(active) or self._settings.stopped():
                break
            if number:
                self._minimise(active)
            settled, sound = self._noise.advance(active, self._told(active))
            self._factors[np.ix_(active, self._unknown)] = self._noise.factors[active]
            self.lost[active] |= ~sound | (self._noise.exact | self._noise.untold)[active].any(axis=1)
            self._minimise(active[settled & ~self.lost[active]])
            active = active[~settled & ~self.lost[active]]
        self.lost[active] = True
        reason = np.where(self.lost, -1, self.ends.reason)
        return replace(self.ends, reason=reason, factors=self._factors, kept=self._kept)

    def _minimise(self, which: Indices) -> None:
        """From where the solves are, with their factors as they are now."""
        if not len(which):
            return
        found = self._minima(which, self.ends.points[which])
        ends = self.ends
        iterations, evaluations = ends.iterations.copy(), ends.evaluations.copy()
        iterations[which] += found.iterations
        evaluations[which] += found.evaluations
        for target, own in (
            (ends.points, found.points),
            (ends.cost, found.cost),
            (ends.offset, found.offset),
            (ends.reason, found.reason),
            (ends.held, found.held),
        ):
            target[which] = own
        self.ends = replace(ends, iterations=iterations, evaluations=evaluations)
        limit = (REWEIGHTED_SEARCHES - 1) * self._settings.max_iterations  # beyond, the general path cuts rounds short
        self.lost[which] |= ~_converged(found) | (iterations[which] > limit)

    def _minima(self, which: Indices, points: Floats) -> Ends:
        """The ends of some solves that begin at points (K, N), with their factors as they are now."""
        factors, places = self._factors[which], self._places[which]
        if self._kept is None and bool((factors == 1.0).all()):
            return plain_ends(self._native.solve(points, places))
        mine = weighted(self._stack, self._native, places, self._kept_in(which), factors)
        return plain_ends(mine.solve(points, np.arange(len(which))))

    def _kept_in(self, which: Indices) -> Kept | None:
        """What is kept in some solves."""
        return None if self._kept is None else self._kept.of(self._rows, which)

    def _start(self, which: Indices) -> None:
        """With the factors that are near the noise of others, where those of 1 are far from it."""
        if not len(which):
            return
        portion, _, slopes, redundancy = self._linearised(which)
        mine = self._in_groups(portion)
        squares = np.square(slopes)
        stated = np.asarray(~mine.any(axis=0))
        known = np.where(stated[:, :, None], squares, 0.0).sum(axis=1)
        far = np.zeros(len(which), dtype=bool)
        for rows in mine:
            own = np.where(rows[:, :, None], squares, 0.0).sum(axis=1)
            both = (own > 0.0) & (known > 0.0)
            others = np.where(both.any(axis=1, keepdims=True), known, squares.sum(axis=1) - own)
            ratio = np.where((own > 0.0) & (others > 0.0), own / others, np.nan)
            least, most = np.fmin.reduce(ratio, axis=1, initial=np.inf), np.fmax.reduce(ratio, axis=1, initial=0.0)
            left = np.where(rows, redundancy, 0.0).sum(axis=1)
            far |= of_arrays(starting)(least, most, left, rows.sum(axis=1).astype(float)) != 1.0
        for k in np.flatnonzero(far).tolist():
            groups = [np.flatnonzero(rows[k]) for rows in mine]
            self._noise.factors[which[k]] = starting_factors(slopes[k], redundancy[k], groups)
        moved = which[(self._noise.factors[which] != 1.0).any(axis=1)]
        self._factors[np.ix_(moved, self._unknown)] = self._noise.factors[moved]
        self._minimise(moved)

    def _linearised(self, which: Indices) -> tuple[Portion, Floats, Floats, Floats]:
        """The equations of some solves where they are: squared residuals (K, m), slopes (K, m, n) and redundancy."""
        kept = self._kept_in(which)
        portion = Portion(self._stack, self._places[which], kept, self._factors[which])
        residuals, slopes = portion.linearised(self.ends.points[which])
        scattered = np.square(residuals)
        if kept is not None:  # without the loss of the tails
            scattered /= portion.by_slot(kept.information)
        lossy = self._stack.equations.lossy
        slopes = rooted_slopes(portion, residuals, slopes) if lossy else slopes
        found = factors(slopes)
        self.lost[which] |= ~found.good
        redundancy = np.clip(1.0 - np.square(found.basis).sum(axis=2), 0.0, 1.0)
        return portion, scattered, slopes, redundancy

    def _in_groups(self, portion: Portion) -> Mask:
        """Which residuals belong to each unknown group, (groups, K, m)."""
        mine = np.zeros((len(self._unknown), portion.count, portion.most), dtype=bool)
        for own, owner in zip(mine, self._unknown.tolist(), strict=True):
            own[portion.block_slots(owner)] = True
        return mine

    def _told(self, which: Indices) -> Shares:
        """What K solves tell of the groups of unknown noise."""
        portion, scattered, slopes, redundancy = self._linearised(which)
        equations, mine = self._stack.equations, self._in_groups(portion)
        sizes = magnitudes_at(self.ends.points[which], equations.layout.number[equations.free])
        terms = np.square(slopes * sizes[:, None]).sum(axis=2)
        squares, checked, made_of = (np.where(mine, each, 0.0).sum(axis=2).T for each in (scattered, redundancy, terms))
        return squares, checked, made_of


def _converged(ends: Ends) -> Mask:
    converged = np.array([reason.converged for reason in REASONS])
    return np.asarray((ends.reason >= 0) & converged[ends.reason] & ~ends.held & np.isfinite(ends.cost))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Counted:
    """What K solves count: χ² and the number of its residuals, log L (None: no likelihood), whether χ² is none, by
    what factor it is `larger`, how many rows with an unknown scale are ``limits``, and the squares of residuals that
    are ``uncounted``.
    """

    cost: Floats
    rows: Indices
    log_likelihood: Floats | None
    untested: Mask
    larger: Floats
    limits: Floats
    uncounted: Floats

    def tested(self, scattered: Floats) -> Floats:
        """What stands against χ² (K,): ``scattered`` where there is no likelihood."""
        return scattered if self.log_likelihood is None else self.cost


def informing_slopes(stack: Stack, which: Which, ends: Ends, slopes: Floats) -> Floats:
    """Derivatives (K, m, n) whose squares are the Fisher information; ``slopes`` where there is no likelihood."""
    if not stack.equations.likely:
        return slopes
    told = replace(stack, equations=stack.equations.informing())
    return Portion(told, which, ends.kept, ends.factors).linearised(ends.points)[1]


def counted_of(stack: Stack, which: Which, residuals: Floats, rows: Indices) -> Counted:
    """What solves count of their plain ``residuals`` (K, m), of which they have so many ``rows`` (K,)."""
    squares = np.square(residuals)
    cost, none = squares.sum(axis=1), np.zeros(len(residuals), dtype=bool)
    if not stack.equations.likely:
        zeros, ones = np.zeros(len(cost)), np.ones(len(cost))
        return Counted(
            cost=cost, rows=rows, log_likelihood=None, untested=none, larger=ones, limits=zeros, uncounted=zeros
        )
    surprise, excess, lines, limits = (np.zeros(len(cost)) for _ in range(4))
    whole, taken = cost, np.zeros(len(cost), dtype=np.int64)
    every: dict[int, Readings] = {group.number: stated for group, stated in likely(stack.equations.groups)}
    for number, group in enumerate(stack.equations.groups):
        solve, places = stack.lines(number, which)
        count, outputs = np.bincount(solve, minlength=len(cost)), group.kernel.outputs
        stated = every.get(group.number)
        if stated is None:
            each = -np.log(np.hstack([_roots(w.weights[places]) for w in group.whiteners])) + 0.5 * np.log(2.0 * np.pi)
            surprise += np.bincount(solve, weights=each.sum(axis=1), minlength=len(cost))
        else:
            own = np.arange(len(solve)) - (np.cumsum(count) - count)[solve]
            slots = (taken[solve] + own * outputs)[:, None] + np.flatnonzero(stated.uncounted)
            left = np.bincount(solve, weights=squares[solve[:, None], slots].sum(axis=1), minlength=len(cost))
            cost = cost - left
            rows = rows - count * int(stated.uncounted.sum())
            surprise += np.bincount(solve, weights=stated.surprise[places], minlength=len(cost))
            surprise -= 0.5 * SHIFT * int(stated.shifted.sum()) * count
            excess += np.bincount(solve, weights=stated.excess[places], minlength=len(cost))
            lines += count
            if stated.scales:
                limits += np.bincount(solve, weights=stated.limits[places], minlength=len(cost))
        taken += count * outputs
    log_likelihood, none = -0.5 * whole - surprise, untested(excess, lines)
    return Counted(
        cost=cost,
        rows=rows,
        log_likelihood=log_likelihood,
        untested=none,
        larger=np.where(none, larger(excess, lines), 1.0),
        limits=limits,
        uncounted=whole - cost,
    )


def _roots(weights: Floats) -> Floats:
    """The diagonal (R, k) of weights."""
    return np.abs(weights if weights.ndim == 2 else np.diagonal(weights, axis1=1, axis2=2))


@np.errstate(all="ignore")
def degrees_columns(
    problem: Problem,
    portion: Portion,
    spread: Spread,
    derived: tuple[DerivedColumns, ...],
    cost: Floats,
    dof: Indices,
    tally: Counted,
) -> DegreesColumns:
    """The degrees of freedom of K solves, by the rules of `uncertainty.degrees.freedoms`.

    ``cost`` (K,) is that of the minima with the final weights, ``dof`` (K,) the redundancy, and ``tally`` what
    they count.

    With several noises the factor of the covariance that is estimated is 1, so that the basis of the ``spread`` is the
    whitened Jacobian times the factor of the covariance.
    """
    basis = spread.basis
    unknown = [owner for owner, block in enumerate(problem.blocks) if block.unknown_factor]
    images = [spread.factor, *(one.image for one in derived)]
    if not unknown or portion.equations.lossy or not several_noises(problem):
        if (sharing := scaled_blocks(portion.equations)) and not unknown:
            return _of_scale(portion, spread, images, sharing, tally.limits)
        told = bool(unknown) or portion.equations.lossy
        of_solve = np.maximum(dof.astype(np.float64), LEAST) if told else np.full(len(dof), inf)
        found = [_alike(of_solve, image.shape[:2]) for image in images]
        few: Mask = np.asarray(dof < enough(portion.equations, consensus=portion.consensus))
        poor = few if unknown or scaled(portion.equations) else np.zeros(len(dof), dtype=bool)
        return DegreesColumns(estimates=found[0], derived=tuple(found[1:]), poor=poor)
    grams = np.zeros((len(basis), len(unknown), basis.shape[2], basis.shape[2]))
    counts = np.zeros((len(basis), len(unknown)))
    for place, owner in enumerate(unknown):
        own = np.zeros(basis.shape[:2], dtype=bool)
        own[portion.block_slots(owner)] = True
        picked = np.where(own[:, :, None], basis, 0.0)
        grams[:, place] = np.matmul(picked.transpose(0, 2, 1), picked)
        counts[:, place] = own.sum(axis=1)
    misfit = cost / np.maximum(dof, 1)
    found = [effective(image, grams, counts, misfit) for image in images]
    poor = np.asarray(untold(spread.factor, grams, counts).any(axis=1))
    return DegreesColumns(estimates=found[0], derived=tuple(found[1:]), poor=poor)


def _of_scale(
    portion: Portion, spread: Spread, images: list[Floats], blocks: tuple[int, ...], limits: Floats
) -> DegreesColumns:
    """Those of K solves where some ``blocks`` share one unknown scale, and so many rows are ``limits`` (K,)."""
    told, count = np.zeros(portion.count), np.zeros(portion.count)
    for group, solve, slots in portion.bound_groups():
        if group.kernel.owner in blocks and group.readings is not None:
            each = np.square(spread.basis[solve[:, None], slots]).sum(axis=(1, 2))
            told += np.bincount(solve, weights=each, minlength=portion.count)
            count += np.bincount(solve, minlength=portion.count) * int(group.counting.sum())
    dof, inflation = of_scale(count, limits, told)
    found = [_alike(dof, image.shape[:2], inflation) for image in images]
    return DegreesColumns(estimates=found[0], derived=tuple(found[1:]), poor=dof < few_told(portion.equations))


def _alike(dof: Floats, shape: tuple[int, ...], inflation: Floats | float = 1.0) -> Freedom:
    growth = np.broadcast_to(inflation, len(dof))[:, None]
    return Freedom(dof=np.broadcast_to(dof[:, None], shape), inflation=np.broadcast_to(growth, shape))
