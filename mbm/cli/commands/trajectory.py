"""``mbm trajectory``: the errors of an aligned trajectory, as a table, a document, rows and a plot."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mbm.cli.inputs import solve_options
from mbm.cli.options import NumberFrom, Terminal, allow_external_option, verbosity_options
from mbm.cli.output import say
from mbm.cli.outputs import answered, outputs_at

if TYPE_CHECKING:
    from mbm.report.trajectories.answer import TrajectoryAnswer
    from mbm.text.types import Diagnostic


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
@click.option("--seed", type=NumberFrom(0), metavar="N", help="Seed of all random numbers.")
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
    outputs = outputs_at(given, {"csv_path": _rows}, _drawn)
    return answered(given, outputs, lambda loaded: _answer(given, loaded), _say, doubts=_doubts)


def _say(answer: TrajectoryAnswer, screen: Terminal) -> None:
    from mbm.report.table import table
    from mbm.report.trajectories.types import text

    if answer.status.value != "ok":
        say(table(answer.result, width=screen.width, color=screen.color), color=screen.color)
    say(text(answer.trajectories, full=screen.verbose), end="")


def _doubts(answer: TrajectoryAnswer) -> Iterator[Diagnostic]:
    """What is said of the alignment; what is said of each solve is in the table, where that is shown."""
    yield from answer.result.diagnostics
    if answer.status.value == "ok":
        yield from (each for solve in answer.result.solves for each in solve.diagnostics)


def _rows(answer: TrajectoryAnswer) -> bytes:
    from mbm.report.trajectories.answer import error_rows

    return error_rows(answer.trajectories).encode("utf-8", errors="backslashreplace")


def _drawn(answer: TrajectoryAnswer) -> Any:
    from mbm.report.trajectories.plots import draw

    return draw(answer)


def _answer(given: dict[str, Any], loaded: Callable[[], None]) -> TrajectoryAnswer:
    from mbm.api import trajectory_file

    options = replace(solve_options(given), loaded=loaded)
    return trajectory_file(given["file"], options, given["deltas"], given["observation"])
