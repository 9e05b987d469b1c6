"""The model between the rows of the data and beyond them, made ready for a picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.layout import Layout
from mbm.estimation.search.solution import Solution
from mbm.expression.evaluate import Values, evaluate
from mbm.expression.nodes import Column, Component, Expression, Leaf, RowChoice, externals, leaves
from mbm.problem.modelled import columns_of, observations_of
from mbm.problem.rows import lookup
from mbm.problem.types import Derived, Problem
from mbm.report.plot_data import Curve
from mbm.report.predictions import Prediction, prediction
from mbm.report.types import Floats

SMOOTH = 200
"""Points of a curve: more than pixels tell apart."""


@np.errstate(all="ignore")
def smooth(problem: Problem, solution: Solution, block: int, abscissa: str, stretch: Floats) -> Curve | None:
    """The model of an observation along a column over the ``stretch`` of numbers that it has.

    None where more than that column and the unknowns decides it: members of families, rows chosen otherwise, functions
    in Python, or the cut of an angle.
    """
    stated = problem.blocks[block]
    if stated.table is None or len(stated.cases) != 1 or not len(stretch):
        return None
    equations = stated.cases[0].equations
    components = tuple(node for each in equations for node in each.components)
    measured = tuple(node for each in equations for node in each.measured or ())
    if not _along(components, stated.table, {abscissa} | columns_of(measured, stated.table)):
        return None
    at = np.linspace(stretch.min(), stretch.max(), SMOOTH)
    table = solution.tables[stated.table]
    row = next((g.positions[:1] for g in solution.groups if g.kernel.owner == block and g.positions is not None), None)
    known = lookup(table, row, solution.tables)

    def value(leaf: Leaf) -> Values:
        if isinstance(leaf, Component):
            return _number(solution.layout, solution.numbers, leaf)
        if isinstance(leaf, Column) and leaf.table == table.name and leaf.name == abscissa:
            return at
        return known(leaf)

    sides = zip(evaluate(components, value), evaluate(measured, value), strict=True)
    values = np.column_stack([np.broadcast_to(np.asarray(a + b), at.shape) for a, b in sides])
    return Curve(abscissa=at, values=values) if np.isfinite(values).all() else None


def band(problem: Problem, solution: Solution, derived: Derived, clause: str | None) -> Prediction | None:
    """A number that is derived over a grid, at enough values for a picture; readings are those of ``clause``.

    None for what is no number, or not over a grid, and where a constant has an uncertainty, which is not in the band.
    """
    if any(constant.sigmas for constant in problem.constants):
        return None
    if derived.grid is None or derived.kind is not None or derived.shape or solution.elsewhere is None:
        return None
    grid = derived.grid if derived.grid.count >= SMOOTH else replace(derived.grid, count=SMOOTH)
    return prediction(problem, solution, derived, grid.rows(), clause=clause)


def curve_of(found: Prediction, abscissa: Floats) -> Curve:
    """The curve of a prediction, its numbers in the unit shown."""
    reading = found.reading
    return Curve(
        abscissa=abscissa,
        values=found.item.quantity.scale.from_si(np.asarray(found.item.value))[:, None],
        band=np.stack([found.intervals.low, found.intervals.high]),
        reading=None if reading is None else np.stack([reading.low, reading.high]),
        coverage=found.level,
    )


def along(problem: Problem, derived: Derived, block: int, abscissa: str | None) -> bool:
    """Whether a quantity over a grid is the MODEL of a block, and its variable the ``abscissa`` of that."""
    if derived.grid is None or abscissa is None:
        return False
    modelled = [each for each in observations_of(problem, derived) if each.block == block]
    return any(dict(each.columns) == {derived.grid.variable: abscissa} for each in modelled)


def _along(nodes: tuple[Expression, ...], table: str, columns: frozenset[str] | set[str]) -> bool:
    """Whether forms depend on these columns of the row at hand, and on plain unknowns."""
    if next(externals(nodes), None) is not None or any(node.angle for node in nodes):
        return False
    for leaf in leaves(nodes):
        if isinstance(leaf, Component) and (leaf.member is not None or leaf.unknown.endswith(")")):
            return False
        if isinstance(leaf, Column) and (leaf.row is not RowChoice.EACH or leaf.table != table):
            return False
    return columns_of(nodes, table) <= columns


def _number(layout: Layout, numbers: Floats, leaf: Component) -> float:
    entry = layout.entry(leaf.unknown)
    return float(numbers[entry.offset + entry.unknown.indices().index(leaf.index)])
