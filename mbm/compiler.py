"""The pipeline in one screenful: text → forms → values → problem → symbolic → kernels → solution → report.

This is the only file that knows the order of the stages. Each stage hands on an immutable value:

    read        characters → Program          text, language
    elaborate   Program + tables → Problem    language, shapes, data, problem
    derive      Problem → KernelSet           symbolic, kernels
    solve       KernelSet + tables → Result   solution, report
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import field
from functools import cache as made_once
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from mbm.problem.elaborated import Consulted, Elaborated
from mbm.problem.types import Problem
from mbm.report.options import SolveSettings
from mbm.text.types import MbmError
from mbm.values import dataclass, replace

if TYPE_CHECKING:
    from mbm.emit.types import OutputFile
    from mbm.equations.binding import EvaluationCache
    from mbm.estimation.run import StartsFinder
    from mbm.kernels.called_functions import CalledFunctions
    from mbm.kernels.types import KernelSet
    from mbm.language.session import Program
    from mbm.problem.builder import Loader
    from mbm.problem.checks import Mentioned
    from mbm.problem.dependence import Facts
    from mbm.problem.overrides import Override
    from mbm.problem.tables import Table, TableDeclaration
    from mbm.registry.standard import Registry
    from mbm.report.simulated import Simulator
    from mbm.report.types import Result
    from mbm.report.view.answers import Viewed
    from mbm.report.view.seeings import Seen
    from mbm.symbolic.types import SymbolicModel
    from mbm.text.types import Diagnostic, Source


@dataclass(frozen=True, slots=True, kw_only=True)
class Inputs:
    """What comes from outside the file: tables by value or path, constants and starts, and where reading may go.

    ``allow_external``: functions in Python that the problem names may be imported and called. ``drawing``: inputs are
    to be drawn, so that they may be without a variance.
    """

    tables: Mapping[str, object] = field(default_factory=lambda: MappingProxyType({}))
    paths: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    overrides: Mapping[str, Override] = field(default_factory=lambda: MappingProxyType({}))
    sandbox: Path | None = None
    allow_external: bool = False
    drawing: bool = False


def read(source: Source, path: Path, registry: Registry, sandbox: Path | None = None) -> Program:
    """Characters → definitions of the file and of those it uses."""
    from mbm.language.limits import recursion_room
    from mbm.language.session import read_program
    from mbm.problem.vocabulary import SPECIAL_FORMS

    with recursion_room(registry.limits):
        reserved = frozenset({*registry.vocabulary().special_forms, *SPECIAL_FORMS})
        return read_program(source, path, sandbox=sandbox, limits=registry.limits, reserved=reserved)


def elaborated(
    program: Program, name: str | None, inputs: Inputs, registry: Registry, load: Loader | None = None
) -> Elaborated:
    """Definitions and tables → typed equations, checked as far as no number decides; ``load`` reads the tables."""
    from mbm.expression.algebra import noting_constants
    from mbm.language.limits import recursion_room
    from mbm.problem.builder import elaborate
    from mbm.problem.clauses import select_problem

    definition, asked = select_problem(program, name), set[str]()
    with recursion_room(registry.limits), noting_constants(asked):
        found = elaborate(
            program,
            definition,
            registry.front(drawing=inputs.drawing),
            inputs.overrides,
            load or (lambda wanted: loaded(wanted, program.base, inputs, registry)),
        )
    return replace(found, consulted=replace(found.consulted, constants=tuple(sorted(asked))))


def loaded(
    declarations: Iterable[TableDeclaration],
    base: Path,
    inputs: Inputs,
    registry: Registry,
    known: Mapping[str, Table] = MappingProxyType({}),
) -> dict[str, Table]:
    """The tables of data clauses, as read; ``base`` is the folder that their paths are relative to.

    Unions take tables that are ``known`` before those of ``declarations``.

    Raises:
        MbmError: what is wrong with any of them.

    """
    from mbm.data.loader import load_all

    return load_all(
        declarations,
        base=base,
        given=inputs.tables,
        paths=inputs.paths,
        sandbox=inputs.sandbox,
        readers=registry.readers(),
        known=known,
    )


def answers(
    problem: Problem, consulted: Consulted, raw: Mapping[str, Table]
) -> tuple[Facts, dict[str, Table]] | tuple[None, None]:
    """What tables of the same columns answer to whatever elaboration asked, and they as the equations see them.

    None where they do not go with these equations: elaboration says best why.
    """
    from mbm.problem.dependence import decisive
    from mbm.problem.joining import prepare

    try:
        tables = prepare(problem, raw)
        return decisive(problem, consulted, raw, tables), tables
    except MbmError:
        return None, None


def rebound(
    found: Elaborated, raw: Mapping[str, Table], known: tuple[Mentioned, ...] | None = None
) -> Elaborated | None:
    """The same equations with other tables; None where these may need other equations. ``known`` as `checked` has it.

    Raises:
        MbmError: the data do not go with the equations.

    """
    from mbm.problem.dependence import columns_of

    if columns_of(found.raw) != columns_of(raw):
        return None
    before, _ = answers(found.problem, found.consulted, found.raw) if not found.consulted.nothing else ((), None)
    now, tables = answers(found.problem, found.consulted, raw)
    return None if tables is None or now != before else checked(replace(found, raw=raw, tables=tables), known)


def checked(found: Elaborated, known: tuple[Mentioned, ...] | None = None) -> Elaborated:
    """Equations that hold for their tables, with the warnings about these; ``known`` is what they mention, if known.

    Raises:
        MbmError: the data do not go with the equations.

    """
    from mbm.problem.checks import check_data

    errors, warnings = check_data(found.problem, found.tables, known)
    if errors:
        raise MbmError(*errors)
    said, problem = (*found.lasting, *warnings), found.problem
    return found if said == problem.warnings else replace(found, problem=replace(problem, warnings=said))


def called_functions(kernels: KernelSet, inputs: Inputs, base: Path) -> CalledFunctions | None:
    """What kernels call; None: they call nothing. ``base`` is the folder of the problem file.

    Nothing is imported before the first call.
    """
    if not any(kernel.calls for kernel in kernels.kernels):
        return None
    from mbm.kernels.called_functions import CalledFunctions

    return CalledFunctions(base, allowed=inputs.allow_external)


def symbolic(found: Elaborated) -> SymbolicModel:
    """Typed equations → SymPy."""
    from mbm.symbolic.model import symbolic_model

    return symbolic_model(found.problem)


def derived(found: Elaborated) -> KernelSet:
    """Typed equations → differentiated kernels."""
    from mbm.kernels.derive import derive

    return derive(symbolic(found))


def solved(
    found: Elaborated,
    kernels: KernelSet,
    inputs: Inputs,
    settings: SolveSettings,
    cache: EvaluationCache,
    file: str | None,
    registry: Registry,
) -> Result:
    """Kernels and tables → estimates, uncertainties, and what the data cannot tell."""
    from mbm.estimation.run import solutions
    from mbm.report.run import asked_options, result_of

    found, starts = _begun(found, settings, registry)
    forms, workers = registry.closed_forms, settings.workers
    with cache.lock:
        result = result_of(
            found.problem,
            found.raw,
            solutions(found, kernels, cache, starts, settings.interruption, forms, workers, settings.moved),
            file=file,
            asked=asked_options(cache.backend.name, inputs.overrides, inputs.paths, settings.init),
            covariance_full=settings.covariance_full,
            progress=settings.progress,
            lock=cache.lock,
        )
        if not any(call.has_jacobian for kernel in kernels.kernels for call in kernel.calls):
            return result
        return replace(result, diagnostics=(*result.diagnostics, *jacobian_doubts(found, kernels, cache)))


def viewed(
    found: Elaborated,
    kernels: KernelSet,
    program: Program,
    inputs: Inputs,
    settings: SolveSettings,
    cache: EvaluationCache,
    registry: Registry,
    number: int,
) -> Viewed:
    """Kernels and tables → one solve, by its number from 1, and what its cameras see, for a picture.

    Raises:
        MbmError: the data do not go with the problem, or there is no such solve.

    """
    from mbm.estimation.run import solutions
    from mbm.report.view.answers import view_of

    found, starts = _begun(found, settings, registry)
    made = solutions(found, kernels, cache, starts, settings.interruption, registry.closed_forms, settings.workers)
    return view_of(found.problem, made, number, seen(found, program, inputs, registry))


def seen(found: Elaborated, program: Program, inputs: Inputs, registry: Registry) -> Seen:
    """Which equations compare images, and the models of the package that no definition hides."""
    from mbm.report.view.models import library_of
    from mbm.report.view.rays import implied_seeings
    from mbm.report.view.tracing import Trace

    trace, words = Trace(), registry.vocabulary()
    traced = trace.vocabulary(words)
    tracing = replace(registry, vocabulary=lambda: traced)
    noted = elaborated(program, found.problem.name, inputs, tracing, lambda _: found.raw)
    library = library_of({**words.functions, **dict.fromkeys(program.models)})
    return trace.seen(noted.problem, implied_seeings(found.problem), library)


def jacobian_doubts(found: Elaborated, kernels: KernelSet, cache: EvaluationCache) -> tuple[Diagnostic, ...]:
    """Warnings about the Jacobians of functions in Python, which are called at the start of the first solve.

    Raises:
        MbmError: a function fails there.

    """
    from mbm.estimation.solve import called_jacobians

    return called_jacobians.jacobian_doubts(found, kernels, cache)


def _begun(found: Elaborated, settings: SolveSettings, registry: Registry) -> tuple[Elaborated, StartsFinder | None]:
    """The problem as the caller wants it solved, and where it is to begin.

    Raises:
        MbmError: the method cannot use what the observations say of their errors.

    """
    from mbm.problem.bounded import refuse_mixed_bounds

    keys = (*found.problem.request.for_each, *settings.for_each)
    if keys != found.problem.request.for_each:
        request = replace(found.problem.request, for_each=keys)
        found = replace(found, problem=replace(found.problem, request=request))
    if not (settings.seed is None and settings.method is None and settings.starts is None):
        from mbm.problem.reading.request import requested

        asked = requested(
            found.problem,
            seed=settings.seed,
            method=settings.method,
            starts=settings.starts,
            routines=lambda: tuple(form.name for form in registry.closed_forms()),
        )
        found = replace(found, problem=asked)
    refuse_mixed_bounds(found.problem)
    if settings.init is None:
        return found, None
    from mbm.report.given_starts import given_starts

    return found, given_starts(found.problem, found.tables, settings.init)


def emitted(
    found: Elaborated, target: str, registry: Registry, init: Mapping[str, object] | None = None
) -> tuple[OutputFile, ...]:
    """Typed equations + tables → the files of a solver in another language, tested against what this one answers."""
    from mbm.emit.blueprint import blueprint
    from mbm.emit.corrections import with_true_values
    from mbm.emit.refusals import refuse, refuse_cells, refuse_startless
    from mbm.emit.targets import files_of
    from mbm.emit.types import Target
    from mbm.equations.binding import EvaluationCache
    from mbm.kernels.derive import derive
    from mbm.problem.bounded import refuse_mixed_bounds
    from mbm.report.references import answers as answered, loss_scale
    from mbm.version import __version__

    made = Target(target)
    refuse_mixed_bounds(found.problem)
    if init is not None:
        from mbm.report.beginnings import with_beginnings

        found = with_beginnings(found, init)
    found = with_true_values(found)
    refuse(found, made)
    model = symbolic(found)
    kernels = derive(model)
    cache = EvaluationCache(registry.suited(registry.backend("auto"), kernels, None))
    if found.problem.sequence is not None:
        from mbm.report.embedded import filter_files_of

        return filter_files_of(found, model, kernels, cache, registry.closed_forms)
    known = answered(found, kernels, cache, registry.closed_forms, solving=made.solves)
    drafted = blueprint(found, model, kernels, known, loss_scale, __version__)
    refuse_startless(found, made, drafted.startless)
    refuse_cells(found, made, drafted.given)
    return files_of(drafted, made)


def simulator(found: Elaborated, program: Program, inputs: Inputs, registry: Registry, file: str | None) -> Simulator:
    """Typed equations + tables → what makes measurements, as the model predicts them, from true values."""
    from mbm.equations.binding import EvaluationCache
    from mbm.kernels.called_functions import CalledFunctions
    from mbm.report.simulated import Simulator

    functions = CalledFunctions(program.base, allowed=inputs.allow_external)

    def made() -> tuple[KernelSet, EvaluationCache]:
        kernels = derived(found)
        return kernels, EvaluationCache(registry.suited(registry.backend("auto"), kernels, functions))

    as_read = (replace(p.declaration, columns=(), key=None, skip_missing=False) for p in found.problem.plans)
    return Simulator(
        found=found,
        origins=loaded(as_read, program.base, inputs, registry, found.raw),
        kernels=made_once(made),
        calls=functions.outputs,
        file=file,
    )
