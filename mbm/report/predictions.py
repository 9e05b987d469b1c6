"""A derived quantity at other values than its own, and the interval of a new reading there."""

from __future__ import annotations

from dataclasses import replace
from math import prod
from typing import Any

import numpy as np

from mbm.data.shaping import table_from_given
from mbm.equations.types import NoiseState
from mbm.equations.whitening import stated_noise
from mbm.estimation.search.solution import Solution
from mbm.estimation.uncertainty.student import coverage_factors
from mbm.expression.nodes import Component, leaves
from mbm.expression.units import scale_of
from mbm.problem.provenance import Provenance
from mbm.problem.residual_units import Modelled, columns_of, observations_of
from mbm.problem.tables import Table
from mbm.problem.types import Derived, Equation, NoiseKind, Problem
from mbm.report import faults
from mbm.report.frames import frame
from mbm.report.intervals import Intervals, intervals, level_of
from mbm.report.quantities import derived_quantity, derived_value, value_elsewhere
from mbm.report.spreads import ConsideredConstant
from mbm.report.types import DerivedValue, Floats, SolveReport
from mbm.text.suggest import suggestion
from mbm.text.types import MbmError
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reading:
    """The interval of a new reading: ``low`` and ``high`` as those of the quantity, of the observation ``clause``."""

    clause: str
    low: Floats
    high: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """A derived quantity for the rows of ``table`` (None: it has one value), and its intervals in the unit shown.

    ``level`` is their coverage probability.
    ``reading`` is None where no observation, or more than one, has it for its MODEL.
    """

    table: Table | None
    item: DerivedValue
    level: float
    intervals: Intervals
    reading: Reading | None


def predicted(
    solve: SolveReport, name: str, at: object = None, *, level: float | None = None, clause: str | None = None
) -> Prediction:
    """A derived quantity of a solve at the values ``at``: a table, or numbers where it depends on one column.

    None: where it was derived. ``level`` is that of the intervals (None: that of the solve), ``clause`` the observation
    whose noise a new reading has.

    Raises:
        KeyError: no derived quantity is called so.
        ValueError: the level is no number between 0 and 1.
        MbmError: not-predicted, or what is wrong with the table.

    """
    names = [item.quantity.name for item in solve.derived]
    if name not in names:
        message = f"`{name}` is not derived; there are {', '.join(names)}" if names else f"`{name}` is not derived"
        raise KeyError(message)
    if solve.boxes is not None:
        raise _refused(name, "interval methods give bounds", "solve with another `:method`")
    if solve.made_from is None:
        raise _refused(name, "a result that was pickled has no equations", "solve again, or predict before pickling")
    problem, solution = solve.made_from()
    derived = next(each for each in problem.derived if each.name == name)
    table = None if at is None else _table(solution, derived, at)
    item = next(each for each in solve.derived if each.quantity.name == name) if at is None else None
    with solution.lock:
        return prediction(
            problem, solution, derived, table, item, level=level, clause=clause, considered=solve.considered
        )


def prediction(
    problem: Problem,
    solution: Solution,
    derived: Derived,
    table: Table | None,
    item: DerivedValue | None = None,
    *,
    level: float | None = None,
    clause: str | None = None,
    considered: tuple[ConsideredConstant, ...] = (),
) -> Prediction:
    """A derived quantity for the rows of a table in the place of its own (None: its own); as `predicted`.

    ``item`` is the quantity for the rows of its own table, as it was reported. Elsewhere intervals are those of normal
    laws, whatever the constants that are ``considered`` follow.

    Raises:
        MbmError: not-predicted.

    """
    level = level_of(level, problem.request.coverage)
    there = None if table is None else value_elsewhere(problem, solution, derived, table)
    if table is None or there is None:
        table = None if derived.table is None else solution.tables[derived.table]
        own = next(one for one in solution.derived if one.owner == problem.derived.index(derived))
        item = derived_value(problem, solution, own, derived_quantity(problem, derived)) if item is None else item
    else:
        moves = [each.elsewhere(derived.name, table) for each in considered if each.elsewhere is not None]
        item = there
        if moves:
            # Loaded beside uncertain constants only, so that the others start at once.
            from mbm.report.considered import with_moves

            item = with_moves(there, np.stack(moves), np.array([each.dof for each in considered]))
    return Prediction(
        table=table,
        item=item,
        level=level,
        intervals=intervals(item, level),
        reading=_reading(problem, solution, (derived, item, table), level, clause),
    )


