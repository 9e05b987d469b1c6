"""Residuals of a solution: a summary for each clause, and each scalar with its row in the file."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.expression.evaluate import Values, evaluate
from mbm.problem.rows import lookup
from mbm.problem.types import BlockRole, Problem
from mbm.report.types import Floats, PriorReport, ResidualRow, ResidualSummary
from mbm.solution.assembly import block_rows
from mbm.solution.binding import Group
from mbm.solution.solution import Solution
from mbm.solution.types import NoiseState


@np.errstate(all="ignore")
def normalised(solution: Solution) -> Floats:
    """Residuals (m,) in standard deviations, infinite or NaN where they are; an estimated noise factor counts."""
    residuals = solution.residuals
    if solution.factors is not None:
        return residuals
    for owner, noise in solution.noise.items():
        if noise.state is NoiseState.ESTIMATED and noise.factor > 0:
            residuals = residuals.copy()
            residuals[block_rows(solution.groups, owner)] /= noise.factor
    return residuals


@np.errstate(all="ignore")
def residual_summaries(problem: Problem, solution: Solution) -> Mapping[str, ResidualSummary]:
    """Rows, rows used, and the normalised root mean square of each observation."""
    values = normalised(solution)
    found = {}
    for i, block in enumerate(problem.blocks):
        if block.role is not BlockRole.OBSERVATION:
            continue
        rows = block_rows(solution.groups, i)
        used = sum(g.rows for g in solution.groups if g.kernel.owner == i)
        squares = values[rows] ** 2
        table = solution.tables[block.table] if block.table is not None else None
        rms = float(np.sqrt(squares.mean())) if len(rows) and np.isfinite(squares).all() else None
        found[block.name] = ResidualSummary(
            rows=len(table) if table is not None else 1,
            used=used,
            rms=rms,
            file=table.provenance.path if table is not None else None,
        )
    return found


def residual_rows(problem: Problem, solution: Solution) -> tuple[ResidualRow, ...]:
    """Every scalar residual of the rows in use, clause by clause and row by row."""
    whitened = normalised(solution)
    rows: list[tuple[int, int, int, ResidualRow]] = []
    for group in solution.groups:
        block = problem.blocks[group.kernel.owner]
        values = group.values(solution.numbers)
        table = solution.tables[block.table] if block.table is not None else None
        for i in range(group.rows):
            position = int(group.positions[i]) if group.positions is not None else None
            row = int(table.rows[position]) if table is not None and position is not None else None
            file_row = table.place(position).row if table is not None and position is not None else None
            for j in range(group.kernel.outputs):
                residual = whitened[group.first + i * group.kernel.outputs + j]
                scalar = ResidualRow(
                    clause=block.name,
                    row=row,
                    file_row=file_row,
                    component=j + 1,
                    value=float(values[i, j]),
                    residual=float(residual),
                    weight=1.0,
                    used=True,
                )
                rows.append((group.kernel.owner, row or 0, j, scalar))
    rows.sort(key=lambda r: r[:3])
    return tuple(r[3] for r in rows)


def measured_side(problem: Problem, solution: Solution, group: Group) -> Floats | None:
    """The measured values (rows, outputs) of a group, or None where the equation has no measured side."""
    block = problem.blocks[group.kernel.owner]
    equations = block.cases[group.kernel.case].equations
    table = solution.tables[block.table] if block.table is not None else None
    columns: list[Values] = []
    for equation in equations:
        if equation.measured is None:
            return None
        columns.extend(evaluate(equation.measured, lookup(table, group.positions, solution.tables)))
    result = np.empty((group.rows, group.kernel.outputs))
    for j, column in enumerate(columns):
        result[:, j] = column
    return result


def prior_reports(problem: Problem, solution: Solution) -> tuple[PriorReport, ...]:
    """Each prior at the estimates, one for each scalar whose mean is known beforehand."""
    found = []
    for group in solution.groups:
        block = problem.blocks[group.kernel.owner]
        if block.role is not BlockRole.PRIOR:
            continue
        mean = measured_side(problem, solution, group)
        if mean is None:
            continue
        values = group.values(solution.numbers)
        sigmas = np.hstack([_sigmas(w.weights) for w in group.whiteners])
        for (i, j), difference in np.ndenumerate(values):
            found.append(
                PriorReport(
                    name=_prior_name(solution, group, block.name, int(i), int(j)),
                    value=float(mean[i, j] + difference),
                    mean=float(mean[i, j]),
                    sigma=float(sigmas[i, j]),
                    residual=float(difference / sigmas[i, j]),
                )
            )
    return tuple(found)


def _sigmas(weights: Floats) -> Floats:
    """Standard deviations (rows, k): of weights 1/σ, or of matrices W with W C Wᵀ = 1."""
    if weights.ndim == 2:
        return np.asarray(1 / weights)
    roots = np.linalg.inv(weights)
    return np.asarray(np.sqrt((roots**2).sum(axis=2)))


def _prior_name(solution: Solution, group: Group, name: str, row: int, component: int) -> str:
    if name.startswith("prior ") and len(group.kernel.tangents) == group.kernel.outputs:
        return f"prior {solution.layout.name(int(group.columns[row, component]))}"
    return name
