"""What ``mbm budget`` answers: the result of the solve, and the budgets of its quantities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mbm.problem.naming import key_text
from mbm.report.budgets import faults
from mbm.report.budgets.budget import budgets_of
from mbm.report.budgets.document import budget_document
from mbm.report.budgets.types import Budget
from mbm.report.document import document
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
                key = ", ".join(f"{column} = {key_text(value)}" for column, value in solve.key.items())
                if solve.status is not SolveStatus.SKIPPED:
                    wrong += [faults.left_out(key, each) for each in error.diagnostics]
        found.append(tuple(own))
    if first is not None and (len(result.solves) == 1 or not any(found)):
        raise first
    rest = len(wrong) - MOST_TOLD
    told = (*wrong[:MOST_TOLD], *([faults.more_left_out(rest)] if rest > 0 else []))
    return BudgetAnswer(result=result, solves=tuple(found), refused=told)
