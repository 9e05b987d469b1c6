"""Solutions → what a generated solver is tested against, and what it needs of the solving stage."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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
from mbm.solution.selection import selections
from mbm.solution.settings import Forms, settings_of
from mbm.solution.solution import Solution
from mbm.solution.starting import GIVEN
from mbm.solution.types import Floats, Indices, Reason
from mbm.text.types import MbmError

MOST_REFERENCES = 200
"""Solves of a `for-each` whose answers go into the test of a generated solver: the first ones."""


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
        try:
            solution = estimate(
                problem,
                kernels,
                selection.tables,
                key=selection.key,
                starts=given,
                settings=settings,
                cache=cache,
            )
        except MbmError:
            if not selection.key:
                raise
            yield _failed(selection.key)
            continue
        yield _reference(solution)


def _failed(key: Mapping[str, str | float]) -> Reference:
    nothing = np.empty(0)
    return Reference(
        key=key,
        status="failed",
        numbers=nothing,
        spread=nothing,
        covariance=np.empty((0, 0)),
        cost=0.0,
        dof=0,
        start=nothing,
        stated=True,
    )


def _reference(solution: Solution) -> Reference:
    layout = solution.layout
    stated = solution.origin == GIVEN
    spread = np.zeros(len(layout.start))
    places = layout.number[solution.free]
    plain = places >= 0
    spread[places[plain]] = np.nan_to_num(solution.covariance.sigma[plain])
    start = np.where(np.isnan(layout.start), solution.numbers, layout.start)
    return Reference(
        key=dict(solution.key),
        status=_status(solution),
        numbers=solution.numbers,
        spread=spread,
        covariance=solution.covariance.matrix,
        cost=solution.fit.cost,
        dof=solution.fit.dof,
        start=start if stated else solution.numbers,
        stated=stated,
    )


def _status(solution: Solution) -> str:
    """The status as the document has it, without the sentences."""
    if solution.minimum.reason is Reason.INFEASIBLE or not solution.minimum.feasible:
        return "infeasible"
    if not solution.minimum.reason.converged:
        return "not-converged"
    return "converged" if solution.observability.observable else "unobservable"
