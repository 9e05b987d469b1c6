"""The pipeline in one screenful: text → forms → values → problem → symbolic → kernels → solution → report.

This is the only file that knows the order of the stages. Each stage hands on an immutable value:

    read        characters → Program          text, language
    elaborate   Program + tables → Problem    language, shapes, data, problem
    derive      Problem → KernelSet           symbolic, kernels
    solve       KernelSet + tables → Result   solution, report
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from mbm.data.loader import load_all
from mbm.language.limits import recursion_room
from mbm.language.program import Program, read_program
from mbm.problem.builder import Elaborated, Front, elaborate
from mbm.problem.checks import check_data
from mbm.problem.clauses import select_problem
from mbm.problem.joining import depends_on_values, prepare, same_columns
from mbm.problem.reading.request import requested
from mbm.problem.tables import Table, TableDeclaration
from mbm.problem.types import Override
from mbm.problem.vocabulary import SPECIAL_FORMS
from mbm.registry import Registry
from mbm.text.types import MbmError, Source

if TYPE_CHECKING:
    from mbm.kernels.types import KernelSet
    from mbm.report.options import Progress
    from mbm.report.simulated import Simulator
    from mbm.report.types import Result
    from mbm.solution.binding import EvaluationCache
    from mbm.solution.interruption import Interruption
    from mbm.symbolic.types import SymbolicModel


@dataclass(frozen=True, slots=True, kw_only=True)
class Inputs:
    """What comes from outside the file: tables by value or path, constants and starts, and where reading may go."""

    tables: Mapping[str, object] = field(default_factory=lambda: MappingProxyType({}))
    paths: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    overrides: Mapping[str, Override] = field(default_factory=lambda: MappingProxyType({}))
    sandbox: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SolveSettings:
    """What a caller asks of a solve beyond the file; None leaves it to the file. ``init`` is a parsed JSON document."""

    init: Mapping[str, object] | None = None
    seed: int | None = None
    method: str | None = None
    starts: int | None = None
    covariance_full: bool = False
    progress: Progress | None = None
    interruption: Interruption | None = None


def read(source: Source, path: Path, registry: Registry, sandbox: Path | None = None) -> Program:
    """Characters → definitions of the file and of those it uses."""
    with recursion_room(registry.limits):
        reserved = frozenset({*registry.vocabulary.special_forms, *SPECIAL_FORMS})
        return read_program(source, path, sandbox=sandbox, limits=registry.limits, reserved=reserved)


def elaborated(program: Program, name: str | None, inputs: Inputs, registry: Registry) -> Elaborated:
    """Definitions and tables → typed equations, checked as far as no number decides."""
    definition = select_problem(program, name)
    with recursion_room(registry.limits):
        return elaborate(
            program,
            definition,
            Front(
                vocabulary=registry.vocabulary,
                limits=registry.limits,
                routines=lambda: tuple(form.name for form in registry.closed_forms()),
            ),
            inputs.overrides,
            lambda declarations: _loaded(declarations, program, inputs, registry),
        )


def rebound(found: Elaborated, program: Program, inputs: Inputs, registry: Registry) -> Elaborated | None:
    """The same equations with other tables; None where the equations may change: other columns, or static values.

    Raises:
        MbmError: the data do not go with the equations.

    """
    problem = found.problem
    declarations = tuple(plan.declaration for plan in problem.plans)
    raw = _loaded(declarations, program, inputs, registry)
    if depends_on_values(problem) or not same_columns(found.raw, raw):
        return None
    tables = prepare(problem, raw)
    errors, _ = check_data(problem, tables)
    if errors:
        raise MbmError(*errors)
    return replace(found, raw=raw, tables=tables)


def _loaded(
    declarations: Iterable[TableDeclaration], program: Program, inputs: Inputs, registry: Registry
) -> dict[str, Table]:
    return load_all(
        declarations,
        base=program.base,
        given=inputs.tables,
        paths=inputs.paths,
        sandbox=inputs.sandbox,
        readers=registry.readers,
    )


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
    from mbm.report.given_starts import given_starts
    from mbm.report.run import asked_options, result_of
    from mbm.solution.run import solutions

    asked = requested(
        found.problem,
        seed=settings.seed,
        method=settings.method,
        starts=settings.starts,
        routines=lambda: tuple(form.name for form in registry.closed_forms()),
    )
    found = replace(found, problem=asked)
    return result_of(
        found.problem,
        found.raw,
        solutions(
            found,
            kernels,
            cache,
            given_starts(found.problem, found.tables, settings.init),
            settings.interruption,
            registry.closed_forms,
        ),
        file=file,
        asked=asked_options(cache.backend.name, inputs.overrides, inputs.paths, settings.init),
        covariance_full=settings.covariance_full,
        progress=settings.progress,
    )


def simulator(found: Elaborated, program: Program, inputs: Inputs, registry: Registry, file: str | None) -> Simulator:
    """Typed equations + tables → what makes measurements, as the model predicts them, from true values."""
    from mbm.report.simulated import Simulator
    from mbm.solution.binding import EvaluationCache

    as_read = (replace(p.declaration, columns=(), key=None, skip_missing=False) for p in found.problem.plans)
    return Simulator(
        found=found,
        origins=_loaded(as_read, program, inputs, registry),
        kernels=lambda: (derived(found), EvaluationCache(registry.backends["auto"]())),
        file=file,
    )
