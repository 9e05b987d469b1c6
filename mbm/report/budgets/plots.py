"""Budgets → a picture: a bar for each input, its contribution beside the combined standard uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from mbm.report.budgets.panels import COLOURS, MOST_BARS, bars
from mbm.report.budgets.types import Budget, InputKind
from mbm.report.figures import show_plainly, titled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_SHOWN = 6
"""Budgets of one picture."""

_WIDTH, _BAR, _MARGIN = 6.4, 0.3, 1.1


def draw(budgets: Sequence[Budget], title: str) -> Figure:
    """The picture as a Matplotlib figure of its own (no global state).

    Raises MbmError (missing-extra) if Matplotlib is not installed.
    """
    shown = budgets[:MOST_SHOWN]
    heights = [_MARGIN + _BAR * (min(len(budget.rows), MOST_BARS) + 1) for budget in shown]
    figure = titled(title, _WIDTH, sum(heights) + 0.5)
    grid = figure.add_gridspec(len(shown), 1, height_ratios=heights)
    for number, budget in enumerate(shown):
        bars(figure.add_subplot(grid[number, 0]), budget)
    kinds = [kind for kind in InputKind if any(row.kind is kind for budget in shown for row in budget.rows)]
    if len(kinds) > 1:
        from matplotlib.patches import Patch

        handles = [Patch(color=COLOURS[kind], label=kind.value) for kind in kinds]
        figure.legend(handles=handles, loc="outside lower center", ncols=len(kinds), fontsize=8, frameon=False)
    show_plainly(figure)
    return figure
