"""A solve → the uncertainty budgets of its estimates and derived quantities (GUM H.1, table H.1; EA-4/02, 6.2).

Contributions are those that the stated covariance is the sum of (`mbm.estimation.uncertainty.statistics`); constants
with an uncertainty are considered as `mbm.report.considered` does it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import isfinite, nan

import numpy as np

from mbm.equations.spreads import Influence
from mbm.equations.types import NoiseState
from mbm.estimation.search.solution import Solution
from mbm.estimation.uncertainty.student import coverage_factor
from mbm.problem.types import Problem
from mbm.report.budgets import faults
from mbm.report.budgets.inputs import Errors, Source, sources
from mbm.report.budgets.types import Budget, BudgetRow, InputKind, Target, called, gradient_of, item_of, targets_of
from mbm.report.elements import Scalar, factors, scalars, shown_sigma, unit_text
from mbm.report.encode import number
from mbm.report.intervals import Intervals, intervals
from mbm.report.types import SolveReport
from mbm.text.types import MbmError
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shown:
    """A scalar, SI per unit of it (``factor``), and its ``interval``."""

    scalar: Scalar
    factor: float
    interval: Intervals

    @property
    def why_none(self) -> str | None:
        """Why it has no standard deviation; None where it has one."""
        if self.scalar.fixed:
            return "it is fixed"
        if self.scalar.at_bound:
            return "it is held at its bound, where no standard deviation is known"
        return None if isfinite(self.scalar.sigma) else self.scalar.reason or "no standard deviation is known"


def shown(solve: SolveReport, targets: list[Target]) -> list[Shown]:
    """What the ``targets`` are shown as, one for each."""
    made: dict[tuple[bool, int], tuple[list[Scalar], np.ndarray, Intervals]] = {}
    found = []
    for target in targets:
        own = (target.derived, target.number)
        if own not in made:
            item = item_of(solve, target)
            each = np.broadcast_to(factors(item.quantity), np.shape(shown_sigma(item)))
            made[own] = list(scalars(item)), np.ravel(each), intervals(item, solve.coverage).flat()
        every, units, flat = made[own]
        place = target.place
        found.append(Shown(scalar=every[place], factor=float(units[place]), interval=flat.at((place,))))
    return found


CLOSED = 1e-8
"""What the squares of the contributions may lack of the variance, relatively: far above rounding."""

SAME = 1e-12
"""Relative difference up to which standard deviations are one: roundings of what a unit makes of it."""

MOST_UNNAMED = 1000
"""Numbers that have a budget without being named: each takes a pass over all rows."""

_TOO_MANY = "there are too many derived numbers to keep their derivatives"


def budgets_of(solve: SolveReport, name: str | None = None, *, by_row: bool = False) -> tuple[Budget, ...]:
    """The budgets of a solve: of the scalars that are called ``name``, or of all that have a standard deviation.

    Args:
        solve: one solve.
        name: an estimate or derived quantity, a member of a family (``cam["left"]``), or one number (``p[1]``).
        by_row: rows, and values of columns, one by one; else those of a clause or column together.

    Raises:
        MbmError: unknown-quantity; no-budget: nothing that was asked for has one, and why.

    """
    targets = list(targets_of(solve))
    if name is not None:
        targets = called(solve, name, targets)
    if not targets and solve.made_from is not None:
        raise MbmError(faults.nothing_estimated())
    if name is None and len(targets) > MOST_UNNAMED:
        raise MbmError(faults.too_many(len(targets)))
    what = name or next((target.name for target in targets), solve.message)
    problem, solution, influence = _solved(solve, what)
    made, every = [], shown(solve, targets)
    for target, each in zip(targets, every, strict=True):
        gradient = gradient_of(solution, target) if each.why_none is None else None
        if gradient is not None:
            with solution.lock:
                found = tuple(sources(problem, solution, influence, gradient))
            made.append(_budget(solve, each, (*found, *_constants(solve, target)), by_row))
        elif name is not None:
            raise MbmError(faults.no_budget(target.name, each.why_none or _TOO_MANY))
    if not made:
        why = next(filter(None, (each.why_none for each in every)), _TOO_MANY)
        raise MbmError(faults.no_budget(what, why))
    return tuple(made)


def _solved(solve: SolveReport, name: str) -> tuple[Problem, Solution, Influence]:
    """What a solve was made from.

    Raises:
        MbmError: no-budget.

    """
    if solve.made_from is None:
        if solve.boxes is not None:
            raise MbmError(faults.no_budget(name, "interval methods give bounds"))
        if solve.estimates or solve.derived:
            why = "a result that was pickled has no equations"
            hint = "solve again, or pickle `result.budgets()` beside the result"
            raise MbmError(faults.no_budget(name, why, hint))
        raise MbmError(faults.no_budget(name, solve.message or "nothing was solved"))
    problem, solution = solve.made_from()
    if solution.influence is None:
        why = "a filter goes on with a distribution, not with the rows before"
        raise MbmError(faults.no_budget(name, why, "solve with `:method batch`, whose covariance is a sum over rows"))
    return problem, solution, solution.influence


def _budget(solve: SolveReport, each: Shown, inputs: tuple[Source, ...], by_row: bool) -> Budget:
    """The budget of a scalar with these inputs."""
    scalar, interval = each.scalar, each.interval
    rows = [row for source in inputs for row in _rows(source, each.factor, scalar.sigma, by_row)]
    if abs(sum(row.share for row in rows) - 1.0) > CLOSED and scalar.sigma > 0.0:
        raise MbmError(faults.no_budget(scalar.name, "its variance is not the sum of what its inputs add"))
    dof = float(interval.dof)
    return Budget(
        quantity=scalar.name,
        value=scalar.value,
        sigma=scalar.sigma,
        unit=unit_text(scalar.quantity) or None,
        dof=dof,
        k=float(interval.k),
        U=float(interval.expanded),
        coverage=solve.coverage,
        inflation=float(interval.k) / coverage_factor(solve.coverage, dof),
        rows=tuple(rows),
        key=solve.key,
    )


def _constants(solve: SolveReport, target: Target) -> Iterator[Source]:
    """The constants that have an uncertainty."""
    for constant in solve.considered:
        moves = (constant.derived if target.derived else constant.estimates)[target.number]
        one = np.zeros(1, dtype=np.int64)
        errors = Errors(
            rows=one,
            components=one,
            units=np.array([constant.unit], dtype=object),
            values=np.array([constant.scale.from_si(constant.value)]),
            sigma=np.array([constant.scale.difference_from_si(constant.sigma)]),
            parts=np.ravel(moves)[target.place : target.place + 1],
        )
        yield Source(name=constant.name, kind=InputKind.CONSTANT, dof=constant.dof, errors=errors)


def _rows(source: Source, factor: float, sigma: float, by_row: bool) -> Iterator[BudgetRow]:
    """The lines of a source, whose parts are divided by the ``factor`` of the quantity's unit."""
    errors = source.errors
    if not by_row or len(errors.parts) == 1 or source.joint:
        yield _line(source, factor, sigma, errors, one=len(errors.parts) == 1)
        return
    order = np.lexsort((errors.components, errors.rows))
    for place in order.tolist():
        which = np.zeros(len(order), dtype=bool)
        which[place] = True
        yield _line(source, factor, sigma, errors.some(which), one=True)


