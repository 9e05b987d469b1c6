"""What the command line does with a file: solve, check, explain, expand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from mbm import compiler
from mbm.api.problem import load, opened
from mbm.compiler import Inputs, SolveSettings
from mbm.files.reading import read_file
from mbm.problem.overrides import Override
from mbm.text.shown import joined
from mbm.text.types import Diagnostic, Source

if TYPE_CHECKING:
    from mbm.report.options import PropagationSettings, SimulationSettings, SolveOptions
    from mbm.report.propagation.answer import Propagated
    from mbm.report.simulated import Simulated
    from mbm.report.simulated_files import OutputFile
    from mbm.report.types import Result


def solve_file(path: str | Path, options: SolveOptions) -> Result:
    """What ``mbm solve`` does.

    Raises:
        MbmError: the problem, the data or the call is wrong.

    """
    problem = load(path, sandbox=options.sandbox)
    if options.problem is not None:
        problem = problem.named(options.problem)
    ready = problem.compiled(inputs_of(options), options.backend.value)
    if options.loaded is not None:
        options.loaded()
    return ready.result(settings_of(options))


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

    problem = opened(path, sandbox=options.sandbox)
    if options.problem is not None:
        problem = problem.named(options.problem)
    simulator = problem.simulator(inputs_of(options))
    made = simulator.measurements(settings)
    return made, output_files(problem.program, simulator.found.problem, problem.name, made)


def inputs_of(options: SolveOptions) -> Inputs:
    """What comes from outside the file."""
    return Inputs(
        paths={name: str(given) for name, given in options.data.items()},
        overrides={name: Override(name=name, text=text) for name, text in options.set},
        sandbox=options.sandbox,
        allow_external=options.allow_external,
        drawing=options.drawing,
    )


def settings_of(options: SolveOptions) -> SolveSettings:
    """What is asked of the solve beyond the file."""
    return SolveSettings(
        init=options.init,
        seed=options.seed,
        method=options.method,
        starts=options.starts,
        interruption=options.interruption,
        covariance_full=options.covariance_full,
        progress=options.progress,
        workers=options.workers,
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
    from mbm.report.steps import steps_text

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
