"""``mbm trajectory``: the errors of an aligned trajectory, as a table, a document, rows and a plot."""

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
    from mbm.report.trajectories.answer import TrajectoryAnswer


@click.command("trajectory")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--problem", metavar="NAME", help="The problem of the file, where it holds several.")
@click.option("--observation", metavar="NAME", help="The observation of the trajectory, where there are several.")
@click.option(
    "--delta",
    "deltas",
    multiple=True,
    metavar="STEP",
    help="A step of relative errors: 10f rows, 0.5s, 2m of the path (may be repeated).",
)
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="A constant or initial value: h=70cm.")
@click.option("--data", multiple=True, metavar="NAME=PATH", help="The file of a table.")
@click.option("--init", metavar="VALUES.json", help="Initial values: name → value, or a result document.")
@click.option("--seed", type=int, metavar="N", help="Seed of all random numbers.")
@click.option("--json", "json_path", metavar="PATH|-", help="Write the result document, with the errors.")
@click.option("--csv", "csv_path", metavar="PATH", help="Write the errors, one row for each pose.")
@click.option("--plot", "plot_path", metavar="PATH", help="Draw the paths and their errors (.png .svg .pdf).")
@click.option("--sandbox", metavar="DIR", help="Confine reads and `use` to a folder.")
@allow_external_option
@verbosity_options
def command(**given: Any) -> int:
    """Solve the alignment that FILE states, and print the errors of the trajectory: of each pose (APE), and over steps
    (RPE).

    The observation `(= [ref.x ref.y ref.z] (transform S [est.x est.y est.z]))` says what is the reference, and what is
    laid on it. Steps are those of a `pair` of its table with itself, else those of `--delta`, else from row to row.

    Exit status: as `mbm solve`.
    """
    screen = terminal()
    made: list[TrajectoryAnswer] = []
    outputs = _outputs(given, made)
    check_outputs(outputs, problem_at(given["file"]))
    answer = _answer(given, lambda: check_outputs(outputs, reads_so_far()))
    made.append(answer)
    print_diagnostics(() if screen.quiet else answer.result.diagnostics, color=screen.color_errors)
    wrong = [*write_outputs(outputs, answer.result, reads_so_far())]
    try:
        if given["json_path"] == STANDARD_OUTPUT:
            write_bytes(_document(answer))
        else:
            from mbm.report.trajectories.table import text

            say(text(answer.trajectories, full=screen.verbose), end="")
    except MbmError as error:  # the files are there, and stay
        wrong.extend(error.diagnostics)
    print_diagnostics(wrong, color=screen.color_errors)
    return WRONG if wrong else OK if answer.status.value == "ok" else ATTENTION


def _outputs(given: dict[str, Any], made: list[TrajectoryAnswer]) -> tuple[Output, ...]:
    """The files that are asked for; what they hold is ``made`` when they are written."""
    found = []
    if given["json_path"] not in (None, STANDARD_OUTPUT):
        found.append(Output(path=given["json_path"], content=lambda _: _document(made[0])))
    if given["csv_path"] is not None:
        found.append(Output(path=given["csv_path"], content=lambda _: _rows(made[0])))
    if given["plot_path"] is not None:
        from mbm.report.plots import format_of

        ending = format_of(given["plot_path"])
        found.append(Output(path=given["plot_path"], content=lambda _: _picture(made[0], ending)))
    return tuple(found)


def _document(answer: TrajectoryAnswer) -> bytes:
    from mbm.report.encode import encode, to_bytes

    return to_bytes(encode(answer.document()))


def _rows(answer: TrajectoryAnswer) -> bytes:
    from mbm.report.trajectories.answer import error_rows

    return error_rows(answer.trajectories).encode("utf-8", errors="backslashreplace")


def _picture(answer: TrajectoryAnswer, ending: str) -> bytes:
    from mbm.report.plots import figure_bytes
    from mbm.report.trajectories.plots import draw

    return figure_bytes(draw(answer), ending)


def _answer(given: dict[str, Any], loaded: Callable[[], None]) -> TrajectoryAnswer:
    from mbm.api import trajectory_file

    options = replace(solve_options(given), loaded=loaded)
    return trajectory_file(given["file"], options, given["deltas"], given["observation"])
