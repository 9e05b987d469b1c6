"""Unknown noises in many solves: the rounds of `variance.Helmert`, side by side, and degrees of freedom."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.losses import rooted_slopes
from mbm.equations.manifolds import of_arrays
from mbm.equations.metric import magnitudes_at
from mbm.equations.types import Floats, Indices
from mbm.estimation.batches.descent import native_sets, plain_ends, weighted
from mbm.estimation.batches.factor import Spread, factors
from mbm.estimation.batches.portion import DerivedColumns, Portion
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import DegreesColumns, Ends, Kept, Solver, Which
from mbm.estimation.settings import Settings
from mbm.estimation.solve.weighing import REWEIGHTED_SEARCHES
from mbm.estimation.starts.closed_forms.completion import plans
from mbm.estimation.starts.closed_forms.types import Situation
from mbm.estimation.uncertainty.degrees import freedoms_of
from mbm.estimation.uncertainty.variance import Helmert, Shares, starting_factors
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
        self.lost = ~self.ends.minima

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
            (ends.reason, found.reason),
            (ends.held, found.held),
        ):
            target[which] = own
        self.ends = replace(ends, iterations=iterations, evaluations=evaluations)
        limit = (REWEIGHTED_SEARCHES - 1) * self._settings.max_iterations  # beyond, the general path cuts rounds short
        self.lost[which] |= ~found.minima | (iterations[which] > limit)

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
        mine = np.stack([portion.of_blocks([owner]) for owner in self._unknown.tolist()])
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
            scattered /= portion.by_slot(kept.left)
        lossy = self._stack.equations.lossy
        slopes = rooted_slopes(portion.acting(), residuals, slopes) if lossy else slopes
        found = factors(slopes)
        self.lost[which] |= ~found.good
        redundancy = np.clip(1.0 - np.square(found.basis).sum(axis=2), 0.0, 1.0)
        return portion, scattered, slopes, redundancy

    def _told(self, which: Indices) -> Shares:
        """What K solves tell of the groups of unknown noise."""
        portion, scattered, slopes, redundancy = self._linearised(which)
        equations, mine = (
            self._stack.equations,
            np.stack([portion.of_blocks([owner]) for owner in self._unknown.tolist()]),
        )
        sizes = magnitudes_at(self.ends.points[which], equations.layout.number[equations.free])
        terms = np.square(slopes * sizes[:, None]).sum(axis=2)
        squares, checked, made_of = (np.where(mine, each, 0.0).sum(axis=2).T for each in (scattered, redundancy, terms))
        return squares, checked, made_of


def informing_slopes(stack: Stack, which: Which, ends: Ends, slopes: Floats) -> Floats:
    """Derivatives (K, m, n) whose squares are the Fisher information; ``slopes`` where there is no likelihood."""
    if not stack.equations.likely:
        return slopes
    told = replace(stack, equations=stack.equations.informing())
    return Portion(told, which, ends.kept, ends.factors).linearised(ends.points)[1]


@np.errstate(all="ignore")
def degrees_columns(
    problem: Problem,
    portion: Portion,
    spread: Spread,
    derived: tuple[DerivedColumns, ...],
    fit: tuple[Floats, Floats],
    limits: Floats,
) -> DegreesColumns:
    """The degrees of freedom of K solves; ``fit`` and ``limits`` as for `freedoms_of`.

    With several noises the factor of the covariance that is estimated is 1, so that the basis of the ``spread`` is the
    whitened Jacobian times the factor of the covariance.
    """
    told = tuple((owner,) for owner, block in enumerate(problem.blocks) if block.unknown_factor)
    found = freedoms_of(
        portion.equations,
        told,
        fit,
        spread.factor,
        lambda: (portion, spread.basis, limits),
        every=not several_noises(problem),
        consensus=portion.consensus,
    )
    return DegreesColumns(
        estimates=found.of_images(spread.factor),
        derived=tuple(found.of_images(one.image) for one in derived),
        poor=found.poor,
    )