def prediction_table(found: Prediction) -> Any:
    """One row for each row of the table: its columns, ``value``, ``sigma``, ``low``, ``high``, and those of a reading.

    Columns of vectors end in ``[1]`` … . A pandas frame, else a dict of arrays.
    """
    arrays: dict[str, Any] = {}
    if found.table is not None:
        for column in found.table.columns.values():
            numbers = None if column.numbers is None else scale_of(column.unit).from_si(column.numbers)
            arrays[column.name] = np.array(column.texts, dtype=object) if numbers is None else numbers
    scale, value, sigma = found.item.quantity.scale, np.asarray(found.item.value), found.item.sigma
    rows, shape = (1, value.shape) if found.table is None else (len(found.table), value.shape[1:])
    sides = {
        "value": scale.from_si(value),
        "sigma": np.full(value.shape, np.nan) if sigma is None else scale.difference_from_si(sigma),
        "low": found.intervals.low,
        "high": found.intervals.high,
    }
    if found.reading is not None:
        sides |= {"reading_low": found.reading.low, "reading_high": found.reading.high}
    for side, numbers in sides.items():
        flat = np.reshape(numbers, (rows, prod(shape)))
        several = flat.shape[1] > 1
        arrays |= {f"{side}[{j + 1}]" if several else side: flat[:, j] for j in range(flat.shape[1])}
    return frame(arrays)


def _refused(name: str, why: str, hint: str) -> MbmError:
    return MbmError(faults.not_predicted(name, why, hint))


def _table(solution: Solution, derived: Derived, at: object) -> Table:
    """The table that was given for a derived quantity, in SI; numbers of its columns are in the units of its own."""
    if derived.table is None:
        why = "it has one value, and depends on no column"
        raise _refused(derived.name, why, "derive it `:over` a table, or a grid such as `(grid t 0s 10s 200)`")
    if derived.kind is not None or solution.elsewhere is None:
        why = "rotations and motions are not" if derived.kind is not None else "filters keep nothing but their answers"
        raise _refused(derived.name, why, "derive it `:over` a table with the rows that you want")
    own = solution.tables[derived.table]
    values = tuple(value for case in derived.cases for value in case.values)
    wanted = sorted({*columns_of(values, own.name), *(name for case in derived.cases for name, _ in case.static)})
    if isinstance(at, int | float):
        at = [at]
    if isinstance(at, np.ndarray | list | tuple) and np.ndim(at) == 1 and np.asarray(at).dtype.kind in "iuf":
        if len(wanted) != 1:
            listed = ", ".join(f"`{name}`" for name in wanted) or "no column"
            raise _refused(derived.name, f"it depends on {listed}, and a list of numbers is one column", "give a table")
        at = {wanted[0]: np.asarray(at, dtype=np.float64)}
    raw = table_from_given("at", at)
    given = {column.name: column for column in raw.columns}
    missing = [name for name in wanted if name not in given]
    if missing:
        why = f"the column `{missing[0]}` is missing"
        raise _refused(derived.name, why, suggestion(missing[0], tuple(given), "give it in the table"))
    columns = {}
    for name, column in given.items():
        mine = own.columns.get(name)
        if mine is not None and mine.is_text is not column.is_text:
            kind = "texts" if mine.is_text else "numbers"
            raise _refused(derived.name, f"the column `{name}` wants {kind}", "give it as the table has it")
        stated = None if mine is None else mine.unit
        numbers = None if column.numbers is None else scale_of(stated).to_si(column.numbers)
        if name in wanted and numbers is not None and not bool(np.isfinite(numbers).all()):
            raise _refused(derived.name, f"the column `{name}` has a number that is not finite", "leave that row out")
        columns[name] = replace(column, numbers=numbers, unit=stated)
    rows = np.arange(1, len(raw.file_rows) + 1)
    provenance = Provenance(path=raw.path, sha256=None, rows=len(rows), file_rows=rows)
    return Table(name=own.name, columns=columns, rows=rows, provenance=provenance)


