"""What ``mbm budget`` does: a problem is solved, then the uncertainty of its quantities is told input by input."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mbm.api.files import solve_file

if TYPE_CHECKING:
    from mbm.report.budgets.answer import BudgetAnswer
    from mbm.report.options import SolveOptions


def budget_file(
    path: str | Path, options: SolveOptions, names: Sequence[str] = (), *, by_row: bool = False
) -> BudgetAnswer:
    """The budgets of the quantities ``names`` of a problem file, or of all; ``by_row`` as `budgets_of` has it.

    Raises:
        MbmError: the problem, the data or the call is wrong; unknown-quantity, no-budget.

    """
    from mbm.report.budgets.answer import answer_of

    return answer_of(solve_file(path, options), names, by_row=by_row)
