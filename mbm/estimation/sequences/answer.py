"""A walk over the steps of a problem → its solution: estimates, deviations, derived quantities, and doubts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled, loss_lines
from mbm.equations.binding import Group
from mbm.equations.manifolds import numbers_of_stated, tangent_slopes
from mbm.equations.types import Covariance, Fit, Floats, Indices, Mask, Minimum, Observability, Reason
from mbm.estimation.consensus.faults import too_few_agree
from mbm.estimation.consensus.preparation import outliers, unit_weights
from mbm.estimation.search.solution import DerivedSolution, Hypothesis, Solution
from mbm.estimation.sequences import faults
from mbm.estimation.sequences.deviations import ONE_AT_A_TIME, Deviations, joint
from mbm.estimation.sequences.lowering import of_no_step, steps_of
from mbm.estimation.sequences.own_steps import SEVERAL, OwnSteps
from mbm.estimation.sequences.places import Places
from mbm.estimation.sequences.spread import Told
from mbm.estimation.sequences.types import Prior, Rules, Track
from mbm.estimation.sequences.walk import Chained
from mbm.estimation.trust.behind import behind_at, turned_anyhow
from mbm.estimation.trust.fits import only
from mbm.estimation.trust.plausibility import IMPROBABLE
from mbm.estimation.uncertainty.degrees import common
from mbm.estimation.uncertainty.derived import reported, widths
from mbm.estimation.uncertainty.variance import fit_statistics
from mbm.kernels.types import KernelSet
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import BlockRole, Problem
from mbm.text.types import Diagnostic
from mbm.values import dataclass

FORMED = 2000
"""Coordinates up to which the covariance of all of them is a matrix."""


PROBABLE = 0.05
"""Share of all weight from which a hypothesis is told: what intervals of 95 % leave out."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Walked:
    """A walk, with the problem that it was for: the equations that were ``solved``, and those it is ``told`` with.

    ``together`` is what all rows determine, where that was looked at apart from the walk.
    """

    problem: Problem
    kernels: KernelSet
    tables: Mapping[str, Table]
    key: Mapping[str, CellKey]
    solved: Told
    told: Told
    chained: Chained
    prior: Prior
    rules: Rules
    track: Track
    together: Observability | None = None

    def as_together(self) -> Walked:
        """The same, in whose track nothing is known that all rows together do not determine."""
        together, track, places = self.together, self.track, self.solved.places
        if together is None or together.observable:
            return self
        loose = np.zeros(len(self.solved.equations.layout.number), dtype=bool)
        loose[self.solved.equations.free] = ~together.estimable
        opens = np.maximum(track.opens, together.dimension - together.rank)
        touched = track.touched | loose[places.coordinates[:, places.free]]
        return replace(self, track=replace(track, opens=opens, touched=touched))


def solution_of(walked: Walked, seconds: Callable[[], float]) -> Solution:
    """The solution that a walk gives. Plain unknowns are those after the last row, in rows those of their step."""
    walked = walked.as_together()
    equations, track, places = walked.told.equations, walked.track, walked.told.places
    own = OwnSteps.of(places, track.made)
    numbers = own.numbers(_numbers(walked), track.points)
    solved = walked.solved.equations
    groups = _placed(walked, own, equations.groups, solved.groups)
    free = np.union1d(equations.free, _free(places))
    sigma = _sigmas(walked)[free]
    covariance = _covariance(walked, free, sigma)
    derived, derived_covariance = _derived(walked, own)
    counted = replace(equations, groups=groups)
    residuals = counted.plain_residuals(numbers)
    reason = _reason(walked)
    # What losses leave of the squares of rows is in the cost of a walk, whatever these are beside the walk.
    rooted = counted.rooted(residuals)
    cost = track.cost + float(np.nansum(np.square(residuals) - np.square(rooted)))
    fit = _fit(walked, reason, cost)
    hypotheses = _hypotheses(walked, free)
    lost = int(track.opens[max(track.made - 1, 0)])
    return Solution(
        key=walked.key,
        lock=walked.solved.binder.cache.lock,
        tables=walked.tables,
        layout=equations.layout,
        groups=groups,
        constraints=_placed(walked, own, *_comparable(walked)),
        numbers=numbers,
        free=free,
        minimum=Minimum(
            point=numbers,
            residuals=residuals,
            jacobian=np.zeros((0, len(free))),
            cost=track.cost,
            reason=reason,
            iterations=track.iterations,
            evaluations=track.evaluations,
            at_bound=np.zeros(len(free), dtype=np.int8),
        ),
        residuals=residuals,
        weights=unit_weights(counted, residuals),
        outliers=outliers(counted, residuals),
        robust_cost=track.cost if equations.lossy else None,
        tally=None,
        origin="the prior of the first step",
        observability=_observability(walked, lost, np.isfinite(sigma), _scale(walked)[free]),
        covariance=covariance,
        derived_covariance=derived_covariance,
        derived=derived,
        fit=fit,
        noise={},
        factors=None,
        sigma_known=True,
        freedom=common(np.inf, sigma.shape),
        limited=None,
        unused=np.zeros(0, dtype=np.int64),
        hypotheses=hypotheses,
        followed=() if walked.rules.hypotheses == 1 else tuple(track.followed[: track.made].tolist()),
        method=_name(walked),
        iterations=track.iterations,
        evaluations=track.evaluations,
        seconds=seconds(),
        diagnostics=(*_doubts(walked, fit, hypotheses), *_of_losses(walked, counted, residuals)),
        doubts=lambda: _seen(walked, counted, numbers),
    )


