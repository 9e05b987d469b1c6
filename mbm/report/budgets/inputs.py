"""The inputs of a solution: rows, measured columns, priors, with their values, deviations and parts in a quantity."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from mbm.equations.binding import Group, block_rows, measured_side
from mbm.equations.corrections.types import MeasuredErrors
from mbm.equations.spreads import Influence
from mbm.equations.types import NoiseState
from mbm.equations.whitening import Whitener
from mbm.estimation.search.solution import Solution
from mbm.estimation.trust.uneven import table_rows
from mbm.expression.units import Unit, parse_unit, scale_of
from mbm.problem.naming import PRIOR
from mbm.problem.rows import row_values
from mbm.problem.types import BlockRole, Equation, Problem
from mbm.report.budgets.types import InputKind
from mbm.report.elements import coordinate_quantity
from mbm.report.quantities import quantity_of
from mbm.report.residuals import prior_name, stated_sigmas
from mbm.report.types import Floats, Mask
from mbm.scales import SI, Scale
from mbm.values import dataclass

KINDS = {
    BlockRole.OBSERVATION: InputKind.ROWS,
    BlockRole.PRIOR: InputKind.PRIOR,
    BlockRole.TRANSITION: InputKind.TRANSITION,
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Errors:
    """P errors: ``rows`` and ``components`` tell them apart (0: there is no such number).

    ``values`` and ``sigma`` are in their ``units``, NaN where there is none; ``parts`` is what an error of one standard
    deviation does to the quantity, SI.
    """

    rows: NDArray[np.int64]
    components: NDArray[np.int64]
    units: NDArray[np.object_]
    values: Floats
    sigma: Floats
    parts: Floats

    def some(self, which: Mask) -> Errors:
        """Some of them."""
        return replace(self, **{each.name: getattr(self, each.name)[which] for each in fields(self)})

    def joined(self, other: Errors) -> Errors:
        """These, then others."""
        pairs = {each.name: (getattr(self, each.name), getattr(other, each.name)) for each in fields(self)}
        return replace(self, **{name: np.concatenate(pair) for name, pair in pairs.items()})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Source:
    """Errors of one kind under one name; ``dof`` are the degrees of freedom of their standard deviations.

    ``joint``: they depend on one another, and have a part together only.
    """

    name: str
    kind: InputKind
    dof: float
    errors: Errors
    joint: bool = False


def sources(problem: Problem, solution: Solution, influence: Influence, gradient: Floats) -> Iterator[Source]:
    """All inputs of a quantity with the ``gradient`` (n,), in the order of the problem, those in use.

    Columns with errors stand behind the clause that names them first.
    """
    own, shared = influence.of_shared(influence.of_residuals(gradient[None]))
    own, measured = influence.of_measured(own)
    found: dict[tuple[int, str], Source] = {}
    for group in solution.groups:
        number = group.kernel.owner
        if problem.blocks[number].role not in KINDS or not group.rows:
            continue
        place = slice(group.first, group.first + group.count)
        part = _Part(
            problem=problem,
            solution=solution,
            group=group,
            factors=influence.factors[place].reshape(group.rows, group.kernel.outputs),
            parts=own[0, place].reshape(group.rows, group.kernel.outputs),
            dof=influence.dof_of_noise(number),
        )
        for source in part.sources():
            known = found.get((number, source.name))
            joined = source if known is None else replace(known, errors=known.errors.joined(source.errors))
            found[number, source.name] = joined
    columns = [] if measured is None else list(_columns(problem, solution, influence, measured))
    for number in range(len(problem.blocks)):
        yield from (source for (owner, _), source in found.items() if owner == number)
        if number in shared:
            yield from _common(problem, solution, number, shared[number][0])
        yield from (source for owner, source in columns if owner == number)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Part:
    """A group of equations; ``factors`` and ``parts`` (rows, outputs) are those of its residuals."""

    problem: Problem
    solution: Solution
    group: Group
    factors: Floats
    parts: Floats
    dof: float

    def sources(self) -> Iterator[Source]:
        """What its rows are; priors of single numbers each under its own name."""
        block = self.problem.blocks[self.group.kernel.owner]
        kind = KINDS[block.role]
        dof = self.dof if kind is InputKind.ROWS else inf
        if self.group.readings is not None:
            yield Source(name=block.name, kind=kind, dof=dof, errors=self._by_likelihood())
            return
        measured = measured_side(self.problem, self.group, self.solution.tables)
        values = np.full(self.parts.shape, np.nan) if measured is None else measured
        units, scales = self._units()
        single = kind is InputKind.PRIOR and self.group.positions is None
        for whitener in self.group.whiteners:
            used = self._used(whitener)
            joint = block.structure.correlation is not None
            if whitener.weights.ndim != 2 or block.structure.free or joint or self.group.readings is not None:
                yield Source(name=block.name, kind=kind, dof=dof, errors=self._joint(whitener, used), joint=joint)
                continue
            outputs = np.arange(whitener.first, whitener.last)
            every = Errors(
                rows=np.repeat(table_rows(self.problem, self.group, self.solution.tables), len(outputs)),
                components=np.tile(outputs + 1 if self.parts.shape[1] > 1 else 0 * outputs, self.group.rows),
                units=np.tile(units[outputs], self.group.rows),
                values=np.stack([scales[o].from_si(values[:, o]) for o in outputs], axis=-1).ravel(),
                sigma=(self._sigmas(whitener, used) / [scales[o].factor for o in outputs]).ravel(),
                parts=self.parts[:, outputs].ravel(),
            )
            if not single:
                yield Source(name=block.name, kind=kind, dof=dof, errors=every.some(used.ravel()))
                continue
            for place in np.flatnonzero(used.ravel()).tolist():
                row, column = divmod(place, len(outputs))
                name = prior_name(self.solution, self.group, block.name, row, int(outputs[column]))
                errors = replace(every.some(np.arange(used.size) == place), components=np.zeros(1, dtype=np.int64))
                yield Source(name=name, kind=kind, dof=dof, errors=errors)

    def _by_likelihood(self) -> Errors:
        """The rows of equations with a likelihood of their own: the information of each, which no deviation tells."""
        used = np.ones(self.group.rows, dtype=bool)
        if self.solution.weights is not None:
            place = slice(self.group.first, self.group.first + self.group.count)
            used = np.asarray((self.solution.weights[place].reshape(self.parts.shape) > 0.0).any(axis=1))
        measured, count = measured_side(self.problem, self.group, self.solution.tables), int(used.sum())
        single = measured is not None and measured.shape[1] == 1
        return Errors(
            rows=table_rows(self.problem, self.group, self.solution.tables)[used],
            components=np.zeros(count, dtype=np.int64),
            units=np.full(count, None, dtype=object),
            values=measured[used, 0] if measured is not None and single else np.full(count, np.nan),
            sigma=np.full(count, np.nan),
            parts=np.sqrt(np.square(self.parts[used]).sum(axis=1)),
        )

    def _used(self, whitener: Whitener) -> Mask:
        """Which components (rows, k) of an equation count, with noise of their own."""
        found = whitener.noisy & self._left_in(whitener)[:, None]
        if self.solution.weights is None:
            return found
        place = slice(self.group.first, self.group.first + self.group.count)
        weights = self.solution.weights[place].reshape(self.parts.shape)
        return np.asarray(found & (weights[:, whitener.first : whitener.last] > 0.0))

    def _left_in(self, whitener: Whitener) -> Mask:
        number = next(i for i, each in enumerate(self.group.whiteners) if each is whitener)
        return np.asarray(~self.group.left_out[:, number])

    def _sigmas(self, whitener: Whitener, used: Mask) -> Floats:
        """The standard deviations (rows, k) of independent components, SI; NaN where nothing tells them."""
        noise = self.solution.noise.get(self.group.kernel.owner)
        if noise is not None and noise.state is NoiseState.NO_REDUNDANCY:
            return np.full(used.shape, np.nan)
        stated = stated_sigmas(np.where(used, whitener.weights, 1.0))
        return np.asarray(stated * self.factors[:, whitener.first : whitener.last])

    def _joint(self, whitener: Whitener, used: Mask) -> Errors:
        """The rows of an equation with a covariance or a likelihood: one error for each row, without a deviation."""
        there = used.any(axis=1)
        count = int(there.sum())
        squares = np.square(self.parts[there, whitener.first : whitener.last]).sum(axis=1)
        return Errors(
            rows=table_rows(self.problem, self.group, self.solution.tables)[there],
            components=np.zeros(count, dtype=np.int64),
            units=np.full(count, None, dtype=object),
            values=np.full(count, np.nan),
            sigma=np.full(count, np.nan),
            parts=np.sqrt(squares),
        )

    def _units(self) -> tuple[NDArray[np.object_], list[Scale]]:
        """The units (outputs,) of the components, None where none is known, and the scales of these."""
        block = self.problem.blocks[self.group.kernel.owner]
        own = [unit for equation in block.cases[self.group.kernel.case].equations for unit in _padded(equation)]
        symbols = np.array([None if unit is None else unit.symbol for unit in own], dtype=object)
        scales = [SI if unit is None else unit.scale for unit in own]
        if not block.name.startswith(PRIOR) or len(self.group.kernel.tangents) != self.group.kernel.outputs:
            return symbols, scales
        entry = self.solution.layout.owner(int(self.group.columns[0, 0]))
        quantity = quantity_of(self.problem, entry.unknown)
        each = [coordinate_quantity(quantity, place) for place in range(len(own))]
        return np.array([one.unit for one in each], dtype=object), [one.scale for one in each]


def _common(problem: Problem, solution: Solution, number: int, parts: Floats) -> Iterator[Source]:
    """What rows of a block share: ``parts`` (q,) entry by entry, of each for every value of its column."""
    block = problem.blocks[number]
    if block.table is None:
        return
    table, groups = solution.tables[block.table], [g for g in solution.groups if g.kernel.owner == number and g.rows]
    positions = np.sort(np.concatenate([np.asarray(group.positions) for group in groups]))
    units = {unit for case in block.cases for equation in case.equations for unit in _padded(equation)}
    unit = next(iter(units)) if len(units) == 1 else None
    first = 0
    for column, form in zip(block.structure.per, block.shared, strict=False):
        keys = table.keys(column)
        count = len({keys[position] for position in positions.tolist()})
        deviations = row_values(form, solution.tables)[positions].ravel()
        alike = len(units) == 1 and bool((deviations == deviations[0]).all())
        sigma = (SI if unit is None else unit.scale).difference_from_si(deviations[0]) if alike else np.nan
        errors = Errors(
            rows=np.zeros(count, dtype=np.int64),
            components=np.arange(1, count + 1),
            units=np.full(count, None if unit is None else unit.symbol, dtype=object),
            values=np.full(count, np.nan),
            sigma=np.full(count, sigma),
            parts=parts[first : first + count],
        )
        first += count
        yield Source(name=f"{block.name} per {column}", kind=InputKind.ROWS, dof=inf, errors=errors)


def _padded(equation: Equation) -> tuple[Unit | None, ...]:
    """The units of an equation's components; None for those of equations that have none."""
    return equation.units or (None,) * len(equation.components)


def _columns(
    problem: Problem, solution: Solution, influence: Influence, measured: MeasuredErrors
) -> Iterator[tuple[int, Source]]:
    """The measured columns with errors, each with the number of the block that names it first."""
    for number, (table, column) in enumerate(measured.names):
        chosen = measured.columns == number
        count = int(chosen.sum())
        owner = next(
            i
            for i, block in enumerate(problem.blocks)
            if any((error.table, error.column) == (table, column) for error in block.errors)
        )
        stated = solution.tables[table].columns[column].unit
        unit, scale = None if stated is None else parse_unit(stated), scale_of(stated)
        own = influence.factors[block_rows(solution.groups, owner)[:1]]
        errors = Errors(
            rows=np.maximum(measured.rows[chosen], 0),
            components=np.zeros(count, dtype=np.int64),
            units=np.full(count, None if unit is None else unit.symbol, dtype=object),
            values=scale.from_si(measured.values[chosen]),
            sigma=scale.difference_from_si(measured.sigma[chosen] * own),
            parts=measured.parts[0, chosen],
        )
        dof = influence.dof_of_noise(owner)
        yield owner, Source(name=f"{table}.{column}", kind=InputKind.ROWS, dof=dof, errors=errors)
