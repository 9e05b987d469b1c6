"""Measured values against the model, made ready for a picture."""

from __future__ import annotations

import numpy as np

from mbm.estimation.search.solution import Solution
from mbm.expression.nodes import Column, Expression, RowChoice, leaves
from mbm.problem.rows import column_numbers
from mbm.problem.tables import ROW
from mbm.problem.types import BlockRole, Problem
from mbm.report.plot_data import PlotData
from mbm.report.residuals import measured_side


def plot_data(problem: Problem, solution: Solution) -> tuple[PlotData, ...]:
    """For each observation whose measured side has one or two columns: measured and model, over what they depend on."""
    found = []
    for i, block in enumerate(problem.blocks):
        if block.role is not BlockRole.OBSERVATION or block.table is None:
            continue
        groups = [g for g in solution.groups if g.kernel.owner == i and g.rows]
        sides = [measured_side(problem, solution, g) for g in groups]
        if not groups or any(s is None for s in sides):
            continue
        measured = np.vstack([s for s in sides if s is not None])
        if measured.shape[1] > 2:
            continue
        model = measured + np.vstack([g.values(solution.numbers) for g in groups])
        positions = np.concatenate([g.positions for g in groups if g.positions is not None])
        table = solution.tables[block.table]
        order = np.argsort(positions, kind="stable")
        first = block.cases[0].equations
        labels = tuple(_label(e, j) for j, e in enumerate(m for q in first for m in q.measured or ()))
        abscissa = _abscissa(tuple(c for q in first for c in q.components), set(labels), block.table)
        found.append(
            PlotData(
                clause=block.name,
                measured=measured[order],
                model=model[order],
                labels=labels,
                abscissa=column_numbers(table, abscissa)[positions[order]] if abscissa is not None else None,
                abscissa_label=abscissa,
            )
        )
    return tuple(found)


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
