"""Solutions → what a generated solver is tested against, and what it needs of the solving stage."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import islice

import numpy as np

from mbm.emit import faults
from mbm.emit.answers import FAILED, Agreement, Answers, DerivedRows, Reference, Whole
from mbm.emit.foreign import Foreign
from mbm.equations.assembly import Assembled
from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.layout import Layout
from mbm.equations.losses import loss_function
from mbm.equations.selection import Selection, selections
from mbm.equations.types import Floats, Indices, Mask, Reason
from mbm.estimation.consensus.agreeing import agreed, agreed_anywhere
from mbm.estimation.consensus.recognised import recognised
from mbm.estimation.consensus.types import Asked, observed
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.search.multistart import starting_points
from mbm.estimation.search.search import search
from mbm.estimation.search.solution import Solution
from mbm.estimation.search.starting import GIVEN
from mbm.estimation.settings import Forms, Settings, settings_of
from mbm.estimation.solve.estimate import assemble, estimate
from mbm.estimation.starts.closed_forms.rows import ENOUGH
from mbm.kernels.serialised import BoundRows
from mbm.kernels.types import KernelSet
from mbm.problem.elaborated import Elaborated
from mbm.problem.types import Loss, Method
from mbm.report.agreements import BY_MEDIAN, agreement_of, beginning_of
from mbm.solver.range_maps import RangeMaps
from mbm.text.types import MbmError

MOST_REFERENCES = 200
"""Solves of a `for-each` whose answers go into the test of a generated solver: the first ones."""


AWAY = 3.0
"""Standard deviations from the answer at which a test begins whose solver begins at the answer."""

HALVINGS = 12
"""Times at most that this distance is halved until mbm finds the answer from there."""

SAME = 1e-5
"""Relative difference of points that two ways lead to, up to which they are one minimum."""

Again = Callable[[Mapping[str, Floats]], Solution]
"""Solves the same data from other starts, by unknown."""


def loss_scale(loss: Loss, components: int) -> float:
    """The parameter of a loss for residuals of so many components."""
    return float(loss_function(loss, components).scale)


def answers(found: Elaborated, kernels: KernelSet, cache: EvaluationCache, forms: Forms, *, solving: bool) -> Answers:
    """The answers for the tables at hand, and the equations of the first solve row by row.

    ``solving``: what is made of them solves by itself, so that it has to have what the problem asks for.

    Raises:
        MbmError: the only solve cannot be set up, or generated solvers do not have its consensus.

    """
    with np.errstate(all="ignore"):  # values that are none are told as such, by status or NaN
        agreement, ranges = _beside(found, kernels, cache, forms) if solving else (None, None)
        known = tuple(_references(found, kernels, cache, forms, agreement or ranges, solving))
        whole = _whole(found, kernels, cache, known)
        return Answers(references=known, whole=whole, agreement=agreement, ranges=ranges)


def _beside(
    found: Elaborated, kernels: KernelSet, cache: EvaluationCache, forms: Forms
) -> tuple[Agreement | None, RangeMaps | None]:
    """The consensus of the problem, or what its starts are compared with, by the first solve that can be set up."""
    settings = settings_of(found.problem.request, None, forms)
    first = next(_systems(found, kernels, cache), None)
    if first is None:
        return None, None
    asked = agreement_of(found, first, settings)
    ranges = ranges_of(found, first, settings) if asked is None else None
    if asked is not None or ranges is not None:
        return asked, ranges
    begun = beginning_of(found, first, settings)
    if begun is None or not all(_leads(found, each, settings) for each in _systems(found, kernels, cache)):
        return None, None
    return begun, None


def _systems(found: Elaborated, kernels: KernelSet, cache: EvaluationCache) -> Iterator[Assembled]:
    """The equations of the first solves, but for those that cannot be set up."""
    _, picked = selections(found.problem, found.tables)
    for selection in islice(picked, MOST_REFERENCES):
        try:
            yield assemble(found.problem, kernels, selection.tables, {}, cache)[0]
        except MbmError:
            continue


def _leads(found: Elaborated, equations: Assembled, settings: Settings) -> bool:
    """Whether the minimum that consensus leads to is the one that mbm finds by itself."""
    try:
        starts = starting_points(equations, settings, None)
    except MbmError:
        return False
    own = search(equations, starts, settings, found.problem, lambda *_: False)  # no two points are taken for one
    asked = Asked(problem=found.problem, settings=settings, consensus=BY_MEDIAN, ruled=observed)
    known = agreed_anywhere(asked, equations)
    known = known or agreed(asked, equations, np.stack([start.point for start in starts]))
    other = minimise(equations, known.point, settings)
    near = np.abs(other.point - own.minimum.point) <= SAME * np.maximum(np.abs(own.minimum.point), 1.0)
    return bool(near.all()) and other.reason.converged


def _whole(found: Elaborated, kernels: KernelSet, cache: EvaluationCache, known: tuple[Reference, ...]) -> Whole:
    """The equations of the first solve that has an answer, where the generated solver begins."""
    _, picked = selections(found.problem, found.tables)
    for selection, reference in zip(picked, known, strict=False):
        if reference.status == FAILED:
            continue
        equations, binder = assemble(found.problem, kernels, selection.tables, {}, cache)
        column = equations.columns
        residuals, jacobian = equations.plain_linearised(reference.start)
        return Whole(
            start=reference.start,
            names=tuple(Foreign(equations.layout.name(int(c))) for c in equations.free),
            bound=tuple(_bound(group, column) for group in equations.groups),
            residuals=residuals,
            jacobian=jacobian,
            answer=reference.numbers,
            covariance=reference.covariance,
            derived=tuple(
                _derived(owner, kernels, binder, reference, column) for owner in range(len(found.problem.derived))
            ),
        )
    nothing = np.empty(0)
    return Whole(
        start=nothing,
        names=(),
        bound=(),
        residuals=nothing,
        jacobian=np.empty((0, 0)),
        answer=nothing,
        covariance=np.empty((0, 0)),
        derived=(),
    )


def _derived(owner: int, kernels: KernelSet, binder: Binder, reference: Reference, column: Indices) -> DerivedRows:
    """The rows of a derived quantity, and what they come to."""
    groups = binder.derived(kernels, owner)
    parts = [np.arange(1) if group.positions is None else group.positions for group in groups]
    rows = np.concatenate([*parts, np.empty(0, dtype=np.int64)])
    values = np.concatenate([*(group.values(reference.numbers).ravel() for group in groups), np.empty(0)])
    sigma = reference.derived[owner][1][rows].ravel()
    return DerivedRows(
        bound=tuple(_bound(group, column) for group in groups),
        rows=tuple(rows.tolist()),
        values=values,
        sigma=sigma if sigma.shape == values.shape else np.full(values.shape, np.nan),
    )


def _bound(group: Group, column: Indices) -> BoundRows:
    """The rows of a group with what whitens them; nothing does where there is no noise."""
    shape = (group.rows, group.kernel.outputs, group.kernel.outputs)
    weights = np.zeros(shape) if group.whiteners else np.broadcast_to(np.eye(group.kernel.outputs), shape)
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


def _references(
    found: Elaborated,
    kernels: KernelSet,
    cache: EvaluationCache,
    forms: Forms,
    own: Agreement | RangeMaps | None,
    solving: bool,
) -> Iterator[Reference]:
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
            yield _failed()
            continue
        if solving and solution.observability.unnoticed:
            raise MbmError(faults.free_of_cost(problem.unknowns[0].span))
        yield _reference(solution, solve if solving else None, own)


def _failed() -> Reference:
    nothing = np.empty(0)
    return Reference(
        status=FAILED,
        numbers=nothing,
        spread=nothing,
        covariance=np.empty((0, 0)),
        derived=(),
        cost=0.0,
        dof=0,
        start=nothing,
        elsewhere=None,
        condition=1.0,
    )


def _reference(solution: Solution, again: Again | None, own: Agreement | RangeMaps | None) -> Reference:
    """The answer, and where the test begins: the answer is the one from there. ``again`` None: no test begins.

    ``own`` is what the generated solver does about its start.
    """
    layout = solution.layout
    unknown = np.isnan(layout.start) | layout.guessed
    started = not bool(_without(unknown, layout, own).any())
    begun = started and (solution.origin == GIVEN or own is not None)
    first, elsewhere = solution, None
    if again is not None and not begun and _status(solution) == "converged":
        elsewhere, solution = _elsewhere(solution, again, own)
    return Reference(
        status=_status(solution),
        numbers=solution.numbers,
        spread=_spread(solution),
        covariance=np.where(solution.sigma_known, solution.covariance.matrix, np.nan),
        derived=tuple((d.values, np.where(solution.sigma_known, d.sigma, np.nan)) for d in solution.derived),
        cost=solution.fit.cost,
        dof=solution.fit.dof,
        start=np.where(unknown, first.numbers, layout.start),
        elsewhere=elsewhere,
        condition=solution.observability.condition,
    )


def _spread(solution: Solution) -> Floats:
    """By what a difference of each number (N,) is measured where the number itself is small: its standard deviation.

    For the numbers that hold a rotation it is the largest one of the coordinates that it varies by. Where no standard
    deviation is known, it is the largest number; where noise that nothing tells hides one, the one with the noise last
    used.
    """
    layout = solution.layout
    spread = np.zeros(len(layout.start))
    sigma = np.zeros(len(layout.number))
    known, factor = solution.covariance.sigma, solution.covariance.factor
    sigma[solution.free] = np.where(np.isnan(known), np.sqrt(np.square(factor).sum(axis=1)), known)
    if not solution.sigma_known:
        sigma[solution.free] = np.max(np.abs(solution.numbers), initial=0.0)
    for entry in layout.entries:
        own = sigma[entry.coordinates]
        plain = own.shape == spread[entry.range].shape
        spread[entry.range] = own if plain else np.max(own, initial=0.0)
    return spread


def _without(unknown: Mask, layout: Layout, own: Agreement | RangeMaps | None) -> Mask:
    """Which numbers (N,) have no start: those ``unknown``, but for what begins where the data say."""
    found = unknown.copy()
    for number in () if own is None else own.startless:
        found[layout.entries[number].range] = False
    return found


def _elsewhere(solution: Solution, again: Again, own: Agreement | RangeMaps | None) -> tuple[Floats | None, Solution]:
    """A point (N,) some standard deviations from the answer, and what mbm answers from there; None: none leads back."""
    for halving in range(HALVINGS):
        point = _moved(solution, AWAY * 0.5**halving)
        try:
            other = again({entry.unknown.name: point[entry.range] for entry in solution.layout.entries})
        except MbmError:
            continue
        near = abs(other.fit.cost - solution.fit.cost) <= 1e-6 * max(solution.fit.cost, 1.0)
        by_itself = other.origin == GIVEN or own is not None
        if near and by_itself and _status(other) == "converged":
            return point, other
    return None, solution


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
    """The status as the document has it, without the sentences; that too few agree is one of its own here."""
    if solution.minimum.reason is Reason.INFEASIBLE or not solution.minimum.feasible:
        return "infeasible"
    if solution.minimum.reason is Reason.NO_AGREEMENT:
        return "no-agreement"
    if not solution.minimum.reason.converged:
        return "not-converged"
    return "converged" if solution.observability.observable else "unobservable"


def ranges_of(found: Elaborated, equations: Assembled, settings: Settings) -> RangeMaps | None:
    """The form of a problem with such ``equations``, where these are ranges that give all that is estimated, or None.

    For plain least squares, as single solves compare (`mbm.estimation.search.challenge`).
    """
    problem = found.problem
    families = any(unknown.family is not None for unknown in problem.unknowns)
    asked = settings.robust is not None or settings.method in (Method.CLOSED_FORM, Method.DIRECT_SEARCH)
    if asked or families or any(block.errors for block in problem.blocks):
        return None
    shared = equations.structure is not None
    if equations.linear or equations.lossy or shared or equations.constraints or equations.count > ENOUGH:
        return None
    form = recognised(equations, settings)
    maps = None if form is None else form.ranges(stated=not problem.estimates_noise)
    if maps is None:
        return None
    layout = equations.layout
    missing = (np.isnan(layout.start) | layout.guessed) & equations.moving()
    startless = frozenset(i for i, entry in enumerate(layout.entries) if bool(missing[entry.range].any()))
    return replace(maps, startless=startless)
