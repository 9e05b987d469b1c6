"""What a solve would refuse before its first step, as far as no start has to be found: bounds, starts, weights."""

from __future__ import annotations

from collections.abc import Mapping

from mbm.equations.layout import layout
from mbm.equations.selection import selections
from mbm.equations.whitening import whitener
from mbm.problem.checks import used_rows
from mbm.problem.rows import rows_of
from mbm.problem.tables import Table
from mbm.problem.types import Block, BlockRole, EquationCase, Problem
from mbm.text.types import Diagnostic, MbmError


def refusals(problem: Problem, tables: Mapping[str, Table]) -> list[Diagnostic]:
    """Errors about bounds, starts, standard deviations and covariances, for the data as a whole."""
    found: list[Diagnostic] = []
    try:
        layout(problem, tables, {})
    except MbmError as error:
        found.extend(error.diagnostics)
    try:
        selections(problem, tables)
    except MbmError as error:
        found.extend(error.diagnostics)
    for block in problem.blocks:
        try:
            _weigh(block, tables)
        except MbmError as error:
            found.extend(error.diagnostics)
    if not found and any(block.errors for block in problem.blocks):
        # Here and below: loaded by problems with errors in columns only, so that others are checked at once.
        from mbm.equations.corrections.measured import check_sharing, measured, rows_of_problem

        try:
            uncertain = rows_of_problem(problem, tables)
            check_sharing(problem, tables, uncertain, measured(problem, tables, uncertain))
        except MbmError as error:
            found.extend(error.diagnostics)
    return found


def _weigh(block: Block, tables: Mapping[str, Table]) -> None:
    if block.role is BlockRole.CONSTRAINT:
        return
    mask = used_rows(block, tables)
    table = tables[block.table] if block.table is not None else None
    for case in block.cases:
        positions = None
        if table is not None and mask is not None:
            positions = rows_of(case.static, table)
            positions = positions[mask[positions]]
        if any(equation.likelihood is not None for equation in case.equations):
            # Loaded by problems with likelihoods only.
            from mbm.equations.likelihoods import readings

            readings(case, table, positions, tables)
            continue
        first, exact = 0, _uncertain(block, case)
        for equation in case.equations:
            whitener(equation, first, table, positions, tables, may_be_exact=exact, may_be_singular=block.singular)
            first += len(equation.components)


def _uncertain(block: Block, case: EquationCase) -> bool:
    """Whether the equations of a case use a column with errors."""
    if not block.errors:
        return False
    from mbm.equations.corrections.measured import uncertain_columns

    return bool(uncertain_columns(block, case))
