"""What the command line does with a file: each function does what the command of its name does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from mbm import compiler
from mbm.api.problem import load, opened
from mbm.compiler import Inputs
from mbm.files.reading import read_file
from mbm.problem.overrides import Override
from mbm.text.shown import joined
from mbm.text.types import Diagnostic, Source

if TYPE_CHECKING:
    from mbm.api.compiled import CompiledProblem
    from mbm.api.problem import Problem
    from mbm.emit.types import OutputFile as SolverFile
    from mbm.report.budgets.answer import BudgetAnswer
    from mbm.report.designs.answer import Design
    from mbm.report.designs.types import DesignWish
    from mbm.report.options import PropagationSettings, SimulationSettings, SolveOptions
    from mbm.report.propagation.answer import Propagated
    from mbm.report.simulated import Simulated
    from mbm.report.simulated_files import OutputFile
    from mbm.report.trajectories.answer import TrajectoryAnswer
    from mbm.report.types import Result


def _asked(problem: Problem, options: SolveOptions) -> Problem:
    """The problem of its file that is asked for."""
    return problem if options.problem is None else problem.named(options.problem)


def _ready(path: str | Path, options: SolveOptions) -> CompiledProblem:
    """The problem that is asked for, compiled; all that it reads was read."""
    ready = _asked(load(path, sandbox=options.sandbox), options).compiled(inputs_of(options), options.backend.value)
    if options.loaded is not None:
        options.loaded()
    return ready


def solve_file(path: str | Path, options: SolveOptions) -> Result:
    """What ``mbm solve`` does.

    Raises:
        MbmError: the problem, the data or the call is wrong.

    """
    return _ready(path, options).result(options)


def propagate_file(path: str | Path, options: SolveOptions, settings: PropagationSettings) -> Propagated:
    """What ``mbm propagate`` does.

    Raises:
        MbmError: the problem, the data or the call is wrong, or nothing can be propagated.

    """
    from mbm.report.answer import Solved

    return Solved(solve_file(path, replace(options, drawing=True))).propagated(settings)


def simulate_file(
    path: str | Path, options: SolveOptions, settings: SimulationSettings
) -> tuple[Simulated, tuple[OutputFile, ...]]:
    """What ``mbm simulate`` does: the simulated tables, and the files of a folder that can be solved.

    Raises:
        MbmError: the problem, the data or the call is wrong.

    """
    from mbm.report.simulated_files import output_files

    problem = _asked(opened(path, sandbox=options.sandbox), options)
    simulator = problem.simulator(inputs_of(options))
    made = simulator.measurements(settings)
    return made, output_files(problem.program, simulator.found.problem, problem.name, made)


def budget_file(
    path: str | Path, options: SolveOptions, names: Sequence[str] = (), *, by_row: bool = False
) -> BudgetAnswer:
    """What ``mbm budget`` does: the budgets of the quantities ``names``, or of all; ``by_row`` as `budgets_of` has it.

    Raises:
        MbmError: the problem, the data or the call is wrong; unknown-quantity, no-budget.

    """
    from mbm.report.budgets.answer import answer_of

    return answer_of(solve_file(path, options), names, by_row=by_row)


def design_file(
    path: str | Path, options: SolveOptions, at: Mapping[str, object] | None, candidates: str | None, wish: DesignWish
) -> Design:
    """The design of a problem file; ``at`` and ``candidates`` as `design_of` has them.

    Raises:
        MbmError: the problem, the data or the call is wrong; not-designed, no-candidates, unknown-quantity.

    """
    from mbm.api.designs import design_of

    problem = _asked(opened(path, sandbox=options.sandbox), options)
    return design_of(problem, inputs_of(options), at, candidates, wish)


def trajectory_file(
    path: str | Path, options: SolveOptions, deltas: Sequence[str] = (), observation: str | None = None
) -> TrajectoryAnswer:
    """The errors of the trajectory that a problem file aligns; ``deltas`` are steps, ``observation`` names the clause.

    Where every unknown is fixed, nothing is solved: the errors are those of that alignment.

    Raises:
        MbmError: the problem, the data or the call is wrong; no-trajectory, several-trajectories, bad-delta.

    """
    from mbm.report.run import asked_options, unsolved
    from mbm.report.trajectories.answer import TrajectoryAnswer, known_place, trajectories_of
    from mbm.report.trajectories.trajectory import chosen_block, trajectory

    ready = _ready(path, options)
    found = ready.elaborated
    chosen_block(found.problem, observation)
    place = known_place(found, ready.kernels, ready.cache)
    if place is None:
        result = ready.result(options)
        return TrajectoryAnswer(result=result, trajectories=trajectories_of(result, deltas, observation))
    asked = asked_options(ready.cache.backend.name, ready.inputs.overrides, ready.inputs.paths, options.init)
    result = unsolved(found.problem, found.raw, file=ready.origin.file, asked=asked)
    result = replace(result, reads=ready.origin.reading.journal.reads())
    return TrajectoryAnswer(result=result, trajectories=(trajectory(place, {}, deltas, observation),))


def emit_file(path: str | Path, options: SolveOptions, target: str) -> tuple[SolverFile, ...]:
    """What ``mbm compile`` does: the files of a solver for a problem; ``target`` is ``c``, ``python`` or ``casadi``.

    Of ``options`` count the problem's name, constants and starts, the files of tables, initial values, and the sandbox.
    The data decide nothing but the test that comes with the solver, and where it begins if neither the problem nor the
    initial values say.

    Raises:
        MbmError: the problem or its data are wrong, or it has something that generated solvers do not have.

    """
    problem = opened(path, sandbox=options.sandbox)
    found = compiler.elaborated(problem.program, options.problem, inputs_of(options), problem.registry)
    return compiler.emitted(found, target, problem.registry, options.init)


def inputs_of(options: SolveOptions) -> Inputs:
    """What comes from outside the file."""
    return Inputs(
        paths={name: str(given) for name, given in options.data.items()},
        overrides={name: Override(name=name, text=text) for name, text in options.set},
        sandbox=options.sandbox,
        allow_external=options.allow_external,
        drawing=options.drawing,
    )


def check(
    path: str | Path,
    *,
    problem: str | None = None,
    strict_units: bool = False,
    data: Mapping[str, Path] | None = None,
    sandbox: Path | None = None,
    allow_external: bool = False,
) -> tuple[Diagnostic, ...]:
    """Diagnostics of one problem of a file, or of all of them."""
    loaded = opened(path, sandbox=sandbox)
    paths = {k: str(v) for k, v in (data or {}).items()}
    inputs = Inputs(paths=paths, sandbox=sandbox, allow_external=allow_external)
    program = loaded.program
    if problem is None and not loaded.names and (program.models or program.functions or program.constants):
        return ()  # a file of definitions, for others to use
    found: dict[Diagnostic, None] = {}
    for name in (problem,) if problem is not None else loaded.names or (None,):
        chosen = loaded if name is None else loaded.named(name)
        found.update(dict.fromkeys(chosen.diagnostics(inputs, strict_units=strict_units)))
    return tuple(found)


def sequences(
    path: str | Path,
    *,
    problem: str | None = None,
    data: Mapping[str, Path] | None = None,
    sandbox: Path | None = None,
    allow_external: bool = False,
) -> tuple[str, ...]:
    """For each problem of a file that has states, which must be right, its steps in words.

    Raises:
        MbmError: a problem is wrong.

    """
    loaded = opened(path, sandbox=sandbox)
    if "states" not in loaded.program.source.text:
        return ()
    from mbm.report.explain import steps_text

    paths = {name: str(given) for name, given in (data or {}).items()}
    inputs = Inputs(paths=paths, sandbox=sandbox, allow_external=allow_external)
    told = []
    for name in (problem,) if problem is not None else loaded.names or (None,):
        found = compiler.elaborated(loaded.program, name, inputs, loaded.registry)
        if found.problem.sequence is not None:
            words = steps_text(found.problem, found.problem.sequence, found.tables)
            told.append(f"problem `{found.problem.name}`: {words}")
    return tuple(told)


def explain(
    path: str | Path,
    *,
    problem: str | None = None,
    latex: bool = False,
    stage: str | None = None,
    sandbox: Path | None = None,
    allow_external: bool = False,
) -> str:
    """The derived observation model as text, or what a stage made: ``forms problem symbolic kernels``."""
    from mbm.equations.binding import EvaluationCache
    from mbm.report import explain as explaining

    if stage == "forms":
        from mbm.text.printer import print_form
        from mbm.text.reader import read

        return joined(print_form(form) for form in read(read_file(Path(path), str(path)))) + "\n"
    loaded = opened(path, sandbox=sandbox)
    inputs = Inputs(sandbox=sandbox, allow_external=allow_external)
    found = compiler.elaborated(loaded.program, problem, inputs, loaded.registry)
    if stage == "problem":
        return explaining.problem_stage(found.problem, found.tables)
    if stage == "symbolic":
        return explaining.symbolic_stage(compiler.symbolic(found), latex=latex)
    kernels = compiler.derived(found)
    if stage == "kernels":
        return explaining.kernel_stage(kernels)
    functions = compiler.called_functions(kernels, inputs, loaded.reading.base)
    cache = EvaluationCache(loaded.registry.suited(loaded.registry.backend("auto"), kernels, functions))
    return explaining.explanation(
        found, compiler.symbolic(found), kernels, cache, loaded.registry.closed_forms(), latex=latex
    )


def expand(path: str | Path, form_text: str, *, sandbox: Path | None = None) -> str:
    """The form that ``form_text`` expands to with the definitions of a file."""
    from mbm.language.limits import recursion_room
    from mbm.language.session import open_session
    from mbm.language.special import value_form
    from mbm.shapes.model import make_model
    from mbm.text.printer import print_form
    from mbm.text.reader import read

    loaded = opened(path, sandbox=sandbox)
    registry = loaded.registry
    session = open_session(loaded.program, registry.vocabulary(), make_model, registry.limits)
    lines = []
    with recursion_room(registry.limits):
        for form in read(Source("<form>", form_text)):
            value = session.evaluator.evaluate(form, session.scope)
            lines.append(print_form(value_form(value, form.span)))
    return joined(lines) + "\n"
