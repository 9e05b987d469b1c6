"""What ``mbm design`` does: exact measurements are made at a point, solved, and what they tell is looked at. What
``Problem.design`` may be asked to choose.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import islice
from typing import TYPE_CHECKING, Protocol, TypedDict

import numpy as np

from mbm import compiler
from mbm.api.considered import Numbers, given as given_numbers, moved
from mbm.api.planned import Plan, Planner
from mbm.compiler import Inputs
from mbm.equations.selection import Selection, selections
from mbm.expression.nodes import Apply, Expression, Number, Operation
from mbm.problem.bounded import called, likelihood_of
from mbm.problem.elaborated import Elaborated
from mbm.problem.joining import prepare
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Block, Equation, EquationCase, Method, NoiseKind, Problem
from mbm.report.designs import faults
from mbm.report.designs.design import Offered, designed
from mbm.report.options import SolveSettings
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.api.compiled import CompiledProblem
    from mbm.equations.binding import EvaluationCache
    from mbm.equations.types import Floats
    from mbm.kernels.types import KernelSet
    from mbm.language.session import Program
    from mbm.problem.tables import TableDeclaration
    from mbm.registry.standard import Registry
    from mbm.report.designs.answer import Design
    from mbm.report.designs.types import DesignWish
    from mbm.report.types import Result
    from mbm.simulation.types import Simulation


class Wishes(TypedDict, total=False):
    """Keywords of ``Problem.design``.

    ``criterion`` is ``"c"`` (least variance of one number: the default for one), ``"A"`` (least sum of variances) or
    ``"D"`` (least determinant of the covariance). ``choose`` is how many candidates to choose, ``budget`` what they may
    cost, ``repeats`` whether one may be chosen again. ``sigma`` is a wanted standard deviation, a number in the unit of
    the quantity or a text such as ``"1mm"``. ``observation`` names the clause whose rows the candidates are, ``seed``
    what the search for sets draws from, ``solve`` which of many solves is planned, from 1.
    """

    criterion: str
    choose: int
    budget: float
    repeats: bool
    sigma: float | str
    observation: str
    seed: int
    solve: int


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

    every = compiler.elaborated(problem.program, problem.name, inputs, problem.registry, load)
    _refuse(every.problem)
    plan, given, point = plans[-1], at, "given"
    every, key = _with_key(every, plan.candidates, wish.solve)
    if given is None:
        given = _estimated(problem, inputs, key) if plan.measured else None
        point = "start" if given is None else "estimates"
    exact, notes = _exact(every, wish.solve, problem, inputs, given or {})
    solved = _solved(exact.of(every), problem, inputs)

    def again(numbers: Numbers) -> Result:
        others = given_numbers(inputs, every.problem.constants, numbers)
        other = compiler.elaborated(problem.program, problem.name, others, problem.registry, lambda _: exact.raw)
        return _solved(exact.of(other), problem, others)

    pairs = [
        (constant, (below.solves[0], above.solves[0]))
        for constant, below, above in moved(every.problem.constants, again)
    ]
    return designed(solved.solves[0], plan.candidates, wish, key=key, point=point, notes=notes, moved=pairs)


def _selection(every: Elaborated, number: int) -> Selection:
    """The tables of one of the solves of a problem.

    Raises:
        MbmError: not-designed: there are fewer; what is wrong with the columns that tell them apart.

    """
    count, picked = selections(every.problem, every.tables)
    found = next(islice(picked, number - 1, None), None)
    if found is None:
        why = f"solve {number} is asked for, and there are {count}"
        raise MbmError(faults.not_designed(why, f"give a number from 1 to {count}"))
    return found


def _with_key(every: Elaborated, offered: Offered | None, number: int) -> tuple[Elaborated, Mapping[str, CellKey]]:
    """The key of one of the solves, and the tables with it in the cells of candidates that have no key of their own."""
    key = _selection(every, number).key
    if offered is None or not offered.keyless:
        return every, key
    table = every.raw[offered.table]
    ours, columns = table.rows >= offered.first, dict(table.columns)
    for name in offered.keyless:
        column, cell = columns[name], key[name]
        if column.texts is not None:
            texts = tuple(str(cell) if own else text for own, text in zip(ours, column.texts, strict=True))
            columns[name] = replace(column, texts=texts)
        else:
            columns[name] = replace(column, numbers=np.where(ours, cell, np.asarray(column.numbers)))
    raw = {**every.raw, offered.table: replace(table, columns=columns)}
    return replace(every, raw=raw, tables=prepare(every.problem, raw)), key


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Exact:
    """Measurements that meet a problem exactly: ``raw`` tables, and ``starts`` that are the true values.

    ``factors`` are those of unknown noise by name; ``number`` is that of the solve.
    """

    raw: Mapping[str, Table]
    starts: Mapping[str, tuple[float, ...]]
    factors: Mapping[str, float]
    number: int

    def of(self, every: Elaborated) -> Elaborated:
        """The one solve of these measurements, with stated noise and without losses."""
        problem = every.problem
        tables = _selection(replace(every, tables=prepare(problem, self.raw)), self.number).tables
        blocks = tuple(_stated(block, self.factors.get(block.factor_name, 1.0)) for block in problem.blocks)
        request = replace(problem.request, method=Method.AUTO, routine=None, robust=None, starts=None)
        one = _alone(replace(every, problem=replace(problem, blocks=blocks, request=request)), tables)
        return replace(one, raw=self.raw, starts=self.starts)


def _alone(every: Elaborated, tables: Mapping[str, Table]) -> Elaborated:
    """The problem of one solve, whose ``tables`` are those."""
    request = replace(every.problem.request, for_each=(), window=None)
    return replace(every, problem=replace(every.problem, request=request), tables=tables)


def _refuse(problem: Problem) -> None:
    """Refuse what has no accuracy of one solve at one point.

    Raises:
        MbmError: not-designed.

    """
    if problem.sequence is not None:
        why = "with `states` what a row tells depends on the steps before and after it"
        raise MbmError(faults.not_designed(why, "simulate the experiments that you compare, with `mbm simulate`"))
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


def _estimated(problem: Opened, inputs: Inputs, key: Mapping[str, CellKey]) -> Mapping[str, object] | None:
    """The result document of the solve with a key of what is measured; None where there is none."""
    from mbm.report.document import document

    try:
        result = problem.compiled(inputs, "auto").result(SolveSettings())
    except MbmError:
        return None
    found = [solve for solve in result.solves if dict(solve.key) == dict(key) and solve.cost is not None]
    return document(replace(result, solves=tuple(found))) if found else None


def _exact(
    every: Elaborated, number: int, problem: Opened, inputs: Inputs, at: Mapping[str, object]
) -> tuple[_Exact, tuple[Diagnostic, ...]]:
    """What measurements of a solve would be without noise, and what had to be assumed.

    Raises:
        MbmError: no-true-value: an unknown has neither a value nor a start; what the simulation cannot solve.

    """
    from mbm.kernels.called_functions import CalledFunctions
    from mbm.report.given_starts import given_starts
    from mbm.report.simulated import noise_factors
    from mbm.simulation.simulate import simulate
    from mbm.simulation.types import Simulating

    selection = _selection(every, number)
    found, blocks = _alone(every, selection.tables), every.problem.blocks
    factors = noise_factors(every.problem, at, {})(selection.key)
    calls = CalledFunctions(problem.program.base, allowed=inputs.allow_external).outputs
    asked = Simulating(seeds=(1,), calls=calls, exact=True)
    values = _anywhere(found, problem, inputs, given_starts(every.problem, every.tables, at)(selection.key))
    made = simulate(found, lambda _: values, lambda _: factors, asked)
    truth = made.truths[0]
    told = {name: known.factor for name, known in factors.items() if known.factor is not None}
    starts = {e.unknown.name: tuple(truth.numbers[e.range].tolist()) for e in truth.layout.entries}
    notes = [
        faults.assumed(f"the noise factor of `{name}` is taken to be 1", "give a result document with `--at`")
        for name in dict.fromkeys(block.factor_name for block in blocks if block.unknown_factor)
        if name not in told
    ]
    if any(block.loss is not None for block in blocks) or every.problem.request.robust is not None:
        notes.append(faults.assumed("no reading is an outlier: losses and `:robust` do not count", "none is needed"))
    notes += [note for note in made.notes if note.code.name == "assumed-value" and at]
    exact = _Exact(raw=_with_cells(found, made), starts=starts, factors=told, number=number)
    return exact, tuple(notes)


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
