"""What ``mbm budget`` answers: the result of the solve, and the budgets of its quantities, for documents
and CSV.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import StringIO
from typing import Any

from mbm.data.writers import DelimitedLines
from mbm.problem.naming import key_words
from mbm.report.budgets import faults
from mbm.report.budgets.budget import budgets_of
from mbm.report.budgets.types import Budget, BudgetRow
from mbm.report.document import document
from mbm.report.encode import number
from mbm.report.exports import key_cell, key_titles, number_cell, text_cell
from mbm.report.types import Result, ResultStatus, SolveStatus
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass

MOST_TOLD = 5
"""Solves without a budget that are named."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BudgetAnswer:
    """The budgets of each solve: ``solves`` has those of each, none where nothing was solved.

    ``refused`` says what solves of several have none, and why.
    """

    result: Result
    solves: tuple[tuple[Budget, ...], ...]
    refused: tuple[Diagnostic, ...] = ()

    @property
    def status(self) -> ResultStatus:
        """That of the solve."""
        return self.result.status

    @property
    def budgets(self) -> tuple[Budget, ...]:
        """Those of all solves, one after the other."""
        return tuple(budget for solve in self.solves for budget in solve)

    def document(self) -> dict[str, Any]:
        """The result document, each solve with its first ``budget``, and all of them in ``budgets``."""
        found = document(self.result)
        for solve, budgets in zip(found["solves"], self.solves, strict=True):
            every = [budget_document(budget) for budget in budgets]
            solve["budget"], solve["budgets"] = (every[0] if every else None), every
        return found


def answer_of(result: Result, names: Sequence[str] = (), *, by_row: bool = False) -> BudgetAnswer:
    """The budgets of a result; of several solves, those of each that has one.

    Raises:
        MbmError: unknown-quantity; no-budget: no solve has one.

    """
    found: list[tuple[Budget, ...]] = []
    wrong: list[Diagnostic] = []
    first: MbmError | None = None
    for solve in result.solves:
        own: list[Budget] = []
        for name in names or (None,):
            try:
                own.extend(budgets_of(solve, name, by_row=by_row))
            except MbmError as error:
                first = first or error
                if solve.status is not SolveStatus.SKIPPED:
                    wrong += [faults.left_out(key_words(solve.key), each) for each in error.diagnostics]
        found.append(tuple(own))
    if first is not None and (len(result.solves) == 1 or not any(found)):
        raise first
    rest = len(wrong) - MOST_TOLD
    told = (*wrong[:MOST_TOLD], *([faults.more_left_out(rest)] if rest > 0 else []))
    return BudgetAnswer(result=result, solves=tuple(found), refused=told)


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
        "dof": number(budget.dof),
        "k": number(budget.k),
        "U": number(budget.U),
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
        "dof": number(row.dof),
    }


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
