"""Solutions → what a generated solver is tested against, and what it needs of the solving stage."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import islice

import numpy as np

from mbm.emit.types import Answers, Reference, Whole
from mbm.kernels.serialised import BoundRows
from mbm.kernels.types import KernelSet
from mbm.problem.elaborated import Elaborated
from mbm.problem.types import Loss
from mbm.solution.binding import EvaluationCache, Group
from mbm.solution.estimate import assemble, estimate
from mbm.solution.robust.losses.parameters import loss_function
from mbm.solution.selection import Selection, selections
from mbm.solution.settings import Forms, settings_of
from mbm.solution.solution import Solution
from mbm.solution.starting import GIVEN
from mbm.solution.types import Floats, Indices, Mask, Reason
from mbm.text.types import MbmError

MOST_REFERENCES = 200
"""Solves of a `for-each` whose answers go into the test of a generated solver: the first ones."""


AWAY = 3.0
"""Standard deviations from the answer at which a test begins whose solver begins at the answer."""

HALVINGS = 12
"""Times at most that this distance is halved until mbm finds the answer from there."""

Again = Callable[[Mapping[str, Floats]], Solution]
"""Solves the same data from other starts, by unknown."""


def loss_scale(loss: Loss, components: int) -> float:
    """The parameter of a loss for residuals of so many components."""
    return float(loss_function(loss, components).scale)


def answers(found: Elaborated, kernels: KernelSet, cache: EvaluationCache, forms: Forms) -> Answers:
    """The answers for the tables at hand, and the equations of the first solve row by row.

    Raises:
        MbmError: the only solve cannot be set up.

    """
    with np.errstate(all="ignore"):  # values that are none are told as such, by status or NaN
        known = tuple(_references(found, kernels, cache, forms))
        return Answers(references=known, whole=_whole(found, kernels, cache, known))


def _whole(found: Elaborated, kernels: KernelSet, cache: EvaluationCache, known: tuple[Reference, ...]) -> Whole:
    """The equations of the first solve that has an answer, where the generated solver begins."""
    _, picked = selections(found.problem, found.tables)
    for selection, reference in zip(picked, known, strict=False):
        if reference.status == "failed":
            continue
        equations, _ = assemble(found.problem, kernels, selection.tables, {}, cache)
        column = np.full(len(equations.layout.number), -1, dtype=np.int64)
        column[equations.free] = np.arange(len(equations.free))
        return Whole(
            start=reference.start,
            names=tuple(equations.layout.name(int(c)) for c in equations.free),
            bound=tuple(_bound(group, column) for group in equations.groups),
            residuals=equations.plain_residuals(reference.start),
            jacobian=equations.plain_jacobian(reference.start),
        )
    nothing = np.empty(0)
    return Whole(start=nothing, names=(), bound=(), residuals=nothing, jacobian=np.empty((0, 0)))


def _bound(group: Group, column: Indices) -> BoundRows:
    weights = np.zeros((group.rows, group.kernel.outputs, group.kernel.outputs))
    for each in group.whiteners:
        own = slice(each.first, each.last)
        if each.weights.ndim == 2:
            place = np.arange(each.first, each.last)
            weights[:, place, place] = each.weights
        else:
            weights[:, own, own] = each.weights
    return BoundRows(
        kernel=group.kernel,
        index=group.index,
        columns=column[group.columns],
        parameters=group.parameters,
        weights=weights,
    )


def _references(found: Elaborated, kernels: KernelSet, cache: EvaluationCache, forms: Forms) -> Iterator[Reference]:
    problem = found.problem
    settings = settings_of(problem.request, None, forms)
    given: Mapping[str, Floats] = {name: np.asarray(values, dtype=np.float64) for name, values in found.starts.items()}
    _, picked = selections(problem, found.tables)
    for selection in islice(picked, MOST_REFERENCES):

        def solve(starts: Mapping[str, Floats], chosen: Selection = selection) -> Solution:
            return estimate(
                problem,
                kernels,
                chosen.tables,
                key=chosen.key,
                starts=starts,
                settings=settings,
                cache=cache,
            )

        try:
            solution = solve(given)
        except MbmError:
            if not selection.key:
                raise
            yield _failed(selection.key)
            continue
        yield _reference(solution, solve)


def _failed(key: Mapping[str, str | float]) -> Reference:
    nothing = np.empty(0)
    return Reference(
        key=key,
        status="failed",
        numbers=nothing,
        spread=nothing,
        covariance=np.empty((0, 0)),
        derived=(),
        cost=0.0,
        dof=0,
        start=nothing,
        elsewhere=None,
    )


def _reference(solution: Solution, again: Again) -> Reference:
    layout = solution.layout
    spread = np.zeros(len(layout.start))
    places = layout.number[solution.free]
    plain = places >= 0
    spread[places[plain]] = np.nan_to_num(solution.covariance.sigma[plain])
    unknown = np.isnan(layout.start) | layout.guessed
    begun = not bool(unknown.any()) and solution.origin == GIVEN
    status = _status(solution)
    return Reference(
        key=dict(solution.key),
        status=status,
        numbers=solution.numbers,
        spread=spread,
        covariance=solution.covariance.matrix,
        derived=tuple((each.values, each.sigma) for each in solution.derived),
        cost=solution.fit.cost,
        dof=solution.fit.dof,
        start=np.where(unknown, solution.numbers, layout.start),
        elsewhere=None if begun or status != "converged" else _elsewhere(solution, again),
    )


def _elsewhere(solution: Solution, again: Again) -> Floats | None:
    """A point (N,) some standard deviations from the answer, from which mbm finds it again; None: there is none."""
    for halving in range(HALVINGS):
        point = _moved(solution, AWAY * 0.5**halving)
        try:
            other = again({entry.unknown.name: point[entry.range] for entry in solution.layout.entries})
        except MbmError:
            continue
        near = abs(other.fit.cost - solution.fit.cost) <= 1e-6 * max(solution.fit.cost, 1.0)
        if near and other.origin == GIVEN and _status(other) == "converged":
            return point
    return None


def _moved(solution: Solution, deviations: float) -> Floats:
    """The estimates moved by so many standard deviations, up and down in turn, within their bounds."""
    layout, free = solution.layout, solution.free
    step = deviations * np.nan_to_num(solution.covariance.sigma, posinf=0.0)
    step[1::2] *= -1.0
    lower = np.where(layout.positive[free], np.maximum(layout.lower[free], 0.0), layout.lower[free])
    places = layout.number[free]
    held = np.where(places >= 0, solution.numbers[places], 0.0)

    def outside(step: Floats) -> Mask:
        beyond = (held + step <= lower) | (held + step >= layout.upper[free])
        return np.asarray((places >= 0) & beyond)

    step = np.where(outside(step), -step, step)
    every = np.zeros(len(layout.number))
    every[free] = np.where(outside(step), 0.0, step)
    return layout.retract(solution.numbers, every)


def _status(solution: Solution) -> str:
    """The status as the document has it, without the sentences."""
    if solution.minimum.reason is Reason.INFEASIBLE or not solution.minimum.feasible:
        return "infeasible"
    if not solution.minimum.reason.converged:
        return "not-converged"
    return "converged" if solution.observability.observable else "unobservable"
