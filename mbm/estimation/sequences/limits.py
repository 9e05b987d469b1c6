"""Bounds and inequalities of a problem, which what takes one step after the other does not meet by itself."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.layout import within_turns
from mbm.equations.types import Floats, Mask
from mbm.estimation.search.solution import Solution
from mbm.estimation.sequences import faults
from mbm.estimation.trust.nonlinearity import NORMAL_95
from mbm.problem.kinds import ConstraintKind
from mbm.problem.types import Problem
from mbm.text.types import Diagnostic, MbmError, Span


def refuse_limits(problem: Problem, equations: Assembled) -> None:
    """A smoother of fixed lag takes neither.

    Raises:
        MbmError: there is one.

    """
    estimator = None if problem.sequence is None else problem.sequence.estimator
    if estimator is None or estimator.lag is None:
        return
    what = "takes no {}: what is known later would have to meet it at steps that are over"
    mend = "use `(smoother)` or `:method batch`, which meet it, or a filter with `:constraints truncate`"
    for told, span in limits_of(problem, equations):
        raise MbmError(faults.not_for_filters(span, estimator, what.format(told), mend))


def limits_of(problem: Problem, equations: Assembled) -> Iterator[tuple[str, Span | None]]:
    """Each inequality and each unknown with bounds, in words, with its place in the text."""
    for group in equations.constraints:
        block = problem.blocks[group.kernel.owner]
        if block.constraint is not ConstraintKind.EQUAL:
            yield f"inequality, as `{block.name}` is", block.span
    for unknown in problem.unknowns:
        if unknown.lower is not None or unknown.upper is not None:
            yield f"bounds, as `{unknown.name}` has", unknown.span


def meets_limits(problem: Problem, solution: Solution) -> bool:
    """Whether all inequalities and bounds hold."""
    for group in solution.constraints:
        equation = problem.blocks[group.kernel.owner].constraint is ConstraintKind.EQUAL
        if not equation and not bool((group.values(solution.numbers) <= 0.0).all()):
            return False
    return not bool(_beyond(solution).any())


def beyond_bounds(solution: Solution, *, cut: bool) -> Iterator[Diagnostic]:
    """A warning for each unknown that is somewhere beyond its bounds, or whose 95 % interval is, unless these ``cut``
    its distribution.
    """
    outside = _beyond(solution)
    sigma = np.zeros(len(outside))
    sigma[solution.free] = np.nan_to_num(solution.covariance.sigma)
    reached = _beyond(solution, -NORMAL_95 * sigma) | _beyond(solution, NORMAL_95 * sigma)
    for entry in solution.layout.entries:
        for places, said in ((outside, faults.beyond_bounds), (reached & (not cut), faults.interval_beyond_bounds)):
            own = places[entry.coordinates].reshape(entry.members, -1).any(axis=1)
            if bool(own.any()):
                steps = int(own.sum()) if entry.unknown.is_state else None
                yield said(entry.unknown.span, entry.unknown.name, steps)
                break


def _beyond(solution: Solution, moved: Floats | float = 0.0) -> Mask:
    """Coordinates (M,) whose number is beyond its bounds, or would be if it were ``moved`` (M,)."""
    layout = solution.layout
    lower = np.where(layout.positive, np.maximum(layout.lower, 0.0), layout.lower)
    numbers = within_turns(solution.numbers, layout.number, layout.angle, layout.lower, layout.upper)
    values = np.where(layout.number >= 0, numbers[layout.number], np.nan) + moved
    with np.errstate(invalid="ignore"):
        return np.asarray((values < lower) | (values > layout.upper))
