"""Solution → SolveReport: numbers get their names and units, statuses their sentences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.layout import Entry
from mbm.equations.types import Reason
from mbm.estimation.intervals.network import Enclosure
from mbm.estimation.search.search import Alternative as OtherMinimum
from mbm.estimation.search.solution import Failure, Hypothesis, Skipped, Solution
from mbm.estimation.sequences.faults import BEYOND_BOUNDS
from mbm.problem.naming import member_name
from mbm.problem.types import Problem
from mbm.report.constraints import (
    bound_diagnostics,
    conflict_sentence,
    constraint_diagnostics,
    constraint_reports,
    violated_sentence,
)
from mbm.report.correlations import derived_covariance, estimates_covariance
from mbm.report.freedom import common_directions, free_directions
from mbm.report.later import guarded
from mbm.report.noise import noise_reports, noise_units
from mbm.report.numbers import nothing_known, numbers_of
from mbm.report.pictures import maps_of, plot_data
from mbm.report.quantities import (
    FREE,
    NO_NOISE,
    Shown,
    coordinate_spread,
    derived_value,
    entry_spread,
    nothing_known_of,
    repeated,
    shown,
    stuck,
    untold_noise,
)
from mbm.report.residuals import prior_reports, residual_rows, residual_summaries, row_data
from mbm.report.root_means import of_solution
from mbm.report.spreads import Spread
from mbm.report.types import (
    Alternative,
    ConstraintReport,
    Estimate,
    Examined,
    Floats,
    Mask,
    Observability,
    Quantity,
    SolveReport,
    SolveStatus,
)
from mbm.values import dataclass, once

MOST_WANTED = 6
"""Unknowns that are named where a start is wanted."""

_UNUSED = "no equation mentions it"
_NOT_THE_BEST = "standard deviations are those of the best solution only"
_MIRRORED = "the mirror image of another one"


def report_of(
    problem: Problem, solution: Solution | Enclosure | Failure | Skipped, *, covariance_full: bool
) -> SolveReport:
    """One solve as a report, whatever became of it."""
    if isinstance(solution, Enclosure):
        from mbm.report.from_enclosure import enclosure_report

        return enclosure_report(problem, solution)
    if isinstance(solution, Failure):
        return failure_report(solution)
    if isinstance(solution, Skipped):
        return skipped_report(solution)
    with solution.lock:
        return solve_report(problem, solution, covariance_full=covariance_full)


def solve_report(problem: Problem, solution: Solution, *, covariance_full: bool) -> SolveReport:
    """One solve as a report."""
    how = shown(problem, solution)
    names = how.names
    constraints = constraint_reports(problem, solution)
    status, message = _status(problem, solution, constraints, names)
    unknown = nothing_known_of(solution)
    derived = tuple(
        derived_value(problem, solution, each, quantity)
        for each, quantity in zip(solution.derived, how.derived, strict=True)
    )
    reached = not stuck(solution)
    numbers, reasons = numbers_of(solution)
    return SolveReport(
        status=status,
        message=message,
        key=dict(solution.key),
        method=solution.method,
        iterations=solution.iterations,
        evaluations=solution.evaluations,
        seconds=solution.seconds,
        **numbers,
        reasons=reasons,
        estimates=_estimates(solution, how, unknown),
        covariance=estimates_covariance(solution, how, unknown, full=covariance_full),
        derived=derived,
        derived_covariance=derived_covariance(solution, derived, unknown, full=covariance_full),
        observability=_observability(solution, names) if reached else None,
        noise=noise_reports(problem, solution.noise),
        noise_units=noise_units(problem),
        summaries=once(lambda: residual_summaries(problem, solution)),
        raw_residuals=guarded(solution.lock, lambda: of_solution(problem, solution)),
        made_from=lambda: (problem, solution),
        rows=guarded(solution.lock, lambda: residual_rows(problem, solution)),
        row_data=guarded(solution.lock, lambda: row_data(problem, solution)),
        pictures=guarded(solution.lock, lambda: plot_data(problem, solution)),
        maps=guarded(solution.lock, lambda: maps_of(problem, solution)),
        priors=prior_reports(problem, solution),
        corrections=solution.corrections,
        constraints=constraints,
        hypotheses=tuple(_hypothesis(solution, how, each) for each in solution.hypotheses),
        followed=solution.followed,
        starts=solution.tally,
        coverage=problem.request.coverage,
        examination=once(guarded(solution.lock, once(lambda: _examined(problem, solution, how)))),
    )


@np.errstate(all="ignore")  # overflow and NaN are results here, as in the solve
def _examined(problem: Problem, solution: Solution, how: Shown) -> Examined:
    return Examined(
        alternatives=tuple(_alternative(solution, how, each) for each in solution.alternatives()),
        not_examined=solution.unexamined(),
        diagnostics=(
            *solution.diagnostics,
            *solution.doubts(),
            *bound_diagnostics(problem, solution, how.names),
            *constraint_diagnostics(problem, solution, how.names),
        ),
    )


def failure_report(failure: Failure) -> SolveReport:
    """A solve of several that could not be set up: no estimates, and the reason."""
    first = failure.diagnostics[0]
    return SolveReport(
        status=SolveStatus.NOT_CONVERGED,
        message=f"nothing was solved: {first.message}",
        key=dict(failure.key),
        reasons=nothing_known("nothing was solved"),
        examination=Examined(diagnostics=failure.diagnostics),
    )


def skipped_report(skipped: Skipped) -> SolveReport:
    """A window with too few rows: no estimates, and no failure."""
    rows = f"{skipped.rows} row{'' if skipped.rows == 1 else 's'}"
    return SolveReport(
        status=SolveStatus.SKIPPED,
        message=f"the window has {rows}, and at least {skipped.wanted} are wanted",
        key=dict(skipped.key),
        reasons=nothing_known("the window was skipped"),
    )


def _status(
    problem: Problem, solution: Solution, constraints: tuple[ConstraintReport, ...], names: tuple[str, ...]
) -> tuple[SolveStatus, str]:
    reason = solution.minimum.reason
    if reason is Reason.INFEASIBLE:
        return SolveStatus.INFEASIBLE, conflict_sentence(problem, solution, names) or reason.sentence
    # Bounds that a filter took no notice of count as the same limit in a constraint does.
    outside = next((each.message for each in solution.diagnostics if each.code == BEYOND_BOUNDS), None)
    broken = violated_sentence(constraints) or outside
    if not reason.converged:
        said = (reason.sentence, broken, _endless(problem, solution, names) or _wants_a_start(solution))
        return SolveStatus.NOT_CONVERGED, "; ".join(each for each in said if each is not None)
    if broken is not None:
        return SolveStatus.INFEASIBLE, broken
    if not solution.observability.observable:
        return SolveStatus.UNOBSERVABLE, SolveStatus.UNOBSERVABLE.sentence
    return SolveStatus.CONVERGED, reason.sentence


def _endless(problem: Problem, solution: Solution, names: tuple[str, ...]) -> str | None:
    """What has to be bounded where the likelihood rises towards infinite values."""
    if solution.minimum.reason not in (Reason.FLAT, Reason.ENDLESS) or not _may_rise_forever(problem):
        return None
    free = dict.fromkeys(name for each in free_directions(solution, names) for name in each.unknowns)
    if not free:
        return None
    return f"the likelihood may be highest in the infinite: give a prior or `:in`, which bound {_listed(tuple(free))}"


def _wants_a_start(solution: Solution) -> str | None:
    """Of which unknowns a start might help where none of the starts that were tried led to a minimum."""
    tally, layout = solution.tally, solution.layout
    if tally is None or tally.converged or solution.minimum.reason is Reason.INTERRUPTED:
        return None
    open_to = np.isnan(layout.start) | layout.guessed
    names = tuple(entry.unknown.name for entry in layout.entries if bool(open_to[entry.range].any()))
    return f"no start led to a minimum: give `:init` or a narrow `:in` of {_listed(names)}" if names else None


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(f"`{name}`" for name in names[:MOST_WANTED]) + (" …" if len(names) > MOST_WANTED else "")


def _may_rise_forever(problem: Problem) -> bool:
    """Whether readings are of a kind whose likelihood can rise towards infinite values: counts, and limits."""
    equations = (equation for block in problem.blocks for case in block.cases for equation in case.equations)
    errors = (equation.likelihood for equation in equations if equation.likelihood is not None)
    return any(each.law.counts or each.truncation is not None for each in errors)


def _estimates(solution: Solution, how: Shown, unknown: str | None) -> tuple[Estimate, ...]:
    each = _Each.of(solution, unknown)
    pairs = zip(solution.layout.entries, how.unknowns, strict=True)
    return tuple(_estimate(solution, entry, quantity, each) for entry, quantity in pairs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Each:
    """Per coordinate (M,): sigma, NaN where there is none; whether it is fixed, held by a bound, and why no sigma is.

    ``missing``: it has none, though neither holds; ``unused``: no equation mentions it; ``estimable``: the data
    determine it; ``unknown``: why nothing has a sigma, ``untold``: why what is determined has none.
    """

    sigma: Floats
    fixed: Mask
    bound: Mask
    missing: Mask
    unused: Mask
    estimable: Mask
    unknown: str | None
    untold: str
    spread: Spread

    @staticmethod
    def of(solution: Solution, unknown: str | None) -> _Each:
        """What holds for the coordinates of ``solution``."""
        count = len(solution.layout.number)
        sigma = np.full(count, np.nan)
        bound, unused, estimable = (np.zeros(count, dtype=bool) for _ in range(3))
        bound[solution.free] = solution.minimum.at_bound != 0
        if unknown is None:
            sigma[solution.free] = solution.covariance.sigma
            unused[solution.unused] = True
            estimable[solution.free] = solution.observability.estimable
        return _Each(
            sigma=sigma,
            fixed=solution.layout.fixed,
            bound=bound,
            missing=np.isnan(sigma) & ~solution.layout.fixed & ~bound,
            unused=unused,
            estimable=estimable,
            unknown=unknown,
            untold=untold_noise(solution) or NO_NOISE,
            spread=coordinate_spread(solution),
        )

    def why_missing(self, place: slice) -> str | None:
        """Why numbers at ``place`` have no sigma; several causes are all named."""
        missing = self.missing[place]
        if self.unknown is not None or not bool(missing.any()):
            return self.unknown if bool(missing.any()) else None
        used, estimable = ~self.unused[place], self.estimable[place]
        causes = (
            (_UNUSED, missing & ~used),
            (FREE, missing & used & ~estimable),
            (self.untold, missing & used & estimable),
        )
        return ", or ".join(sentence for sentence, which in causes if bool(which.any()))


def _estimate(solution: Solution, entry: Entry, quantity: Quantity, each: _Each) -> Estimate:
    leading = () if entry.keys is None else (entry.members,)
    steps = () if entry.steps is None else (len(entry.steps),)
    numbers = solution.layout.reported(solution.numbers)[entry.range]
    place = entry.coordinates
    own = entry.unknown.shape
    shape = (*leading, *(own if not entry.unknown.dimension else (entry.unknown.freedom,)))
    bound, spread = each.bound[place], entry_spread(solution, each.spread, entry, shape)
    return Estimate(
        quantity=quantity,
        value=repeated(numbers.reshape((*leading, *entry.unknown.shape)), steps),
        sigma=repeated(each.sigma[place].reshape(shape), steps),
        fixed=repeated(each.fixed[place].reshape(shape), steps),
        keys=entry.keys if entry.steps is None else entry.steps,
        per=entry.unknown.family.rows if entry.unknown.family is not None else None,
        at_bound=repeated(bound.reshape(shape), steps) if bool(bound.any()) else None,
        reason=each.why_missing(place),
        spread=spread.each(lambda values: repeated(values, steps)) if steps else spread,
    )


def _alternative(solution: Solution, how: Shown, other: OtherMinimum) -> Alternative:
    """Another minimum: its estimates alone."""
    there = replace(solution, numbers=other.minimum.point, minimum=other.minimum)
    robust = solution.robust_cost
    return Alternative(
        cost=other.cost,
        robust_cost=None if robust is None else other.minimum.cost - (solution.minimum.cost - robust),
        starts=other.starts,
        estimates=_estimates(there, how, _NOT_THE_BEST),
        remark=_MIRRORED if other.mirrored else None,
    )


def _hypothesis(solution: Solution, how: Shown, other: Hypothesis) -> Alternative:
    """What a filter follows, at the last step."""
    covariance = replace(solution.covariance, sigma=other.sigma)
    there = replace(solution, numbers=other.numbers, covariance=covariance)
    estimates = tuple(_at_last(estimate) for estimate in _estimates(there, how, None))
    return Alternative(cost=other.cost, starts=1, estimates=estimates, weight=other.weight)


def _at_last(estimate: Estimate) -> Estimate:
    """A state with its last step alone."""
    if estimate.quantity.over is None or estimate.keys is None:
        return estimate
    return replace(
        estimate,
        keys=estimate.keys[-1:],
        value=estimate.value[-1:],
        sigma=None if estimate.sigma is None else estimate.sigma[-1:],
        fixed=estimate.fixed[-1:],
        at_bound=None,
        reason=None,
    )


def _observability(solution: Solution, names: tuple[str, ...]) -> Observability:
    found = solution.observability
    return Observability(
        rank=found.rank,
        dimension=found.dimension,
        condition=float(found.condition),
        unobservable=free_directions(solution, names),
        gauge=common_directions(solution),
        unused=_unused(solution),
    )


def _unused(solution: Solution) -> tuple[str, ...]:
    """Unknowns (or members of families) that no equation mentions, each named once."""
    if not len(solution.unused):
        return ()
    unused = np.zeros(len(solution.layout.number), dtype=bool)
    unused[solution.unused] = True
    names: list[str] = []
    for entry in solution.layout.entries:
        keys, at_step = entry.keys if entry.keys is not None else (None,), entry.unknown.is_state
        alone = unused[entry.coordinates].reshape(entry.members, entry.unknown.freedom).all(axis=1)
        which = np.flatnonzero(alone)
        names.extend(member_name(entry.unknown.name, keys[member], at_step=at_step) for member in which)
    return tuple(names)
