"""Residuals of a solution: a summary for each clause, and each scalar with its row in the file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.binding import Group, block_rows, measured_side
from mbm.equations.corrected import CorrectedColumn
from mbm.equations.solves import lines_of, mean_roots, used_rows
from mbm.equations.types import NoiseState
from mbm.estimation.search.solution import Solution
from mbm.problem.naming import PRIOR
from mbm.problem.provenance import Provenance
from mbm.problem.tables import Table
from mbm.problem.types import BlockRole, Problem
from mbm.report.encode import number
from mbm.report.row_data import ResidualRow, ResidualSummary, RowData
from mbm.report.types import Floats, Mask, PriorReport
from mbm.text.types import DataPlace

if TYPE_CHECKING:
    from mbm.estimation.batches.types import Corrections


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
    """Rows, rows used and their normalised root mean square, and outliers, of each observation."""
    counting, blocks = _counted(solution)[None], len(problem.blocks)
    lines = lines_of(solution.groups, counting[0])
    rms, used = mean_roots(lines, normalised(solution)[None], counting, blocks), used_rows(lines, counting, blocks)
    found = {}
    for i, block in enumerate(problem.blocks):
        if block.role is not BlockRole.OBSERVATION:
            continue
        table = solution.tables[block.table] if block.table is not None else None
        bad = _outlier_positions(solution, i)
        found[block.name] = ResidualSummary(
            rows=len(table) if table is not None else 1,
            used=int(used[0, i]),
            rms=number(float(rms[0, i])),
            outliers=tuple(sorted(int(table.rows[p]) for p in bad)) if table is not None else (1,) * len(bad),
            outlier_places=places_of(table, bad) if table is not None else (),
        )
    return found


def places_of(table: Table, positions: list[int]) -> tuple[DataPlace, ...]:
    """Where rows stand in their files, in the order of the table; none if one shares its line with another row."""
    rows = sorted(int(table.rows[p]) for p in positions)
    if any(_shares_its_line(table.provenance, row) for row in rows):
        return ()
    return tuple(table.provenance.place(row) for row in rows)


def _shares_its_line(provenance: Provenance, row: int) -> bool:
    """Whether a row of a table written in the problem stands on one line with another, which names neither."""
    beside = [near for near in (row - 1, row + 1) if 0 < near <= provenance.rows]
    return any(_on_one_line(provenance.place(row), provenance.place(near)) for near in beside)


def _on_one_line(a: DataPlace, b: DataPlace) -> bool:
    return (a.file, a.row) == (b.file, b.row)


def _counted(solution: Solution) -> Mask:
    """Which residuals (m,) counted at all."""
    found = np.ones(len(solution.residuals), dtype=bool)
    for group in solution.groups:
        lines = found[group.first : group.first + group.count]
        lines.reshape(group.rows, group.kernel.outputs)[...] = group.counting
    return found if solution.weights is None else np.asarray(found & (solution.weights > 0.0))


def _outlier_positions(solution: Solution, owner: int) -> list[int]:
    """Positions in the table (0 without one) of the rows of a block that hold an outlier."""
    found: list[int] = []
    for group in solution.groups:
        if solution.outliers is None or group.kernel.owner != owner:
            continue
        lines = solution.outliers[group.first : group.first + group.count]
        bad = np.flatnonzero(lines.reshape(group.rows, group.kernel.outputs).any(axis=1))
        found.extend([0] * len(bad) if group.positions is None else group.positions[bad].tolist())
    return found


def residual_rows(problem: Problem, solution: Solution) -> tuple[ResidualRow, ...]:
    """Every scalar residual of the rows in use, clause by clause and row by row."""
    whitened, leverages = normalised(solution), _leverages(solution)
    rows: list[tuple[int, int, int, ResidualRow]] = []
    for group in solution.groups:
        block = problem.blocks[group.kernel.owner]
        values = group.written.values(solution.numbers)
        table = solution.tables[block.table] if block.table is not None else None
        outputs = np.flatnonzero(group.counting).tolist()
        for i in range(group.rows):
            position = int(group.positions[i]) if group.positions is not None else None
            row = int(table.rows[position]) if table is not None and position is not None else None
            file_row = table.place(position).row if table is not None and position is not None else None
            for j, output in enumerate(outputs):
                place = group.first + i * group.kernel.outputs + output
                weight = 1.0 if solution.weights is None else float(solution.weights[place])
                scalar = ResidualRow(
                    clause=block.name,
                    row=row,
                    file_row=file_row,
                    component=j + 1,
                    value=float(values[i, j]),
                    residual=float(whitened[place]),
                    weight=weight,
                    used=weight > 0.0,
                    outlier=solution.outliers is not None and bool(solution.outliers[place]),
                    leverage=None if leverages is None else float(leverages[place]),
                )
                rows.append((group.kernel.owner, row or 0, j, scalar))
    rows.sort(key=lambda r: r[:3])
    return tuple(r[3] for r in rows)


def _leverages(solution: Solution) -> Floats | None:
    """The diagonal (m,) of the projection onto what the estimates can change, as they were weighted.

    None where the Jacobian is sparse or that of other rows, and where it is not finite.
    """
    jacobian, factor = solution.minimum.jacobian, solution.covariance.factor
    if solution.minimum.blocks is not None or solution.covariance.inverse is not None or factor.ndim != 2:
        return None
    if jacobian.shape != (len(solution.residuals), len(factor)) or not factor.shape[1]:
        return None
    image = jacobian @ factor
    if not bool(np.isfinite(image).all()):
        return None
    return np.asarray(np.square(np.linalg.qr(image)[0]).sum(axis=1))


def row_data(problem: Problem, solution: Solution) -> Mapping[str, RowData]:
    """The columns of the table of each observation that has one."""
    found = {}
    for block in problem.blocks:
        if block.role is not BlockRole.OBSERVATION or block.table is None:
            continue
        table = solution.tables[block.table]
        order = np.argsort(table.rows, kind="stable")
        columns = {
            name: (np.array(column.texts, dtype=object) if column.numbers is None else column.numbers)[order]
            for name, column in table.columns.items()
        }
        found[block.name] = RowData(rows=table.rows[order], columns=columns)
    return found


def prior_reports(problem: Problem, solution: Solution) -> tuple[PriorReport, ...]:
    """Each prior at the estimates, one for each scalar whose mean is known beforehand."""
    found = []
    for group in solution.groups:
        block = problem.blocks[group.kernel.owner]
        if block.role is not BlockRole.PRIOR:
            continue
        mean = measured_side(problem, group, solution.tables)
        if mean is None:
            continue
        values = group.values(solution.numbers)
        sigmas = np.hstack([stated_sigmas(w.weights) for w in group.whiteners])
        for (i, j), difference in np.ndenumerate(values):
            found.append(
                PriorReport(
                    name=prior_name(solution, group, block.name, int(i), int(j)),
                    value=float(mean[i, j] + difference),
                    mean=float(mean[i, j]),
                    sigma=float(sigmas[i, j]),
                    residual=float(difference / sigmas[i, j]),
                )
            )
    return tuple(found)


def column_corrections(columns: Sequence[Corrections], place: int) -> tuple[CorrectedColumn, ...]:
    """The corrections of each uncertain column in one of many solves."""
    found = []
    for each in columns:
        mine = slice(int(each.first[place]), int(each.first[place + 1]))
        rows = tuple(row if row > 0 else None for row in each.rows[mine].tolist())
        keys = None if each.keys is None else tuple(each.keys[mine])
        found.append(
            CorrectedColumn(
                table=each.table,
                column=each.column,
                rows=rows,
                keys=keys,
                value=each.value[mine],
                sigma=each.sigma[mine],
            )
        )
    return tuple(found)


def stated_sigmas(weights: Floats) -> Floats:
    """Standard deviations (rows, k): of weights 1/σ, or of matrices W with W C Wᵀ = 1."""
    if weights.ndim == 2:
        return np.asarray(1 / weights)
    roots = np.linalg.inv(weights)
    return np.asarray(np.sqrt((roots**2).sum(axis=2)))


def prior_name(solution: Solution, group: Group, name: str, row: int, component: int) -> str:
    """What a number of the prior called ``name`` is called: after the unknown, where it is of one."""
    if name.startswith(PRIOR) and len(group.kernel.tangents) == group.kernel.outputs:
        return PRIOR + solution.layout.name(int(group.columns[row, component]))
    return name
