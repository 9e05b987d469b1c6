"""``mbm report``: a problem solved, and all that is to be said of it on one page."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mbm.cli.documents import STANDARD_OUTPUT, refuse_standard_output
from mbm.cli.failure import print_diagnostics
from mbm.cli.inputs import solve_options
from mbm.cli.options import allow_external_option, problem_at, reads_so_far, terminal, verbosity_options
from mbm.cli.output import write_bytes
from mbm.cli.outputs import Output, check_outputs, document_bytes, write_outputs
from mbm.cli.statuses import ATTENTION, OK, WRONG

if TYPE_CHECKING:
    from mbm.report.types import Result

WORDS = (("problem", "--problem"), ("seed", "--seed"), ("init", "--init"), ("sandbox", "--sandbox"))


@click.command("report")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("-o", "--output", "out", metavar="OUT", required=True, help="The report to write (.html .pdf).")
@click.option("--problem", metavar="NAME", help="The problem of the file, where it holds several.")
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="A constant or initial value: h=70cm.")
@click.option("--data", multiple=True, metavar="NAME=PATH", help="The file of a table.")
@click.option("--init", metavar="VALUES.json", help="Initial values: name → value, or a result document.")
@click.option("--seed", type=int, metavar="N", help="Seed of all random numbers.")
@click.option("--json", "json_path", metavar="PATH|-", help="Write the result document, too.")
@click.option("--sandbox", metavar="DIR", help="Confine reads and `use` to a folder.")
@allow_external_option
@verbosity_options
def command(**given: Any) -> int:
    """Solve FILE, and write one page that somebody can read who has not seen mbm: problem, data, estimates with
    intervals, doubts, what the data cannot tell, budget, correlations, pictures of the residuals, provenance.

    The page is one file, which fetches nothing and runs no script.

    Exit status: as `mbm solve`.
    """
    from mbm.report.page.writing import report_bytes, report_format

    refuse_standard_output(given["out"])
    ending, screen = report_format(given["out"]), terminal()
    call = _call(given)
    outputs = [Output(path=given["out"], content=lambda result: report_bytes(result, ending, call))]
    if given["json_path"] not in (None, STANDARD_OUTPUT):
        outputs.append(Output(path=given["json_path"], content=document_bytes))
    check_outputs(outputs, problem_at(given["file"]))
    result = _solve(given, lambda: check_outputs(outputs, reads_so_far()))
    print_diagnostics(() if screen.quiet else result.diagnostics, color=screen.color_errors)
    wrong = write_outputs(outputs, result, reads_so_far())
    if given["json_path"] == STANDARD_OUTPUT:
        write_bytes(document_bytes(result))
    print_diagnostics(wrong, color=screen.color_errors)
    return WRONG if wrong else OK if result.status.value == "ok" else ATTENTION


def _call(given: dict[str, Any]) -> str:
    """The command line, as a shell takes it."""
    words = ["mbm", "report", str(given["file"]), "-o", given["out"]]
    for name, option in WORDS:
        if given[name] is not None:
            words += [option, str(given[name])]
    words += [word for setting in given["settings"] for word in ("--set", setting)]
    words += [word for path in given["data"] for word in ("--data", path)]
    return shlex.join(words)


def _solve(given: dict[str, Any], loaded: Callable[[], None]) -> Result:
    from mbm.api import solve_file

    options = replace(solve_options(given), loaded=loaded)
    return solve_file(given["file"], options)