def _name(walked: Walked) -> str:
    sequence = walked.problem.sequence
    if sequence is None:
        raise TypeError(walked.problem.name)
    lag = sequence.estimator.lag
    return sequence.estimator.method.value if lag is None else f"{sequence.estimator.method.value} of lag {lag}"


def _numbers(walked: Walked) -> Floats:
    """All numbers of the problem; NaN at steps that were not reached."""
    places, track = walked.told.places, walked.track
    numbers = walked.told.equations.numbers.copy()
    numbers[places.numbers[track.made :]] = np.nan
    numbers[places.numbers[: track.made]] = track.points[: track.made]
    if track.made:
        numbers[places.numbers[-1, : places.still_numbers]] = track.points[track.made - 1, : places.still_numbers]
    return numbers


def _hypotheses(walked: Walked, free: Indices) -> tuple[Hypothesis, ...]:
    """What is followed after the last step, with the probabilities that the costs say."""
    places, crowd = walked.told.places, walked.track.crowd
    if not crowd or walked.track.made < walked.chained.steps:
        return ()
    weights = np.exp(0.5 * (crowd[0].cost - np.array([each.cost for each in crowd])))
    found = []
    for each, weight in zip(crowd, weights / weights.sum(), strict=True):
        numbers = np.full(len(walked.told.equations.numbers), np.nan)
        numbers[places.numbers[-1]] = each.point
        sigma = np.full(len(walked.told.equations.layout.number), np.nan)
        sigma[places.coordinates[-1, places.free]] = np.sqrt(np.square(each.factor).sum(axis=0))
        found.append(Hypothesis(cost=each.cost, weight=float(weight), numbers=numbers, sigma=sigma[free]))
    return tuple(found)


def _free(places: Places) -> Indices:
    return np.unique(places.coordinates[:, places.free])


def _sigmas(walked: Walked) -> Floats:
    """The standard deviation of every coordinate (M,); NaN where the rows so far do not determine it."""
    places, track = walked.told.places, walked.track
    found = np.full(len(walked.told.equations.layout.number), np.nan)
    deviations = np.sqrt(np.square(track.factors).sum(axis=1))
    deviations[track.touched] = np.nan
    deviations[track.made :] = np.nan
    found[places.coordinates[:, places.free]] = deviations
    if track.made:
        still = places.coordinates[-1, places.free[: places.still]]
        found[still] = deviations[track.made - 1, : places.still]
    return found


def _covariance(walked: Walked, free: Indices, sigma: Floats) -> Covariance:
    """The covariance of what is free: of each step; what is not known of two different ones is NaN."""
    places, track = walked.told.places, walked.track
    factor = np.zeros((len(free), 0))
    if len(free) > FORMED:
        return Covariance(matrix=np.zeros((0, 0)), sigma=sigma, factor=factor)
    found = np.full((len(free), len(free)), np.nan)
    for k, covariance in enumerate(track.covariances[: track.made]):
        covariance = np.where(track.touched[k][:, None] | track.touched[k], np.nan, covariance)
        at = np.searchsorted(free, places.coordinates[k, places.free])
        found[np.ix_(at, at)] = covariance
        if k < track.made - 1:
            found[np.ix_(at[: places.still], at)] = np.nan
            found[np.ix_(at, at[: places.still])] = np.nan
    return Covariance(matrix=found, sigma=sigma, factor=factor, reason=ONE_AT_A_TIME if track.made > 1 else None)


