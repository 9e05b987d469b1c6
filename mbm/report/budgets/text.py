"""Budgets as a table that a person reads, and as a table of LaTeX."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isinf

from mbm.problem.naming import key_text
from mbm.report.budgets.types import Budget, BudgetRow
from mbm.report.columns import Pad, aligned, laid_out, left, right
from mbm.report.digits import measured, plain
from mbm.report.intervals import MOST_LINES
from mbm.text.shown import Paint, Style, cut, joined

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
    if budget.inflation > 1.0 + 1e-9:
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
