"""``mbm solve``: the problem solved, its table on standard output, its document, CSV files and plot where asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mbm.cli import faults
from mbm.cli.documents import STANDARD_OUTPUT, refuse_standard_output
from mbm.cli.failure import print_diagnostics
from mbm.cli.inputs import solve_options
from mbm.cli.interrupts import interruptible
from mbm.cli.options import Terminal, allow_external_option, problem_at, reads_so_far, terminal, verbosity_options
from mbm.cli.output import say, write_bytes
from mbm.cli.outputs import check_outputs, document_bytes, outputs_of, write_outputs
from mbm.cli.progress import ProgressBar
from mbm.cli.statuses import ATTENTION, OK, WRONG
from mbm.files.journal import Read
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.report.types import Result


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenes:
    """A folder that is asked for, and the format of its files."""

    form: str
    folder: Path
    force: bool


def scenes_of(given: Mapping[str, Any]) -> tuple[Scenes, ...]:
    """What the options of ``mbm solve`` ask for."""
    return tuple(Scenes(form=form, folder=Path(folder), force=given["force"]) for form, folder in given["written"])


def check_scenes(scenes: Sequence[Scenes], reads: tuple[Read, ...]) -> None:
    """What speaks against writing, as far as can be said before there is anything to write.

    Raises:
        MbmError: unknown-output, foreign-folder, not-writable, would-overwrite: two go to one folder.

    """
    if not scenes:
        return
    from mbm.files.folders import check_folder, refuse_one_folder
    from mbm.files.manifest import WRITE
    from mbm.report.scenes.formats import check_format

    for each in scenes:
        check_format(each.form)
        refuse_standard_output(each.folder)
        check_folder(each.folder, WRITE, force=each.force, reads=reads)
    refuse_one_folder([each.folder for each in scenes])


def write_scenes(scenes: Sequence[Scenes], result: Result, reads: tuple[Read, ...]) -> tuple[Diagnostic, ...]:
    """Write all files that can be; what went wrong with the others."""
    if not scenes:
        return ()
    from mbm.report.scenes.formats import write

    wrong: list[Diagnostic] = []
    for each in scenes:
        try:
            write(result, each.form, each.folder, force=each.force, reads=reads)
        except MbmError as error:
            wrong.extend(error.diagnostics)
    return tuple(wrong)


NOT_YET = ("scheduler",)
BACKENDS = ("auto", "native", "casadi", "numpy")


@click.command("solve")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--problem", metavar="NAME", help="The problem of the file to solve, where it holds several.")
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="A constant or initial value: h=70cm.")
@click.option("--data", multiple=True, metavar="NAME=PATH", help="The file of a table.")
@click.option("--json", "json_path", metavar="PATH|-", help="Write the result document.")
@click.option("--csv", "csv_path", metavar="PATH", help="Write the estimates, one row per solve.")
@click.option("--estimates", "estimates_path", metavar="PATH", help="Write the estimates, one row each, as CSV.")
@click.option("--intervals", is_flag=True, help="Show intervals, coverage factors and degrees of freedom.")
@click.option("--residuals", "residuals_path", metavar="PATH", help="Write the residuals, one row each, as CSV.")
@click.option("--plot", "plot_path", metavar="PATH", help="Draw residuals, ellipses, data and model (.png .svg .pdf).")
@click.option("--overlay", "overlay_path", metavar="PATH", help="Draw the images: measured and predicted features.")
@click.option("--init", metavar="VALUES.json", help="Initial values: name → value, or a result document.")
@click.option("--starts", type=click.IntRange(min=1), metavar="N", help="Random start points, for the best minimum.")
@click.option("--seed", type=int, metavar="N", help="Seed of all random numbers.")
@click.option("--method", metavar="M", help="auto, lm, dogleg, gauss-newton, …")
@click.option("--backend", type=click.Choice(BACKENDS), default="auto", help="Backend that evaluates the equations.")
@click.option(
    "--workers", type=click.IntRange(min=1), metavar="N", help="Threads for many or large solves; else all cores."
)
@click.option(
    "--write",
    "written",
    nargs=2,
    multiple=True,
    metavar="FORMAT DIR",
    help="Write estimates for other programs (may be repeated): colmap, bundler, opencv-yaml, ply, g2o, tum, kitti.",
)
@click.option("--force", is_flag=True, help="--write into a folder that it did not write before and that holds files.")
@click.option("--sandbox", metavar="DIR", help="Confine reads and `use` to a folder.")
@allow_external_option
@click.option("--covariance", type=click.Choice(("full",)), help="Write covariance matrices of any size.")
@click.option("--scheduler", metavar="ADDRESS", hidden=True)
@verbosity_options
def command(**given: Any) -> int:
    """Solve FILE and print the estimates with their standard deviations, the fit, and what cannot be determined.

    Exit status: 0 converged, observable and within its constraints; 1 an answer that should not be trusted as it
    stands; 2 nothing was solved, or a file that was asked for could not be written.
    """
    for name in NOT_YET:
        if given[name]:
            raise MbmError(faults.not_available_yet(f"--{name.replace('_', '-')}"))
    screen = terminal()
    outputs = outputs_of(given)
    scenes = scenes_of(given)

    def check(reads: tuple[Read, ...]) -> None:
        check_outputs(outputs, reads)
        check_scenes(scenes, reads)

    check(problem_at(given["file"]))
    result = _solve(given, screen, lambda: check(reads_so_far()))
    print_diagnostics(() if screen.quiet else result.diagnostics, color=screen.color_errors)
    wrong = [*write_outputs(outputs, result, reads_so_far()), *write_scenes(scenes, result, reads_so_far())]
    try:
        if given["json_path"] == STANDARD_OUTPUT:
            write_bytes(document_bytes(result))
        else:
            _print_table(result, screen, intervals=given["intervals"])
    except MbmError as error:  # the files are there, and stay
        wrong.extend(error.diagnostics)
    print_diagnostics(wrong, color=screen.color_errors)
    return WRONG if wrong else OK if result.status.value == "ok" else ATTENTION


def _solve(given: dict[str, Any], screen: Terminal, loaded: Callable[[], None]) -> Result:
    """Solve; ``loaded`` is called once everything was read, before the work begins."""
    from mbm.api import solve_file
    from mbm.equations.interruption import Interruption
    from mbm.report.options import Backend

    interruption = Interruption()
    with ProgressBar(shown=screen.shows_progress) as progress, interruptible(interruption):
        options = replace(
            solve_options(given),
            starts=given["starts"],
            method=given["method"],
            backend=Backend(given["backend"]),
            workers=given["workers"],
            covariance_full=given["covariance"] == "full",
            progress=progress.advance,
            interruption=interruption,
            loaded=loaded,
        )
        return solve_file(given["file"], options)


def _print_table(result: Result, screen: Terminal, *, intervals: bool) -> None:
    from mbm.report.table import headline, table

    if screen.quiet:
        text = headline(result, color=screen.color)
    else:
        text = table(result, width=screen.width, color=screen.color, full=screen.verbose, intervals=intervals)
    say(text, color=screen.color, end="")
