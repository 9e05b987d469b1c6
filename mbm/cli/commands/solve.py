"""``mbm solve``: the problem solved, its table on standard output, its document, CSV files and plot where asked for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click

from mbm.cli import faults
from mbm.cli.failure import print_diagnostics, write_bytes
from mbm.cli.inputs import json_object, named_paths, named_texts
from mbm.cli.interrupts import interruptible
from mbm.cli.main import ATTENTION, OK
from mbm.cli.options import Terminal, terminal, verbosity_options
from mbm.cli.progress import ProgressBar
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from mbm.report.types import Result

NOT_YET = ("overlay", "scheduler", "allow_external")
BACKENDS = ("auto", "native", "casadi", "numpy")


@click.command("solve")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--problem", metavar="NAME", help="The problem of the file to solve, where it holds several.")
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="A constant or initial value: h=70cm.")
@click.option("--data", multiple=True, metavar="NAME=PATH", help="The file of a table.")
@click.option("--json", "json_path", metavar="PATH|-", help="Write the result document.")
@click.option("--csv", "csv_path", metavar="PATH", help="Write the estimates, one row per solve.")
@click.option("--residuals", "residuals_path", metavar="PATH", help="Write the residuals, one row each, as CSV.")
@click.option("--plot", "plot_path", metavar="PATH", help="Draw residuals, ellipses, data and model (.png .svg .pdf).")
@click.option("--init", metavar="VALUES.json", help="Initial values: name → value, or a result document.")
@click.option("--starts", type=click.IntRange(min=1), metavar="N", help="Random starts; the best minimum is reported.")
@click.option("--seed", type=int, metavar="N", help="Every random choice follows from it.")
@click.option("--method", metavar="M", help="auto, lm, dogleg, gauss-newton, …")
@click.option("--backend", type=click.Choice(BACKENDS), default="auto", help="What evaluates the equations.")
@click.option(
    "--workers", type=click.IntRange(min=1), metavar="N", help="Threads for many or large solves; else all cores."
)
@click.option("--sandbox", metavar="DIR", help="Confine reads and `use` to a folder.")
@click.option("--covariance", type=click.Choice(("full",)), help="Write covariance matrices however large.")
@click.option("--overlay", metavar="PATH", hidden=True)
@click.option("--scheduler", metavar="ADDRESS", hidden=True)
@click.option("--allow-external", is_flag=True, hidden=True)
@verbosity_options
def command(**given: Any) -> int:
    """Solve FILE and print the estimates with their standard deviations, the fit, and what cannot be determined.

    Exit status: 0 converged, observable and within its constraints; 1 an answer that should not be trusted as it
    stands; 2 nothing was solved.
    """
    for name in NOT_YET:
        if given[name]:
            raise MbmError(faults.not_available_yet(f"--{name.replace('_', '-')}"))
    screen = terminal()
    _check_destinations(given)
    result = _solve(given, screen)
    print_diagnostics(() if screen.quiet else result.diagnostics, color=screen.color_errors)
    _write_outputs(result, given)
    if given["json_path"] != "-":
        _print_table(result, screen)
    return OK if result.status.value == "ok" else ATTENTION


def _solve(given: dict[str, Any], screen: Terminal) -> Result:
    from mbm.api import solve_file
    from mbm.report.options import Backend, SolveOptions
    from mbm.solution.interruption import Interruption

    interruption = Interruption()
    with ProgressBar(shown=screen.shows_progress) as progress, interruptible(interruption):
        options = SolveOptions(
            problem=given["problem"],
            set=named_texts("--set", given["settings"]),
            data=named_paths("--data", given["data"]),
            init=None if given["init"] is None else json_object(Path(given["init"])),
            starts=given["starts"],
            seed=given["seed"],
            method=given["method"],
            backend=Backend(given["backend"]),
            workers=given["workers"],
            sandbox=None if given["sandbox"] is None else Path(given["sandbox"]),
            covariance_full=given["covariance"] == "full",
            progress=progress.advance,
            interruption=interruption,
        )
        return solve_file(given["file"], options)


def _check_destinations(given: dict[str, Any]) -> None:
    """Folders that do not exist are found before the work is done."""
    for name in ("json_path", "csv_path", "residuals_path", "plot_path"):
        path = given[name]
        if path is None or (path == "-" and name == "json_path"):
            continue
        if not Path(path).parent.is_dir():
            raise MbmError(faults.not_writable(path, "its folder does not exist"))
        if Path(path).is_dir():
            raise MbmError(faults.not_writable(path, "it is a folder"))


def _write_outputs(result: Result, given: dict[str, Any]) -> None:
    if given["json_path"] is not None:
        _write_document(result, given["json_path"])
    if given["csv_path"] is not None:
        from mbm.report.exports import write_solves

        _writing(given["csv_path"], lambda: _write_text(given["csv_path"], lambda out: write_solves(result, out)))
    if given["residuals_path"] is not None:
        from mbm.report.exports import write_residuals

        path = given["residuals_path"]
        _writing(path, lambda: _write_text(path, lambda out: write_residuals(result, out)))
    if given["plot_path"] is not None:
        from mbm.report.plots import save

        _writing(given["plot_path"], lambda: save(result, Path(given["plot_path"])))


def _write_document(result: Result, path: str) -> None:
    from mbm.report.document import lazy_document
    from mbm.report.encode import encode, to_bytes

    content = to_bytes(encode(lazy_document(result)))
    if path == "-":
        write_bytes(content)
    else:
        _writing(path, lambda: Path(path).write_bytes(content))


def _write_text(path: str, write: Callable[[TextIO], None]) -> None:
    with Path(path).open("w", encoding="utf-8", errors="backslashreplace", newline="") as stream:
        write(stream)


def _writing(path: str, write: Callable[[], object]) -> None:
    """Runs ``write``; what the system objects to becomes a diagnostic."""
    try:
        write()
    except OSError as error:
        raise MbmError(faults.not_writable(path, error.strerror or str(error))) from error


def _print_table(result: Result, screen: Terminal) -> None:
    from mbm.report.table import table

    text = table(result, width=screen.width, color=screen.color, full=screen.verbose)
    click.echo(text, nl=False, color=screen.color)
