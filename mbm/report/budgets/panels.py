"""Budgets → panels: a bar for each input, its contribution beside the combined standard uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

from mbm.report.budgets.budget import budgets_of
from mbm.report.budgets.text import chosen, heading, share_text
from mbm.report.budgets.types import Budget, InputKind
from mbm.report.figures import show_plainly, titled
from mbm.report.types import Result
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_BARS = 20
"""Bars of a panel: those of the largest contributions."""

COLOURS = {
    InputKind.ROWS: "C0",
    InputKind.PRIOR: "C1",
    InputKind.CONSTANT: "C2",
    InputKind.TRANSITION: "C4",
}
_ROOM = 1.22


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


def budget_panels(result: Result) -> Iterator[Callable[[Axes], None]]:
    """The budgets of a single solve, of which there may be none."""
    if len(result.solves) != 1:
        return
    try:
        budgets = budgets_of(result.solves[0])
    except MbmError:
        return
    for budget in budgets:
        yield partial(bars, budget=budget)


def bars(axes: Axes, budget: Budget) -> None:
    """The bars of a budget, the largest first as in its table."""
    rows = chosen(budget.rows, MOST_BARS)
    labels = [*(row.label for row in rows), "combined"]
    widths = [*(row.contribution for row in rows), budget.sigma]
    colours = [*(COLOURS[row.kind] for row in rows), "0.35"]
    places = range(len(labels))
    axes.barh(list(places), widths, color=colours, height=0.7)
    for place, row in zip(places, rows, strict=False):
        axes.annotate(
            share_text(row.share), (row.contribution, place), xytext=(4, 0), textcoords="offset points", va="center",
            fontsize=8,
        )  # fmt: skip
    axes.set_yticks(list(places), labels, fontsize=8)
    axes.invert_yaxis()
    axes.set_xlim(0.0, _ROOM * max(widths) if max(widths) > 0.0 else 1.0)
    axes.set_xlabel(f"contribution{'' if budget.unit is None else f' ({budget.unit})'}")
    left_out = len(budget.rows) - len(rows)
    axes.set_title(heading(budget) + (f" ({left_out} more inputs)" if left_out else ""), fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)