def _scale(walked: Walked) -> Floats:
    """One over the largest deviation that a coordinate (M,) has before the rows or at a step; 1 without one."""
    places, track = walked.told.places, walked.track
    before = np.sqrt(np.square(walked.prior.factor).sum(axis=0))
    deviations = np.sqrt(np.square(track.factors[: track.made]).sum(axis=1))
    deviations[track.touched[: track.made]] = 0.0
    largest = np.vstack([before, deviations]).max(axis=0)
    found = np.ones(len(walked.told.equations.layout.number))
    found[places.coordinates[:, places.free]] = 1.0 / np.where(largest > 0.0, largest, 1.0)
    return found


def _observability(walked: Walked, lost: int, estimable: Mask, scale: Floats) -> Observability:
    size, together = len(scale), walked.together
    alike = walked.told is walked.solved and size == len(walked.solved.equations.free)
    return Observability(
        dimension=size,
        rank=size - lost,
        condition=float("nan"),
        singular_values=np.zeros(0),
        scale=scale,
        row_space=np.zeros((size, 0)),
        null_space=np.zeros((size, 0)),
        combinations=together.combinations if together is not None and alike else (),
        gauge=() if together is None else together.gauge,
        unused=(),
        estimable=estimable,
        fixed=np.zeros(size, dtype=bool),
    )


def _reason(walked: Walked) -> Reason:
    track = walked.track
    if track.made < walked.chained.steps:
        return Reason.NO_FINITE_STEP if track.failed else Reason.INTERRUPTED
    if not track.settled:
        return Reason.MAX_ITERATIONS
    return Reason.ONE_STEP if walked.chained.linear else Reason.SMALL_OFFSET


def _fit(walked: Walked, reason: Reason, cost: float) -> Fit:
    """Cost and degrees of freedom: rows and equations, less the rank of what has no prior."""
    seen, track = walked.chained.seen, walked.track
    rows = int(seen.residuals[: track.made].sum())
    rank = len(walked.prior.open) - (int(track.opens[track.made - 1]) if track.made else 0)
    lossy = walked.solved.equations.lossy
    found = fit_statistics(cost, rows, rank, noise_stated=not lossy, equalities=track.equations)
    return found if reason.converged else Fit(cost=found.cost, dof=found.dof, sigma0=found.sigma0, chi2_p=None)


def _doubts(walked: Walked, fit: Fit, hypotheses: tuple[Hypothesis, ...]) -> Iterator[Diagnostic]:
    """A filter whose innovations are larger than it expects says so, and one that the rows leave a choice."""
    if fit.chi2_p is not None and fit.sigma0 is not None and fit.chi2_p < IMPROBABLE:
        yield faults.overconfident_filter(walked.problem.span, fit.sigma0, fit.chi2_p)
    weights = [each.weight for each in hypotheses]
    if sum(weights[1:]) >= PROBABLE:
        yield faults.another_hypothesis(walked.problem.span, weights[0], weights[1:])


def _seen(walked: Walked, counted: Assembled, numbers: Floats) -> tuple[Diagnostic, ...]:
    """Whether a walk turns its back on what it sees; or ends with what may be turned in any way."""
    places, track = walked.told.places, walked.track
    found = behind_at(walked.problem, counted, walked.tables, numbers)
    if track.made < walked.chained.steps:
        return found
    last = np.sort(places.coordinates[-1, places.free])
    return (*found, *only(turned_anyhow(counted.layout, last, _sigmas(walked)[last][None])))


def _of_losses(walked: Walked, counted: Assembled, residuals: Floats) -> tuple[Diagnostic, ...]:
    """Where losses leave out more rows than they keep, a filter may follow what is wrong, or nothing any more; where
    what they leave out lies on one side, it is drawn to that.
    """
    rows = [lines[:, 0] for _, lines in loss_lines(counted)]
    left = outliers(counted, residuals)
    if not rows or left is None:
        return ()
    wrong = left[np.concatenate(rows)]
    if 2 * int(wrong.sum()) <= len(wrong):
        # Loaded by losses only, so that the others start at once.
        from mbm.estimation.trust.lost import lost_track
        from mbm.estimation.trust.one_sided import one_sided

        found = one_sided(walked.problem, counted, residuals)
        return (*found, *lost_track(walked.problem, walked.tables, counted, residuals, left))
    return (too_few_agree(walked.problem.span, int((~wrong).sum()), len(wrong)),)


def _comparable(walked: Walked) -> tuple[tuple[Group, ...], tuple[Group, ...]]:
    """The constraints that estimates are to meet, as they are told and as they were solved.

    Those of two steps by a filter follow from different rows: no exact transition holds between them.
    """
    told, solved = walked.told.equations.constraints, walked.solved.equations.constraints
    sequence = walked.problem.sequence
    if sequence is None or sequence.estimator.whole:
        return told, solved
    exact = {each.exact for each in sequence.transitions}
    kept = [at for at, each in enumerate(solved) if walked.problem.blocks[each.kernel.owner].name not in exact]
    return tuple(told[at] for at in kept), tuple(solved[at] for at in kept)


