"""``mbm budget``: the uncertainty of estimates and derived quantities, input by input."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mbm.cli.inputs import solve_options
from mbm.cli.options import NumberFrom, Terminal, allow_external_option, verbosity_options
from mbm.cli.output import say
from mbm.cli.outputs import answered, outputs_at

if TYPE_CHECKING:
    from mbm.report.budgets.answer import BudgetAnswer


@click.command("budget")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--problem", metavar="NAME", help="The problem of the file, where it holds several.")
@click.option(
    "--for",
    "names",
    multiple=True,
    metavar="QUANTITY",
    help="An estimate or derived quantity, a member or a number of it: h, p[1] (may be repeated; else all).",
)
@click.option("--rows", "by_row", is_flag=True, help="Every row of every table by itself.")
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="A constant or initial value: h=70cm.")
@click.option("--data", multiple=True, metavar="NAME=PATH", help="The file of a table.")
@click.option("--init", metavar="VALUES.json", help="Initial values: name → value, or a result document.")
@click.option("--seed", type=NumberFrom(0), metavar="N", help="Seed of all random numbers.")
@click.option("--json", "json_path", metavar="PATH|-", help="Write the result document, with the budgets.")
@click.option("--csv", "csv_path", metavar="PATH", help="Write the budgets, one row for each input.")
@click.option("--latex", "latex_path", metavar="PATH", help="Write the budgets as tables of LaTeX.")
@click.option("--plot", "plot_path", metavar="PATH", help="Draw the contributions as bars (.png .svg .pdf).")
@click.option("--sandbox", metavar="DIR", help="Confine reads and `use` to a folder.")
@allow_external_option
@verbosity_options
def command(**given: Any) -> int:
    """Solve FILE, and print the uncertainty budget of its estimates and derived quantities: for each clause, column
    with errors, prior and uncertain constant its standard uncertainty u, the sensitivity c to it, the contribution
    |c|u, and the share of the variance.

    The squares of the contributions add up to the variance that `mbm solve` states.

    Exit status: as `mbm solve`.
    """
    outputs = outputs_at(given, {"csv_path": _rows, "latex_path": _latex}, _drawn)
    return answered(
        given,
        outputs,
        lambda loaded: _answer(given, loaded),
        _say,
        doubts=lambda answer: (*answer.result.diagnostics, *answer.refused),
    )


def _say(answer: BudgetAnswer, screen: Terminal) -> None:
    from mbm.report.budgets.text import text

    say(text(answer.budgets, color=screen.color, full=screen.verbose), end="")


def _rows(answer: BudgetAnswer) -> bytes:
    from mbm.report.budgets.answer import budget_rows

    return budget_rows(answer.budgets).encode("utf-8", errors="backslashreplace")


def _latex(answer: BudgetAnswer) -> bytes:
    from mbm.report.budgets.text import latex

    return latex(answer.budgets).encode("utf-8", errors="backslashreplace")


def _drawn(answer: BudgetAnswer) -> Any:
    from mbm.report.budgets.text import draw

    return draw(answer.budgets, answer.result.problem)


def _answer(given: dict[str, Any], loaded: Callable[[], None]) -> BudgetAnswer:
    from mbm.api import budget_file

    options = replace(solve_options(given), loaded=loaded)
    return budget_file(given["file"], options, given["names"], by_row=given["by_row"])
