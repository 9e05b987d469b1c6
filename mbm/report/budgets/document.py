"""Budgets for programs: the fields ``budget`` and ``budgets`` of the result document, and rows for CSV."""

from __future__ import annotations

from collections.abc import Sequence
from io import StringIO
from math import isfinite
from typing import Any

from mbm.data.writers import DelimitedLines
from mbm.report.budgets.types import Budget, BudgetRow
from mbm.report.exports import key_cell, key_titles, number_cell, text_cell

COLUMNS = (
    "quantity",
    "input",
    "kind",
    "row",
    "component",
    "count",
    "value",
    "u",
    "unit",
    "sensitivity",
    "contribution",
    "contribution_unit",
    "share",
    "dof",
)
COMBINED = "combined"
"""The kind of the last row of a budget: the quantity itself."""


def budget_document(budget: Budget) -> dict[str, Any]:
    """One budget as the document holds it; ``dof`` is null where there are infinitely many."""
    return {
        "quantity": budget.quantity,
        "value": budget.value,
        "sigma": budget.sigma,
        "unit": budget.unit,
        "dof": _finite(budget.dof),
        "k": _finite(budget.k),
        "U": _finite(budget.U),
        "coverage": budget.coverage,
        "inflation": budget.inflation,
        "rows": [_row(row) for row in budget.rows],
    }


def _row(row: BudgetRow) -> dict[str, Any]:
    return {
        "input": row.input,
        "kind": row.kind.value,
        "row": row.row,
        "component": row.component,
        "count": row.count,
        "value": row.value,
        "unit": row.unit,
        "u": row.u,
        "sensitivity": row.sensitivity,
        "contribution": row.contribution,
        "share": row.share,
        "dof": _finite(row.dof),
    }


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None


def budget_rows(budgets: Sequence[Budget]) -> str:
    """One row for each input as CSV, and one of kind ``combined`` for the quantity; columns are ``COLUMNS``.

    Keys of solves stand before them. Cells are empty where there is no number, ``dof`` where there are infinitely many.
    """
    stream = StringIO(newline="")
    keys = tuple(dict.fromkeys(name for budget in budgets for name in budget.key))
    lines = DelimitedLines(stream)
    lines.row([*key_titles(keys, set(COLUMNS)), *COLUMNS])
    for budget in budgets:
        own = [key_cell(budget.key.get(name)) for name in keys]
        name, unit = text_cell(budget.quantity), text_cell(budget.unit or "")
        for row in budget.rows:
            places = [number_cell(number) for number in (row.row, row.component, row.count, row.value, row.u)]
            numbers = [number_cell(number) for number in (row.sensitivity, row.contribution)]
            cells = [name, text_cell(row.input), row.kind.value, *places, text_cell(row.unit or ""), *numbers, unit]
            lines.row([*own, *cells, number_cell(row.share), number_cell(row.dof)])
        total = [number_cell(budget.value), number_cell(budget.sigma), unit, "", number_cell(budget.sigma), unit]
        lines.row([*own, name, name, COMBINED, "", "", "", *total, number_cell(1.0), number_cell(budget.dof)])
    return stream.getvalue()
