"""Budgets as a table that a person reads, and as a table of LaTeX. Budgets → panels: a bar for each input, its
contribution beside the combined standard uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from math import isinf
from typing import TYPE_CHECKING

from mbm.problem.naming import key_text
from mbm.report.budgets.budget import budgets_of
from mbm.report.budgets.types import Budget, BudgetRow, InputKind
from mbm.report.columns import Pad, aligned, laid_out, left, right
from mbm.report.digits import measured, plain
from mbm.report.figures import show_plainly, titled
from mbm.report.intervals import MOST_LINES
from mbm.report.types import Result
from mbm.text.shown import Paint, Style, cut, joined
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HEADER = ("input", "kind", "n", "value", "u", "unit", "c", "|c|u", "share", "dof")
MOST_BUDGETS = 12
"""Budgets that are shown unless all are asked for."""

DIGITS = 3
_ESCAPED = {
    "\\": r"\textbackslash{}",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    **{sign: f"\\{sign}" for sign in "#$%&_{}"},
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
}


def text(budgets: Sequence[Budget], *, color: bool = False, full: bool = False) -> str:
    """The tables, with a line break at the end; ``full`` shows every line of every budget."""
    paint = Paint(color)
    lines: list[str] = []
    for budget in budgets if full else budgets[:MOST_BUDGETS]:
        lines += [*_lines(budget, paint, full), ""]
    left_out = 0 if full else len(budgets) - MOST_BUDGETS
    if left_out > 0:
        lines.append(paint(f"… and {left_out} more budgets (-v shows all; --for NAME one)", Style.QUIET))
    return joined((line.rstrip() for line in lines), color=color) + "\n"


def _lines(budget: Budget, paint: Paint, full: bool) -> Iterator[str]:
    yield f"budget of {paint(heading(budget), Style.HEADING)}"
    yield f"  {summary(budget)}"
    yield ""
    shown = chosen(budget.rows, len(budget.rows) if full else MOST_LINES)
    how: tuple[Pad, ...] = (left, left, right, _aligned, _aligned, left, _aligned, _aligned, right, right)
    for number, line in enumerate(laid_out([HEADER, *map(cells, shown)], how)):
        row = "  " + "  ".join(line)
        yield paint(row.rstrip(), Style.QUIET) if number == 0 else row
    if len(shown) < len(budget.rows):
        rest = 1.0 - sum(row.share for row in shown)
        count = len(budget.rows) - len(shown)
        yield paint(f"  … and {count} more with {share_text(max(rest, 0.0))} together (-v shows all)", Style.QUIET)
    if abs(budget.inflation - 1.0) > 1e-9:
        yield f"  k holds a factor of {budget.inflation:.3g}, as weights are estimates"


def _aligned(column: Sequence[str]) -> list[str]:
    """The numbers of a column by their points, under a heading that stands to the right."""
    return right([column[0], *aligned(column[1:])])


def heading(budget: Budget) -> str:
    """``height = 0.740 ± 0.002 m``, with the key of its solve before."""
    key = "".join(f"{name} = {key_text(value)}, " for name, value in budget.key.items())
    number = measured(budget.value, budget.sigma)
    unit = "" if budget.unit is None else f" {budget.unit}"
    return f"{key}{budget.quantity} = {number}{unit}"


def summary(budget: Budget) -> str:
    """The standard and the expanded uncertainty, and how well they are known."""
    unit = "" if budget.unit is None else f" {budget.unit}"
    level = plain(100 * budget.coverage, 6)
    expanded = f"U = {plain(budget.U, DIGITS)}{unit} at {level} % with k = {budget.k:.2f}"
    return f"u = {plain(budget.sigma, DIGITS)}{unit}, dof = {dof_text(budget.dof)}; {expanded}"


def chosen(rows: Sequence[BudgetRow], most: int) -> list[BudgetRow]:
    """The rows that contribute most, in their order."""
    if len(rows) <= most:
        return list(rows)
    largest = sorted(range(len(rows)), key=lambda i: -rows[i].contribution)[:most]
    return [rows[i] for i in sorted(largest)]


def cells(row: BudgetRow) -> tuple[str, ...]:
    """The cells below ``HEADER``."""
    value = "" if row.value is None else measured(row.value, row.u).value if row.u else plain(row.value, 6)
    if value.startswith("("):
        value = plain(row.value or 0.0, 6)
    return (
        row.label,
        row.kind.value,
        str(row.count),
        value or "–",
        _number(row.u),
        row.unit or "",
        _number(row.sensitivity),
        _number(row.contribution),
        share_text(row.share),
        dof_text(row.dof),
    )


def _number(value: float | None) -> str:
    return "–" if value is None else plain(value, DIGITS)


def share_text(share: float) -> str:
    """A share of the variance in per cent."""
    return f"{100.0 * share:.1f} %"


def dof_text(dof: float) -> str:
    """Degrees of freedom, with one decimal where they are not whole."""
    return "∞" if isinf(dof) or dof > 1e6 else f"{dof:.1f}".removesuffix(".0")


def latex(budgets: Sequence[Budget]) -> str:
    """A ``tabular`` for each budget; needs no package."""
    return "\n".join(_tabular(budget) for budget in budgets)


def _tabular(budget: Budget) -> str:
    titles = ("Input", "Kind", "$n$", "Value", "$u$", "Unit", "$c$", "$|c|\\,u$", "Share", "$\\nu$")
    lines = [f"% {cut(heading(budget), 200)}", r"\begin{tabular}{llrrrlrrrr}", r"\hline"]
    lines += [f"{' & '.join(titles)} \\\\", r"\hline"]
    lines += [f"{' & '.join(_latex_cells(row))} \\\\" for row in budget.rows]
    total = [latex_text(budget.quantity), "", "", latex_number(budget.value), latex_number(budget.sigma)]
    total += [latex_text(budget.unit or ""), "", latex_number(budget.sigma), r"100.0 \%", _latex_dof(budget.dof)]
    return "\n".join([*lines, r"\hline", f"{' & '.join(total)} \\\\", r"\hline", r"\end{tabular}", ""])


def _latex_cells(row: BudgetRow) -> list[str]:
    cells = [latex_text(row.label), row.kind.value, str(row.count), latex_number(row.value), latex_number(row.u)]
    cells += [latex_text(row.unit or ""), latex_number(row.sensitivity), latex_number(row.contribution)]
    return [*cells, share_text(row.share).replace("%", r"\%"), _latex_dof(row.dof)]


def _latex_dof(dof: float) -> str:
    found = dof_text(dof)
    return r"$\infty$" if found == "∞" else found


def latex_number(value: float | None) -> str:
    r"""A number as LaTeX sets it: ``$1.2\times10^{-7}$``, a dash where there is none."""
    if value is None:
        return "--"
    mantissa, _, power = plain(value, 6).partition("e")
    return f"${mantissa}$" if not power else f"${mantissa}\\times10^{{{int(power)}}}$"


def latex_text(text_of_file: str) -> str:
    """A text of a problem as LaTeX prints it, no command in it."""
    return "".join(_ESCAPED.get(sign, sign) for sign in cut(text_of_file, 200))


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
