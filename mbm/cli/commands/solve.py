"""``mbm solve``: the problem solved, its table on standard output, its document, CSV files and plot where asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click

from mbm.cli import faults
from mbm.cli.documents import refuse_standard_output
from mbm.cli.inputs import solve_options
from mbm.cli.interrupts import interruptible
from mbm.cli.options import NumberFrom, Terminal, allow_external_option, terminal, verbosity_options
from mbm.cli.output import say
from mbm.cli.outputs import Output, Scenes, answered, document_bytes, outputs_at
from mbm.cli.progress import ProgressBar
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from mbm.report.types import Result

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
@click.option("--starts", type=NumberFrom(1), metavar="N", help="Random start points, for the best minimum.")
@click.option("--seed", type=NumberFrom(0), metavar="N", help="Seed of all random numbers.")
@click.option("--method", metavar="M", help="auto, lm, dogleg, gauss-newton, …")
@click.option("--backend", type=click.Choice(BACKENDS), default="auto", help="Backend that evaluates the equations.")
@click.option("--workers", type=NumberFrom(1), metavar="N", help="Threads for many or large solves; else all cores.")
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
    files = {"csv_path": _solves, "estimates_path": _estimates, "residuals_path": _residuals}
    scenes = [Scenes(form=form, folder=Path(folder), force=given["force"]) for form, folder in given["written"]]
    return answered(
        given,
        [*outputs_at(given, files, _drawn, document_bytes), *_overlay(given["overlay_path"]), *scenes],
        lambda loaded: _solve(given, terminal(), loaded),
        lambda result, screen: _print_table(result, screen, intervals=given["intervals"]),
        doubts=lambda result: result.diagnostics,
        document=document_bytes,
    )


def _solves(result: Result) -> bytes:
    from mbm.report.exports import write_solves

    return _as_bytes(lambda stream: write_solves(result, stream))


def _estimates(result: Result) -> bytes:
    from mbm.report.exports import write_estimates

    return _as_bytes(lambda stream: write_estimates(result, stream))


def _residuals(result: Result) -> bytes:
    from mbm.report.exports import write_residuals

    return _as_bytes(lambda stream: write_residuals(result, stream))


def _as_bytes(write: Callable[[TextIO], None]) -> bytes:
    stream = StringIO(newline="")
    write(stream)
    return stream.getvalue().encode("utf-8", errors="backslashreplace")


def _drawn(result: Result) -> Any:
    from mbm.report.plots import draw

    return draw(result)


def _overlay(path: str | None) -> Iterator[Output]:
    """The images of a result in the format that the name of a file says."""
    if path is None:
        return
    from mbm.report.figures import format_of
    from mbm.report.view.wishes import overlay_bytes

    refuse_standard_output(path)
    ending = format_of(path)
    yield Output(path=path, content=lambda result: overlay_bytes(result, ending))


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
