"""What ``mbm design`` does: exact measurements are made at a point, solved, and what they tell is looked at."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from mbm import compiler
from mbm.api.planned import Plan, Planner
from mbm.compiler import Inputs, SolveSettings
from mbm.expression.nodes import Apply, Expression, Number, Operation
from mbm.problem.elaborated import Elaborated
from mbm.problem.joining import prepare
from mbm.problem.likely import called, likelihood_of
from mbm.problem.tables import Table
from mbm.problem.types import Block, Equation, EquationCase, Method, NoiseKind, Problem
from mbm.report.designs import faults
from mbm.report.designs.design import designed
from mbm.text.types import Diagnostic, MbmError

if TYPE_CHECKING:
    from mbm.api.compiled import CompiledProblem
    from mbm.equations.binding import EvaluationCache
    from mbm.equations.types import Floats
    from mbm.kernels.types import KernelSet
    from mbm.language.program import Program
    from mbm.problem.tables import TableDeclaration
    from mbm.registry.standard import Registry
    from mbm.report.designs.answer import Design
    from mbm.report.designs.types import DesignWish
    from mbm.report.types import Result
    from mbm.simulation.types import Simulation


class Opened(Protocol):
    """A problem that was read."""

    @property
    def program(self) -> Program:
        """Its text."""
        ...

    @property
    def name(self) -> str | None:
        """Its name; None: the only one of the file."""
        ...

    @property
    def registry(self) -> Registry:
        """What was plugged in."""
        ...

    @property
    def file(self) -> str | None:
        """Where it was read."""
        ...

    def compiled(self, inputs: Inputs, backend: str) -> CompiledProblem:
        """Ready to be solved."""
        ...


def design_of(
    problem: Opened, inputs: Inputs, at: Mapping[str, object] | None, candidates: object, wish: DesignWish
) -> Design:
    """The design of a problem.

    ``at`` are values of the unknowns by name, or a result document (None: the estimates if all is measured, else the
    starts). ``candidates`` are a path, the name of a table of the problem, or a table (None: there are none).

    Raises:
        MbmError: the problem, the data or the call is wrong; not-designed, no-candidates, unknown-quantity.

    """
    planner = Planner(problem.program, problem.name, inputs, problem.registry, candidates)
    plans: list[Plan] = []

    def load(declarations: Iterable[TableDeclaration]) -> Mapping[str, Table]:
        plans.append(planner.plan(declarations, wish.observation))
        return plans[-1].tables

    found = compiler.elaborated(problem.program, problem.name, inputs, problem.registry, load)
    _refuse(found.problem)
    plan, given, point = plans[-1], at, "given"
    if given is None:
        given = _estimated(problem, inputs) if plan.measured else None
        point = "start" if given is None else "estimates"
    exact, notes = _exact(found, problem, inputs, given or {})
    return designed(_solved(exact, problem, inputs).solves[0], plan.candidates, wish, point=point, notes=notes)


def _refuse(problem: Problem) -> None:
    """Refuse what has no accuracy of one solve at one point.

    Raises:
        MbmError: not-designed.

    """
    request = problem.request
    if request.for_each or request.window is not None or problem.sequence is not None:
        what = "`for-each`" if request.for_each else "`window`" if request.window is not None else "`states`"
        why = f"with {what} there is more than one solve, or more than one step"
        raise MbmError(faults.not_designed(why, "plan one problem without it: `(problem plan :like NAME …)`"))
    if not problem.unknowns:
        raise MbmError(faults.not_designed("the problem has no unknowns", "`mbm solve` says how accurate it is"))
    joined = next((block for block in problem.blocks if block.structure.joins), None)
    if joined is not None:
        why = f"rows of `{joined.name}` do not count one by one: {joined.structure.what}"
        raise MbmError(faults.not_designed(why, "simulate the experiments that you compare, with `mbm simulate`"))
    for block in problem.blocks:
        likelihood = likelihood_of(block)
        if likelihood is not None:
            why = f"what a reading of `{block.name}` tells depends on its value: {called(likelihood)}"
            raise MbmError(faults.not_designed(why, "simulate the experiments that you compare, with `mbm simulate`"))
    if any(constant.sigmas for constant in problem.constants):
        why = "a constant has a standard deviation, which is not counted here"
        raise MbmError(faults.not_designed(why, "make it an unknown with a prior: `(h :init 70cm :sigma 1mm)`"))


def _estimated(problem: Opened, inputs: Inputs) -> Mapping[str, object] | None:
    """The result document of a solve of what is measured; None where there is none."""
    from mbm.report.document import document

    try:
        result = problem.compiled(inputs, "auto").result(SolveSettings())
    except MbmError:
        return None
    found = document(result)
    return found if len(result.solves) == 1 and result.solves[0].cost is not None else None


def _exact(
    found: Elaborated, problem: Opened, inputs: Inputs, at: Mapping[str, object]
) -> tuple[Elaborated, tuple[Diagnostic, ...]]:
    """The problem with stated noise, at values that its measurements meet exactly, and what had to be assumed.

    Raises:
        MbmError: no-true-value: an unknown has neither a value nor a start; what the simulation cannot solve.

    """
    from mbm.kernels.called_functions import CalledFunctions
    from mbm.report.given_starts import given_starts
    from mbm.report.simulated import noise_factors
    from mbm.simulation.simulate import simulate
    from mbm.simulation.types import Simulating

    factors = noise_factors(found.problem, at, {})
    calls = CalledFunctions(problem.program.base, allowed=inputs.allow_external).outputs
    asked = Simulating(seeds=(1,), calls=calls, exact=True)
    values = _anywhere(found, problem, inputs, given_starts(found.problem, found.tables, at)({}))
    made = simulate(found, lambda _: values, factors, asked)
    raw, truth = _with_cells(found, made), made.truths[0]
    told = {name: known.factor for name, known in factors({}).items() if known.factor is not None}
    starts = {e.unknown.name: tuple(truth.numbers[e.range].tolist()) for e in truth.layout.entries}
    blocks = tuple(_stated(block, told.get(block.factor_name, 1.0)) for block in found.problem.blocks)
    request = replace(found.problem.request, method=Method.AUTO, routine=None, robust=None, starts=None)
    plain = replace(found.problem, blocks=blocks, request=request)
    notes = [
        faults.assumed(f"the noise factor of `{name}` is taken to be 1", "give a result document with `--at`")
        for name in dict.fromkeys(b.factor_name for b in found.problem.blocks if b.unknown_factor)
        if name not in told
    ]
    if any(block.loss is not None for block in found.problem.blocks) or found.problem.request.robust is not None:
        notes.append(faults.assumed("no reading is an outlier: losses and `:robust` do not count", "none is needed"))
    notes += [note for note in made.notes if note.code.name == "assumed-value" and at]
    return replace(found, problem=plain, raw=raw, tables=prepare(plain, raw), starts=starts), tuple(notes)


def _anywhere(found: Elaborated, problem: Opened, inputs: Inputs, values: Mapping[str, Floats]) -> Mapping[str, Floats]:
    """Values; if the problem is linear, so that the point does not matter, zero for numbers without value and start."""
    from mbm.equations.layout import layout
    from mbm.estimation.solve.estimate import assemble

    known = {**{name: np.asarray(each) for name, each in found.starts.items()}, **values}
    places = layout(found.problem, found.tables, known)
    missing = places.missing()
    lacking = [e for e in places.entries if bool(missing[e.coordinates].any())]
    if not lacking:
        return values
    kernels, cache = _kernels(found, problem, inputs)
    filled = dict(known)
    for entry in lacking:
        shape = (entry.members, *entry.unknown.shape) if entry.keys is not None else entry.unknown.shape
        numbers = places.start[entry.range].reshape(shape)
        filled[entry.unknown.name] = np.where(np.isnan(numbers), 0.0, numbers)
    equations, _ = assemble(found.problem, kernels, found.tables, filled, cache)
    return filled if equations.linear else values


def _with_cells(found: Elaborated, made: Simulation) -> dict[str, Table]:
    """The tables as read, with the simulated numbers."""
    raw = dict(found.raw)
    for cells in made.cells:
        table = raw[cells.table]
        place = {int(row): i for i, row in enumerate(table.rows)}
        numbers = table.numbers(cells.column).copy()
        numbers[[place[int(row)] for row in cells.rows]] = cells.numbers
        column = replace(table.columns[cells.column], numbers=numbers)
        raw[cells.table] = replace(table, columns={**table.columns, cells.column: column})
    return raw


def _stated(block: Block, factor: float) -> Block:
    """A block with its noise stated, and without a loss."""
    if not block.unknown_factor:
        return replace(block, loss=None)
    cases = tuple(
        EquationCase(static=case.static, equations=tuple(_scaled(each, factor) for each in case.equations))
        for case in block.cases
    )
    return replace(block, cases=cases, unknown_factor=False, loss=None)


def _scaled(equation: Equation, factor: float) -> Equation:
    """An equation whose noise is a factor larger."""
    powers = {NoiseKind.SIGMA: 1, NoiseKind.COVARIANCE: 2, NoiseKind.INFORMATION: -2}
    scale = Number(factor ** powers.get(equation.noise_kind, 1))

    def scaled(node: Expression) -> Expression:
        return Apply(Operation.MULTIPLY, (scale, node), span=node.span)

    return replace(equation, noise=tuple(map(scaled, equation.noise)))


def _kernels(found: Elaborated, problem: Opened, inputs: Inputs) -> tuple[KernelSet, EvaluationCache]:
    from mbm.equations.binding import EvaluationCache

    kernels = compiler.derived(found)
    functions = compiler.called_functions(kernels, inputs, problem.program.base)
    return kernels, EvaluationCache(problem.registry.suited(problem.registry.backend("auto"), kernels, functions))


def _solved(found: Elaborated, problem: Opened, inputs: Inputs) -> Result:
    """The solve at the values that meet all measurements."""
    kernels, cache = _kernels(found, problem, inputs)
    return compiler.solved(found, kernels, inputs, SolveSettings(), cache, problem.file, problem.registry)
