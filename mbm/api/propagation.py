"""Propagation of distributions: a solve, then trials of it with the inputs drawn (GUM Supplement 1)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from mbm import compiler
from mbm.api import arguments
from mbm.problem.bounded import called, likelihood_of
from mbm.problem.clauses import select_problem
from mbm.problem.types import Method, Problem, UncertainColumn
from mbm.report.propagation.answer import Propagated
from mbm.report.propagation.solve import PropagatedSolve, parts_of, scalars_of
from mbm.simulation.trials import faults
from mbm.simulation.trials.drawn import drawn, weighted, with_shifts
from mbm.simulation.trials.drawn_constants import with_drawn_constants
from mbm.simulation.trials.run import Asked, Effort, sampled
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.api.compilation import Compilation, Origin
    from mbm.compiler import Inputs
    from mbm.equations.binding import EvaluationCache
    from mbm.equations.interruption import Interruption
    from mbm.estimation.settings import Settings
    from mbm.kernels.types import KernelSet
    from mbm.problem.overrides import ConstantValue
    from mbm.report.options import PropagationSettings
    from mbm.report.types import Result, SolveReport


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Trials:
    """What all solves of a problem share: equations with shifts, in which ``constants`` are unknowns."""

    problem: Problem
    kernels: KernelSet
    cache: EvaluationCache
    constants: tuple[ConstantValue, ...]
    settings: Settings


def propagated(
    now: Compilation, origin: Origin, inputs: Inputs, result: Result, asked: PropagationSettings
) -> Propagated:
    """The trials of each solve of a result that can be trusted.

    Raises:
        MbmError: `not-propagated`, `nothing-drawn`, `too-many-trials`.

    """
    problem = now.elaborated.problem
    trials, workers, seed = arguments.trials(asked.trials), arguments.threads(asked.workers), arguments.seed(asked.seed)
    if seed is None:
        seed = 1 if result.seed is None else abs(result.seed)
    _refuse(problem)
    shared = _trials(now, origin, inputs)
    settings = Effort(
        trials=trials,
        seed=seed,
        workers=workers,
        progress=asked.progress or _silent,
        stopped=_stopped(asked.interruption),
    )
    found, places = [], []
    for place, solve in enumerate(result.solves):
        if solve.status.trusted and solve.made_from is not None:
            found.append(_of_solve(shared, solve, settings))
            places.append(place)
    if not found:
        why = result.solves[0].message if result.solves else "there is no solve"
        mend = "look at what `mbm solve` says of it"
        raise MbmError(faults.not_propagated(problem.span, f"the solve of `{problem.name}`", why, mend))
    return Propagated(result=result, solves=tuple(found), places=tuple(places))


def _refuse(problem: Problem) -> None:
    """Refuse what is no minimum, or judges rows by their residuals.

    Raises:
        MbmError: `not-propagated`, with everything found.

    """
    wrong: list[Diagnostic] = []
    request, name = problem.request, f"`{problem.name}`"
    if problem.sequence is not None:
        why, mend = "states are followed from step to step", "use `mbm simulate` and `mbm solve`"
        wrong.append(faults.not_propagated(problem.sequence.span, "a problem with `states`", why, mend))
    if request.method is Method.INTERVAL:
        why, mend = "bounds have no distribution", "state `:sigma` in place of `:bound`, and another method"
        wrong.append(faults.not_propagated(problem.span, name, why, mend))
    judged = "rows count by residuals, which would have their noise twice"
    if request.robust is not None:
        mend = "leave the rows out that `mbm solve` rejects, and `:robust` with them"
        wrong.append(faults.not_propagated(problem.span, f"`:robust` of {name}", judged, mend))
    for block in problem.blocks:
        likelihood = likelihood_of(block)
        if likelihood is not None:
            why, mend = "normal errors of known size are drawn only", "use `mbm simulate` and `mbm solve`"
            wrong.append(faults.not_propagated(block.span, f"{called(likelihood)} of `{block.name}`", why, mend))
        if block.loss is not None:
            mend = "leave out the rows that are off, and `:loss` with them"
            wrong.append(faults.not_propagated(block.span, f"the loss of `{block.name}`", judged, mend))
        if block.structure.estimated or (block.structure.joins and block.unknown_factor):
            why, mend = "noise that rows share is drawn where all of it is known", "state it with numbers"
            what, at = f"{block.structure.what} of `{block.name}`", block.structure.place or block.span
            if not block.structure.estimated:
                mend, at = "state its size: `:sigma` with a number or a column", block.span
            wrong.append(faults.not_propagated(at, what, why, mend))
        if block.errors:
            why = "errors in measured columns are not drawn yet"
            wrong.append(
                faults.not_propagated(block.span, f"`:errors` of `{block.name}`", why, _as_unknowns(block.errors[0]))
            )
    if wrong:
        raise MbmError(*wrong)


def _as_unknowns(column: UncertainColumn) -> str:
    """How the errors of a measured column are written with unknowns."""
    name, table = column.column, column.table
    return (
        f"number the rows in a column `i`, make the true values unknowns, `({name}-true :per {table}.i)`, write them "
        f"in place of `{name}`, and add `(observe {table} (= {name} ({name}-true i)) :sigma …)`"
    )


def _trials(now: Compilation, origin: Origin, inputs: Inputs) -> _Trials:
    """The problem with shifts, and with its uncertain constants among the unknowns.

    Raises:
        MbmError: `not-propagated`, a constant that decides more than values.

    """
    from mbm.equations.binding import EvaluationCache
    from mbm.estimation.settings import settings_of

    found = now.elaborated
    constants = tuple(each for each in found.problem.constants if each.sigmas)
    if constants:
        program = origin.reading.program
        definition = select_problem(program, origin.name)
        changed = with_drawn_constants(program, definition, constants)
        raw = found.raw
        try:
            found = compiler.elaborated(changed, definition.name, inputs, origin.registry, lambda _: raw)
        except MbmError as error:
            raise MbmError(*(faults.decides(each) for each in error.diagnostics)) from None
    problem = with_shifts(weighted(found.problem))
    kernels = compiler.derived(replace(found, problem=problem))
    functions = compiler.called_functions(kernels, inputs, origin.reading.base)
    if functions is not None:
        functions.load(kernels)
    return _Trials(
        problem=problem,
        kernels=kernels,
        cache=EvaluationCache(origin.registry.suited(now.cache.backend, kernels, functions)),
        constants=constants,
        settings=settings_of(problem.request),
    )


def _of_solve(trials: _Trials, solve: SolveReport, asked: Effort) -> PropagatedSolve:
    """The trials of one solve."""
    from mbm.estimation.batches.trials import trial_solver

    if solve.made_from is None:
        raise TypeError(solve)
    problem, solution = solve.made_from()
    ready = drawn(trials.problem, trials.kernels, trials.cache, solution, trials.constants)
    if ready.nothing:
        raise MbmError(faults.nothing_drawn(problem.span))
    parts = parts_of(solve)
    if not parts:
        why = "directions and quantities without a value have no coordinates to tell"
        raise MbmError(faults.not_propagated(problem.span, f"`{problem.name}`", why, "derive a number from it"))
    settings = Asked(
        trials=asked.trials,
        coverage=solve.coverage,
        seed=asked.seed,
        words=tuple(f"{name}={value}" for name, value in solution.key.items()),
        workers=asked.workers,
        progress=asked.progress,
        stopped=asked.stopped,
    )
    solver = trial_solver(ready.equations, trials.settings)
    found = sampled(ready, solver, scalars_of(trials.problem, parts, ready), parts[-1].columns.stop, settings)
    warnings: list[Diagnostic] = []
    if found.failed:
        warnings.append(faults.failed_trials(problem.span, found.failed, found.trials))
    if found.settled is False and not found.stopped:
        warnings.append(faults.not_settled(problem.span, found.trials))
    if found.stopped:
        warnings.append(faults.stopped(problem.span, found.trials))
    return PropagatedSolve(solve=solve, parts=parts, sampled=found, diagnostics=tuple(warnings))


def _silent(done: int, total: int) -> None:
    """Nobody watches."""


def _stopped(interruption: Interruption | None) -> Callable[[], bool]:
    """What says whether the trials are to end."""
    return lambda: interruption is not None and interruption.requested