def _placed(walked: Walked, own: OwnSteps, told: tuple[Group, ...], solved: tuple[Group, ...]) -> tuple[Group, ...]:
    """Groups that take the numbers of a walk, each row at its own step."""
    known = OwnSteps.of(walked.solved.places, walked.track.made)
    pairs = zip(told, solved, strict=True)
    return tuple(own.placed(group, _steps_of(walked, known, same)) for group, same in pairs)


def _steps_of(walked: Walked, own: OwnSteps, group: Group) -> Indices:
    """The step of each row (rows,) of what is observed or constrained, of the equations that were solved."""
    sequence = walked.problem.sequence
    block = walked.problem.blocks[group.kernel.owner]
    observed = block.role is BlockRole.OBSERVATION
    if sequence is None or not (observed or block.role is BlockRole.CONSTRAINT):
        return own.reached(group)
    if not observed and of_no_step(group, block, own.places, sequence, walked.tables):
        return own.reached(group)
    exact = (transition.exact for transition in sequence.transitions)
    if block.name in exact:
        return own.reached(group)
    return steps_of(group, block, own.places, sequence, walked.tables)


def derived_after(walked: Walked, step: int) -> tuple[tuple[Floats, Floats], ...]:
    """Of each derived quantity the values (rows, size) that a solve up to a step has, and their covariances (rows,
    size, size): of the rows of this step, or of a table without steps.
    """
    sequence = walked.problem.sequence
    if sequence is None:
        raise TypeError(walked.problem.name)
    column, at = sequence.column, walked.tables[sequence.steps].numbers(sequence.column)[step]
    found = []
    for one, spread in _each_derived(walked, OwnSteps.of(walked.told.places, step + 1)):
        name = walked.problem.derived[one.owner].table
        table = None if name is None else walked.tables[name]
        stepped = table is not None and column in table.columns
        mine = table.numbers(column) == at if table is not None and stepped else np.ones(len(one.values), dtype=bool)
        lines = spread.lines[mine]
        found.append((one.values[mine], lines @ np.swapaxes(lines, 1, 2)))
    return tuple(found)


def _derived(walked: Walked, own: OwnSteps) -> tuple[tuple[DerivedSolution, ...], Floats | None]:
    """Derived quantities, each row with the covariance of the step that it belongs to, else of the last; and that of
    them all, as `Solution` has it.
    """
    found = _each_derived(walked, own)
    return tuple(one for one, _ in found), joint([spread for _, spread in found])


def _each_derived(walked: Walked, own: OwnSteps) -> list[tuple[DerivedSolution, Deviations]]:
    layout, step = walked.told.equations.layout, walked.chained.seen.equations.layout
    numbers = own.numbers(layout.reported(_numbers(walked)), step.reported(walked.track.points))
    with np.errstate(all="ignore"):
        return [_one(walked, own, numbers, owner) for owner in range(len(walked.problem.derived))]


def _one(walked: Walked, own: OwnSteps, numbers: Floats, owner: int) -> tuple[DerivedSolution, Deviations]:
    derived = walked.problem.derived[owner]
    rows = len(walked.tables[derived.table]) if derived.table is not None else 1
    count, size = widths(derived)
    values = np.full((rows, count), np.nan)
    spread = Deviations.blank(rows, size, len(own.places.free))
    for each in walked.told.binder.derived(walked.kernels, owner):
        steps = own.steps(each)
        group = own.placed(each, steps)
        positions = group.positions if group.positions is not None else np.arange(1)
        stated = group.values(numbers).copy()
        slopes = group.dense_jacobian(numbers, own.column, len(own.places.free))
        if derived.kind is None:
            values[positions] = reported(derived, stated)
        else:
            values[positions] = numbers_of_stated(derived.kind, derived.dimension, stated)
            slopes = tangent_slopes(derived.kind, derived.dimension, stated, slopes)
        spread.put(positions, own.varied(group, numbers, steps), slopes, walked.track)
    sigma = spread.sigma
    freedom, several = common(np.inf, sigma.shape), bool((spread.steps == SEVERAL).any())
    reason = ONE_AT_A_TIME if several else None
    return DerivedSolution(
        owner=owner, values=values, sigma=sigma, gradient=None, freedom=freedom, reason=reason
    ), spread