def _reading(
    problem: Problem,
    solution: Solution,
    found: tuple[Derived, DerivedValue, Table | None],
    level: float,
    clause: str | None,
) -> Reading | None:
    """The interval of a new reading: what is uncertain of the quantity, and the noise of the reading.

    The variance of both together has the degrees of freedom of two estimates of one noise: where the noise is stated or
    tells both, that is exact, else on the safe side.
    """
    derived, item, table = found
    modelled = observations_of(problem, derived)
    if clause is not None:
        modelled = tuple(each for each in modelled if problem.blocks[each.block].name == clause)
        if not modelled:
            why = f"it is not the MODEL of an observation `{clause}`"
            raise _refused(derived.name, why, "name an observation whose MODEL it is, or leave `clause` out")
    if len(modelled) != 1:
        return None
    noise = _noise(problem, solution, modelled[0], table)
    if isinstance(noise, str):
        if clause is not None:
            raise _refused(derived.name, noise, "leave `clause` out for the quantity alone")
        return None
    scale, spread = item.quantity.scale, item.spread
    if item.sigma is None or spread is None or solution.influence is None:
        return None
    own, other = np.square(item.sigma * spread.inflation), np.square(noise).reshape(item.sigma.shape)
    noise_dof = solution.influence.dof_of_noise(modelled[0].block)
    with np.errstate(all="ignore"):
        dof = np.square((own + other) / (own / np.sqrt(spread.dof) + other / np.sqrt(noise_dof)))
    reach = scale.difference_from_si(np.asarray(coverage_factors(level, dof) * np.sqrt(own + other)))
    value = scale.from_si(np.asarray(item.value))
    return Reading(clause=problem.blocks[modelled[0].block].name, low=value - reach, high=value + reach)


def _noise(problem: Problem, solution: Solution, modelled: Modelled, table: Table | None) -> Floats | str:
    """The standard deviations (rows, k) of new readings, or why there are none."""
    block = problem.blocks[modelled.block]
    equation = block.cases[modelled.case].equations[modelled.equation]
    rows, positions = None, None
    if equation.likelihood is not None and not equation.likelihood.normal:
        return f"new readings of `{block.name}` are not normal"
    if block.table is not None:
        columns = {} if table is None else table.columns
        names = {modelled.columns.get(name, name): column for name, column in columns.items()}
        missing = sorted(columns_of(equation.noise, block.table) - set(names))
        if missing:
            return f"the noise of `{block.name}` depends on the column `{missing[0]}`"
        count = 1 if table is None else len(table)
        rows = replace(solution.tables[block.table], columns=names, rows=np.arange(1, count + 1))
        positions = np.arange(count)
    if any(isinstance(leaf, Component) for leaf in leaves(equation.noise)):
        return f"the noise of `{block.name}` depends on unknowns"
    stated = _deviations(equation, stated_noise(equation, rows, positions, solution.tables))
    if stated is None:
        return f"`{block.name}` has bounds, and no distribution"
    if block.structure.per:
        return f"the noise of `{block.name}` is not that of a row alone: {block.structure.what}"
    told = solution.noise.get(modelled.block)
    if told is None:
        return stated
    if told.state not in (NoiseState.ESTIMATED, NoiseState.NOTHING):
        return f"the residuals do not tell the noise of `{block.name}`"
    if told.covariance is not None:
        return stated * np.sqrt(np.diag(told.covariance))
    return stated * told.factor


def _deviations(equation: Equation, stated: Floats) -> Floats | None:
    """The standard deviations (rows, k) of what is stated; None of bounds."""
    size = len(equation.components)
    if equation.noise_kind is NoiseKind.BOUND:
        return None
    if equation.noise_kind is NoiseKind.SIGMA:
        return stated
    matrices = stated.reshape(-1, size, size)
    covariances = np.linalg.inv(matrices) if equation.noise_kind is NoiseKind.INFORMATION else matrices
    return np.asarray(np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)))
