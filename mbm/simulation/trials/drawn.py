"""The equations of one solve with room for what is drawn, and the draws: each input as its distribution says.

Measured values are drawn about the data, the centres of priors about those that are stated, constants about their
values, and the estimates are those of the draws (GUM Supplement 1, clause 5.9, with the estimator as the model).

Equations with a shift of each component, by which what was measured, or known before, differs in a trial.

Model − measured becomes model − (measured − shift): an equation h states the standard deviation of h, whatever it is
made of, so that every equation can be shifted. Shifts are columns of the block's table, or of one row that all blocks
without a table share.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import isfinite, sqrt

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.types import Floats, Indices, NoiseState
from mbm.estimation.search.solution import Solution
from mbm.estimation.search.starting import with_idle_ones
from mbm.estimation.solve.estimate import assemble
from mbm.expression.algebra import add
from mbm.expression.nodes import Apply, Column, Expression, Operation
from mbm.expression.rows import RowChoice
from mbm.kernels.types import KernelSet
from mbm.problem.overrides import NORMAL_LAW, STUDENT, ConstantValue, Law
from mbm.problem.provenance import Provenance
from mbm.problem.tables import Column as TableColumn, Table
from mbm.problem.types import Block, BlockRole, Equation, EquationCase, Problem
from mbm.simulation.noise import standard_variates, stream
from mbm.simulation.trials import faults
from mbm.symbolic.types import ColumnInput
from mbm.text.types import MbmError
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Redundancy:
    """An unknown noise: the residuals (by place) that have its factor, and the degrees of freedom of that."""

    places: Indices
    dof: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drawn:
    """The equations of one solve, ready to be drawn for.

    ``point`` (N,) are the estimates and the values of constants. ``cells`` (m,) is the place of each residual's shift
    among the parameters, ``free_constants`` the places (k,) of the constants among the numbers, with their standard
    deviations ``sigmas`` (k,) and laws. ``derived`` are the groups of each derived quantity. ``shared`` are residuals
    with noise in common, and what their errors are of independent ones. ``all_drawn``: not only what has no variance.
    """

    problem: Problem
    equations: Assembled
    binder: Binder
    derived: tuple[tuple[Group, ...], ...]
    point: Floats
    cells: Indices
    places: Indices
    sigmas: Floats
    laws: tuple[Law, ...]
    unknown_noise: tuple[Redundancy, ...]
    shared: tuple[tuple[Indices, Floats], ...] = ()
    all_drawn: bool = True

    @property
    def nothing(self) -> bool:
        """Nothing is drawn."""
        return not len(self.cells) and not len(self.places)

    def without_variance(self) -> Drawn | None:
        """The same where only inputs without a variance are drawn; None where all have one.

        t distributions of two degrees of freedom and fewer have none.
        """
        laws = (*self.laws, *(law for group in self.equations.groups for law in _laws(self.problem, group)))
        untold = tuple(each for each in self.unknown_noise if each.dof <= 2.0)
        if not untold and all(law.has_variance for law in laws):
            return None
        steady = [law.has_variance for law in self.laws]
        return replace(self, sigmas=np.where(steady, 0.0, self.sigmas), unknown_noise=untold, all_drawn=False)

    def draws(self, count: int, seed: int, words: tuple[str, ...], number: int) -> tuple[Floats, Floats]:
        """So many draws of block ``number``: points (T, N) to start from, and by how much what each residual compares
        with is more than it is stated (T, m).

        They follow from the seed, the ``words`` that name the solve and the number of the block alone.
        """
        rng = stream(seed, "trials", *words, number)
        points = np.tile(self.point, (count, 1))
        for place, sigma, law in zip(self.places, self.sigmas, self.laws, strict=True):
            points[:, place] += sigma * standard_variates(law, rng, (count,))
        shifts = np.zeros((count, self.equations.whole))
        for group in self.equations.groups:
            shape = (count, group.rows, group.kernel.outputs)
            part = slice(group.first, group.first + group.count)
            shifts[:, part] = (_variates(self.problem, group, rng, shape) * self._drawn(group)).reshape(count, -1)
        for lines, root in self.shared:
            shifts[:, lines] = shifts[:, lines] @ root.T
        for group in self.equations.groups:
            part = slice(group.first, group.first + group.count)
            shape = (count, group.rows, group.kernel.outputs)
            shifts[:, part] = _natural(group, shifts[:, part].reshape(shape)).reshape(count, -1)
        if self.equations.factors is not None:
            shifts *= self.equations.factors
        for each in self.unknown_noise:
            shifts[:, each.places] *= np.sqrt(each.dof / rng.chisquare(each.dof, count))[:, None]
        return points, shifts

    def _drawn(self, group: Group) -> Floats:
        """1 for the residuals (rows, outputs) of a group that are drawn, 0 for others."""
        found = np.full((group.rows, group.kernel.outputs), float(self.all_drawn))
        for law, each in zip(_laws(self.problem, group), group.whiteners, strict=True):
            if not law.has_variance:
                found[:, each.first : each.last] = 1.0
        places = np.arange(group.first, group.first + group.count).reshape(found.shape)
        for untold in () if self.all_drawn else self.unknown_noise:
            found[np.isin(places, untold.places)] = 1.0
        return found

    def derived_values(self, owner: int, points: Floats) -> Floats:
        """A derived quantity at points (T, N), as its kernels state it: (T, rows, outputs); NaN where no case holds."""
        quantity = self.problem.derived[owner]
        rows = 1 if quantity.table is None else len(self.binder.tables[quantity.table])
        outputs = len(quantity.cases[0].values) if quantity.cases else 0
        found = np.full((len(points), rows, outputs), np.nan)
        for group in self.derived[owner]:
            positions = np.arange(1) if group.positions is None else group.positions
            found[:, positions] = group.values_at(self.equations.layout.reported(points))
        return found


def drawn(
    problem: Problem,
    kernels: KernelSet,
    cache: EvaluationCache,
    solution: Solution,
    constants: tuple[ConstantValue, ...],
) -> Drawn:
    """What is drawn for a solve of a problem whose equations have shifts, and whose ``constants`` are unknowns.

    Raises:
        MbmError: `not-propagated`, noise that the residuals do not tell, or corrections that need a search.

    """
    starts = {entry.unknown.name: solution.numbers[entry.range] for entry in solution.layout.entries}
    starts |= {constant.name: np.array(constant.values) for constant in constants}
    equations, binder = assemble(problem, kernels, shifted_tables(problem, solution.tables), starts, cache)
    equations = equations.with_factors(_factors(equations, solution))
    point = with_idle_ones(equations, equations.layout.start)
    places, sigmas, laws = _of_constants(equations, constants)
    return Drawn(
        problem=problem,
        equations=equations,
        binder=binder,
        derived=tuple(binder.derived(kernels, owner) for owner in range(len(problem.derived))),
        point=point,
        cells=_cells(problem, equations),
        places=places,
        sigmas=sigmas,
        laws=laws,
        unknown_noise=_unknown_noise(problem, equations, solution),
        shared=_shared(equations),
    )


def _factors(equations: Assembled, solution: Solution) -> Floats | None:
    """The noise factor of each residual (m,); None: all are 1. That of one unknown noise is no weight of a solve."""
    if not solution.noise:
        return solution.factors
    found = np.ones(equations.whole) if solution.factors is None else solution.factors.copy()
    for number, noise in solution.noise.items():
        found[equations.block_rows(number)] = noise.factor
    return found


def _of_constants(
    equations: Assembled, constants: tuple[ConstantValue, ...]
) -> tuple[Indices, Floats, tuple[Law, ...]]:
    """Where the numbers of constants stand, their standard deviations, and their laws."""
    places: list[int] = []
    sigmas: list[float] = []
    laws: list[Law] = []
    for constant in constants:
        first = equations.layout.entry(constant.name).offset
        law, stretch = _law_with_freedom(constant)
        for k, sigma in enumerate(constant.sigmas):
            places.append(first + k)
            sigmas.append(sigma * stretch)
            laws.append(law)
    return np.array(places, dtype=np.int64), np.array(sigmas), tuple(laws)


def _law_with_freedom(constant: ConstantValue) -> tuple[Law, float]:
    """The law of a constant, and what its standard deviations are multiplied with: those of which degrees of freedom
    are stated are the scale of a t distribution (6.4.9.7).
    """
    dof = constant.dof
    if constant.law != NORMAL_LAW or not isfinite(dof):
        return constant.law, 1.0
    return Law(STUDENT, dof), sqrt(dof / (dof - 2.0)) if dof > 2.0 else 1.0


def _cells(problem: Problem, equations: Assembled) -> Indices:
    """The place of the shift of each residual (m,) among the parameters of all groups."""
    found = np.empty(equations.whole, dtype=np.int64)
    first = 0
    for group in equations.groups:
        width = group.parameters.shape[1]
        if problem.blocks[group.kernel.owner].role in SHIFTED:
            inputs: Mapping[str, int] = {
                parameter.name: j
                for j, parameter in enumerate(group.kernel.parameters)
                if isinstance(parameter, ColumnInput)
            }
            own = [
                inputs[shift_name(group.kernel.owner, place, k)]
                for place, each in enumerate(group.whiteners)
                for k in range(each.last - each.first)
            ]
            cells = first + width * np.arange(group.rows)[:, None] + np.array(own, dtype=np.int64)
            found[group.first : group.first + group.count] = cells.ravel()
        first += group.parameters.size
    return found


def _laws(problem: Problem, group: Group) -> tuple[Law, ...]:
    """The law of each equation of a group."""
    return tuple(each.law for each in problem.blocks[group.kernel.owner].cases[group.kernel.case].equations)


def _variates(problem: Problem, group: Group, rng: np.random.Generator, shape: tuple[int, int, int]) -> Floats:
    """Standard variates (T, rows, outputs) of the laws that the equations of a group state."""
    found = np.zeros(shape)
    for law, each in zip(_laws(problem, group), group.whiteners, strict=True):
        found[:, :, each.first : each.last] = standard_variates(law, rng, (*shape[:2], each.last - each.first))
    return found


def _natural(group: Group, variates: Floats) -> Floats:
    """Whitened draws (T, rows, outputs) with the noise that the equations state; 0 where an equation is left out."""
    found = np.zeros(variates.shape)
    for each in group.whiteners:
        own, weights = variates[:, :, each.first : each.last], each.weights
        if weights.ndim == 2:
            exact = (weights == 0.0) | ~each.noisy
            found[:, :, each.first : each.last] = own / np.where(exact, np.inf, weights)
            continue
        left_out = np.asarray(~weights.any(axis=(1, 2)))
        inverse = np.linalg.inv(np.where(left_out[:, None, None], np.eye(weights.shape[1]), weights))
        inverse[left_out] = 0.0
        found[:, :, each.first : each.last] = np.einsum("rij,trj->tri", inverse, own)
    return found


def _shared(equations: Assembled) -> tuple[tuple[Indices, Floats], ...]:
    """The residuals that share noise, and what makes their whitened errors of independent ones (r, r)."""
    structure = equations.structure
    if structure is None:
        return ()
    return tuple(
        (each.lines, np.asarray(np.linalg.inv(each.independent(np.eye(len(each.lines)), structure.factor(each)))))
        for each in structure.patterns
    )


def _unknown_noise(problem: Problem, equations: Assembled, solution: Solution) -> tuple[Redundancy, ...]:
    """The unknown noises with the degrees of freedom that the linear answer gives them."""
    if not solution.noise or solution.influence is None:
        return ()
    for number, noise in solution.noise.items():
        if noise.state is not NoiseState.ESTIMATED:
            block = problem.blocks[number]
            why = noise.why
            mend = "state the noise with `:sigma`"
            raise MbmError(faults.not_propagated(block.span, f"the unknown noise of `{block.name}`", why, mend))
    shared: dict[str, list[int]] = {}
    for number in solution.noise:
        shared.setdefault(problem.blocks[number].factor_name, []).append(number)
    return tuple(
        Redundancy(
            places=np.concatenate([equations.block_rows(number) for number in numbers]),
            dof=solution.influence.dof_of_noise(numbers[0]),
        )
        for numbers in shared.values()
    )


def weighted(problem: Problem) -> Problem:
    """The problem with its noise taken as known: factors that were estimated are weights of every trial."""
    return replace(problem, blocks=tuple(replace(block, unknown_factor=False) for block in problem.blocks))


SHIFTS = "shift table"
"""The table of blocks without one; no table of a file has a blank in its name."""

SHIFTED = (BlockRole.OBSERVATION, BlockRole.PRIOR)
"""What is drawn."""


def shift_name(block: int, equation: int, component: int) -> str:
    """The column with the shifts of a component; no column of an equation is called so."""
    return f"shift {block} {equation} {component}"


def with_shifts(problem: Problem) -> Problem:
    """The problem with shifted observations and priors."""
    return replace(problem, blocks=tuple(_block(number, block) for number, block in enumerate(problem.blocks)))


def shifted_tables(problem: Problem, tables: Mapping[str, Table]) -> dict[str, Table]:
    """The tables with columns for the shifts of `with_shifts`, all of them zero."""
    names: dict[str, dict[str, None]] = {SHIFTS: {}}
    for number, block in enumerate(problem.blocks):
        if block.role in SHIFTED:
            own = names.setdefault(SHIFTS if block.table is None else block.table, {})
            for case in block.cases:
                own.update(dict.fromkeys(_names(number, case)))
    found = dict(tables)
    for name, columns in names.items():
        table = tables[name] if name != SHIFTS else _one_row()
        zero = np.zeros(len(table))
        added = {each: TableColumn(name=each, numbers=zero) for each in columns}
        found[name] = replace(table, columns={**table.columns, **added})
    return found


def _names(number: int, case: EquationCase) -> tuple[str, ...]:
    return tuple(
        shift_name(number, place, k) for place, each in enumerate(case.equations) for k in range(len(each.components))
    )


def _block(number: int, block: Block) -> Block:
    if block.role not in SHIFTED:
        return block
    cases = tuple(
        replace(
            case,
            equations=tuple(
                _equation(equation, number, place, block.table) for place, equation in enumerate(case.equations)
            ),
        )
        for case in block.cases
    )
    return replace(block, cases=cases)


def _equation(equation: Equation, block: int, place: int, table: str | None) -> Equation:
    row = RowChoice.FIRST if table is None else RowChoice.EACH
    shifts = (
        Column(SHIFTS if table is None else table, shift_name(block, place, k), row, equation.span)
        for k in range(len(equation.components))
    )
    shifted = tuple(_shifted(node, shift) for node, shift in zip(equation.components, shifts, strict=True))
    return replace(equation, components=shifted)


def _shifted(node: Expression, shift: Column) -> Expression:
    """The component with its shift; a difference of angles is wrapped behind it."""
    if isinstance(node, Apply) and node.operation is Operation.WRAP:
        return replace(node, arguments=(add(node.arguments[0], shift),))
    return add(node, shift)


def _one_row() -> Table:
    """The table of blocks without one, without columns."""
    none = Provenance(path=SHIFTS, sha256=None, rows=1, file_rows=np.arange(1, 2))
    return Table(name=SHIFTS, columns={}, rows=np.arange(1, 2), provenance=none)
