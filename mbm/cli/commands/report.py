"""``mbm report``: a problem solved, and all that is to be said of it on one page."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mbm.cli.documents import refuse_standard_output
from mbm.cli.inputs import solve_options
from mbm.cli.options import NumberFrom, allow_external_option, verbosity_options
from mbm.cli.outputs import Output, answered, document_bytes, outputs_at

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
@click.option("--seed", type=NumberFrom(0), metavar="N", help="Seed of all random numbers.")
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
    ending, call = report_format(given["out"]), _call(given)
    page = Output(path=given["out"], content=lambda result: report_bytes(result, ending, call))
    return answered(
        given,
        [page, *outputs_at(given, {}, document=document_bytes)],
        lambda loaded: _solve(given, loaded),
        lambda *_: None,
        doubts=lambda result: result.diagnostics,
        document=document_bytes,
    )


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