def _line(source: Source, factor: float, sigma: float, errors: Errors, *, one: bool) -> BudgetRow:
    """One line for errors that count together."""
    units = set(errors.units.tolist())
    contribution = float(np.sqrt(np.square(errors.parts).sum())) / factor
    u = float(np.sqrt(np.square(errors.sigma).mean())) if len(units) == 1 and len(errors.sigma) else nan
    if len(errors.sigma) and bool((np.abs(errors.sigma - errors.sigma[0]) <= SAME * errors.sigma[0]).all()):
        u = float(errors.sigma[0])
    sensitivity = contribution / u if u > 0.0 else nan
    if one and errors.parts[0] < 0.0:
        sensitivity = -sensitivity
    row, component = (int(errors.rows[0]), int(errors.components[0])) if one else (0, 0)
    return BudgetRow(
        input=source.name,
        kind=source.kind,
        count=1 if one else len(np.unique(errors.rows if errors.rows.any() else errors.components)),
        value=number(errors.values[0]) if one else None,
        unit=next(iter(units)) if len(units) == 1 and isfinite(u) else None,
        u=number(u),
        sensitivity=number(sensitivity),
        contribution=contribution,
        share=(contribution / sigma) ** 2 if sigma > 0.0 else 0.0,
        dof=source.dof,
        row=row or None,
        component=component or None,
    )


def noise_dof(solve: SolveReport) -> Mapping[str, float]:
    """The degrees of freedom of each estimated noise factor, by the names that ``solve.noise`` has.

    With one noise they are the redundancy; of several, twice the inverse variance of the logarithm of each variance.
    """
    if solve.made_from is None:
        return {}
    problem, solution = solve.made_from()
    if solution.influence is None:
        return {}
    estimated = [number for number, each in solution.noise.items() if each.state is NoiseState.ESTIMATED]
    return {problem.blocks[number].factor_name: solution.influence.dof_of_noise(number) for number in estimated}
