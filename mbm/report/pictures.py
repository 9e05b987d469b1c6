"""Measured values against the model, made ready for a picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mbm.estimation.search.solution import Solution
from mbm.expression.nodes import Column, Expression, RowChoice, leaves
from mbm.expression.units import parse_unit
from mbm.problem.rows import column_numbers
from mbm.problem.tables import ROW, Table
from mbm.problem.types import BlockRole, Derived, Problem
from mbm.report.curves import along, band, curve_of, smooth
from mbm.report.elements import unit_text
from mbm.report.plot_data import Curve, PlotData
from mbm.report.residuals import measured_side
from mbm.report.types import Floats
from mbm.scales import SI, Scale


def plot_data(problem: Problem, solution: Solution) -> tuple[PlotData, ...]:
    """For each observation whose measured side has one or two columns: measured and model, over what they depend on.

    Then the numbers that are derived over grids, unless one is the model of such an observation and drawn with it.
    """
    found = [_of_block(problem, solution, i) for i in range(len(problem.blocks))]
    drawn = [each for each in found if each is not None]
    known = {derived.name for _, derived in drawn if derived is not None}
    apart = [_of_grid(problem, solution, each) for each in problem.derived if each.name not in known]
    return (*(data for data, _ in drawn), *(data for data in apart if data is not None))


def _of_block(problem: Problem, solution: Solution, i: int) -> tuple[PlotData, Derived | None] | None:
    """An observation, and the derived quantity that is drawn with it."""
    block = problem.blocks[i]
    if block.role is not BlockRole.OBSERVATION or block.table is None:
        return None
    groups = [g for g in solution.groups if g.kernel.owner == i and g.rows]
    sides = [measured_side(problem, solution, g) for g in groups]
    if not groups or any(s is None for s in sides):
        return None
    measured = np.vstack([s for s in sides if s is not None])
    if measured.shape[1] > 2:
        return None
    model = measured + np.vstack([g.written.values(solution.numbers) for g in groups])
    positions = np.concatenate([g.positions for g in groups if g.positions is not None])
    order = np.argsort(positions, kind="stable")
    first = block.cases[0].equations
    labels = tuple(_label(e, j) for j, e in enumerate(m for q in first for m in q.measured or ()))
    name = _abscissa(tuple(c for q in first for c in q.components), set(labels), block.table)
    at = column_numbers(solution.tables[block.table], name)[positions[order]] if name is not None else None
    over = next((each for each in problem.derived if along(problem, each, i, name)), None)
    made = None if over is None else band(problem, solution, over, block.name)
    curve: Curve | None
    if made is not None and made.table is not None and over is not None and over.grid is not None:
        curve = curve_of(made, made.table.numbers(over.grid.variable))
        curve = _changed(curve, curve.abscissa, (made.item.quantity.scale.to_si,))
    else:
        over, curve = None, None if name is None or at is None else smooth(problem, solution, i, name, at)
    data = PlotData(
        clause=block.name,
        measured=measured[order],
        model=model[order],
        labels=labels,
        abscissa=at,
        abscissa_label=name,
        curve=curve,
    )
    return _in_units(data, solution.tables[block.table]), over


def _in_units(data: PlotData, table: Table) -> PlotData:
    """The numbers in the units that their columns state."""
    across, name = _scale(table, data.abscissa_label)
    scales, labels = zip(*(_scale(table, label) for label in data.labels), strict=True)
    curve, changes = data.curve, tuple(scale.from_si for scale in scales)
    if curve is not None:
        curve = _changed(curve, across.from_si(curve.abscissa), changes)
    return replace(
        data,
        measured=_columns(data.measured, changes),
        model=_columns(data.model, changes),
        labels=tuple(str(label) for label in labels),
        abscissa=None if data.abscissa is None else across.from_si(data.abscissa),
        abscissa_label=name,
        curve=curve,
    )


def _changed(curve: Curve, abscissa: Floats, changes: Sequence[Callable[[Floats], Floats]]) -> Curve:
    """A curve with other numbers in its columns."""
    inner, outer = (None if each is None else changes[0](each) for each in (curve.band, curve.reading))
    return replace(curve, abscissa=abscissa, values=_columns(curve.values, changes), band=inner, reading=outer)


def _columns(numbers: Floats, changes: Sequence[Callable[[Floats], Floats]]) -> Floats:
    """Numbers (n, c), each column changed."""
    return np.stack([change(numbers[:, j]) for j, change in enumerate(changes)], axis=-1)


def _scale(table: Table, name: str | None) -> tuple[Scale, str | None]:
    """The scale of a column, and its name with the unit; SI and the name as it is where there is none."""
    column = None if name is None else table.columns.get(name)
    unit = None if column is None or column.unit is None else parse_unit(column.unit)
    return (SI, name) if unit is None else (unit.scale, f"{name} ({unit.symbol})")


def _of_grid(problem: Problem, solution: Solution, derived: Derived) -> PlotData | None:
    """A number that is derived over a grid, in the units that it is reported in."""
    made = band(problem, solution, derived, None)
    grid = derived.grid
    if made is None or made.table is None or grid is None:
        return None
    unit = unit_text(made.item.quantity)
    return PlotData(
        clause=derived.name,
        measured=np.empty((0, 1)),
        model=np.empty((0, 1)),
        labels=(f"{derived.name} ({unit})" if unit else derived.name,),
        abscissa=np.empty(0),
        abscissa_label=grid.variable if grid.unit is None else f"{grid.variable} ({grid.unit.symbol})",
        curve=curve_of(made, grid.scale.from_si(made.table.numbers(grid.variable))),
    )


def _label(node: Expression, number: int) -> str:
    return node.name if isinstance(node, Column) else f"component {number + 1}"


def _abscissa(nodes: tuple[Expression, ...], measured: set[str], table: str) -> str | None:
    """The one column that the model depends on besides the measured ones, if there is just one."""
    names = {
        leaf.name
        for leaf in leaves(nodes)
        if isinstance(leaf, Column) and leaf.table == table and leaf.row is RowChoice.EACH and leaf.name != ROW
    }
    rest = names - measured
    return next(iter(rest)) if len(rest) == 1 else None
