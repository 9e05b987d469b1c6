"""``mbm budget``: the uncertainty of estimates and derived quantities, input by input."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mbm.cli.documents import STANDARD_OUTPUT
from mbm.cli.failure import print_diagnostics
from mbm.cli.inputs import solve_options
from mbm.cli.options import allow_external_option, problem_at, reads_so_far, terminal, verbosity_options
from mbm.cli.output import say, write_bytes
from mbm.cli.outputs import Output, check_outputs, write_outputs
from mbm.cli.statuses import ATTENTION, OK, WRONG
from mbm.text.types import MbmError

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
@click.option("--seed", type=int, metavar="N", help="Seed of all random numbers.")
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
    screen = terminal()
    made: list[BudgetAnswer] = []
    outputs = _outputs(given, made)
    check_outputs(outputs, problem_at(given["file"]))
    answer = _answer(given, lambda: check_outputs(outputs, reads_so_far()))
    made.append(answer)
    told = () if screen.quiet else (*answer.result.diagnostics, *answer.refused)
    print_diagnostics(told, color=screen.color_errors)
    wrong = [*write_outputs(outputs, answer.result, reads_so_far())]
    try:
        if given["json_path"] == STANDARD_OUTPUT:
            write_bytes(_document(answer))
        else:
            from mbm.report.budgets.text import text

            say(text(answer.budgets, color=screen.color, full=screen.verbose), end="")
    except MbmError as error:  # the files are there, and stay
        wrong.extend(error.diagnostics)
    print_diagnostics(wrong, color=screen.color_errors)
    return WRONG if wrong else OK if answer.status.value == "ok" else ATTENTION


def _outputs(given: dict[str, Any], made: list[BudgetAnswer]) -> tuple[Output, ...]:
    """The files that are asked for; what they hold is ``made`` when they are written."""
    found = []
    if given["json_path"] not in (None, STANDARD_OUTPUT):
        found.append(Output(path=given["json_path"], content=lambda _: _document(made[0])))
    if given["csv_path"] is not None:
        found.append(Output(path=given["csv_path"], content=lambda _: _rows(made[0])))
    if given["latex_path"] is not None:
        found.append(Output(path=given["latex_path"], content=lambda _: _latex(made[0])))
    if given["plot_path"] is not None:
        from mbm.report.plots import format_of

        ending = format_of(given["plot_path"])
        found.append(Output(path=given["plot_path"], content=lambda _: _picture(made[0], ending)))
    return tuple(found)


def _document(answer: BudgetAnswer) -> bytes:
    from mbm.report.encode import encode, to_bytes

    return to_bytes(encode(answer.document()))


def _rows(answer: BudgetAnswer) -> bytes:
    from mbm.report.budgets.answer import budget_rows

    return budget_rows(answer.budgets).encode("utf-8", errors="backslashreplace")


def _latex(answer: BudgetAnswer) -> bytes:
    from mbm.report.budgets.text import latex

    return latex(answer.budgets).encode("utf-8", errors="backslashreplace")


def _picture(answer: BudgetAnswer, ending: str) -> bytes:
    from mbm.report.budgets.plots import draw
    from mbm.report.plots import figure_bytes

    return figure_bytes(draw(answer.budgets, answer.result.problem), ending)


def _answer(given: dict[str, Any], loaded: Callable[[], None]) -> BudgetAnswer:
    from mbm.api import budget_file

    options = replace(solve_options(given), loaded=loaded)
    return budget_file(given["file"], options, given["names"], by_row=given["by_row"])
