"""``mbm simulate``: what the model predicts at known values, with noise, as a folder that can be solved."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mbm.cli import faults
from mbm.cli.documents import refuse_standard_output
from mbm.cli.failure import print_diagnostics
from mbm.cli.inputs import json_object, named_paths, named_texts
from mbm.cli.options import NumberFrom, allow_external_option, problem_at, reads_so_far, terminal, verbosity_options
from mbm.cli.output import say
from mbm.files.folders import check_folder, write_folder
from mbm.files.journal import note, option_role
from mbm.files.names import SIMULATE
from mbm.text.shown import one_line
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from mbm.report.simulated import Simulated
    from mbm.report.simulated_files import OutputFile


@click.command("simulate")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--at", metavar="VALUES.json", help="The true values: name → value, or a result document.")
@click.option("--seed", type=NumberFrom(0), default=1, metavar="N", help="Seed of all random numbers.")
@click.option("-o", "--output", "folder", metavar="DIR", required=True, help="The folder to write.")
@click.option("--problem", metavar="NAME", help="The problem of the file, where it holds several.")
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="A constant or initial value: h=70cm.")
@click.option("--data", multiple=True, metavar="NAME=PATH", help="The file of a table.")
@click.option("--noise", multiple=True, metavar="NAME=VALUE", help="The noise scale of an observation: ranges=5mm.")
@click.option("--measured", multiple=True, metavar="NAME=COLUMN,…", help="What an observation measures, where unclear.")
@click.option(
    "--outliers",
    nargs=2,
    type=NumberFrom(whole=False),
    metavar="FRACTION SIZE",
    help="Gross errors of SIZE standard deviations.",
)
@click.option("--draw-priors", is_flag=True, help="Draw unknowns with a prior from their prior.")
@click.option("--force", is_flag=True, help="Write into a folder that holds other files.")
@click.option("--sandbox", metavar="DIR", help="Confine reads and `use` to a folder.")
@allow_external_option
@verbosity_options
def command(**given: Any) -> int:
    """Write a folder with the measurements that the model of FILE predicts at the given values, with noise, beside a
    copy of FILE that reads them, and `truth.json`, which `mbm solve --init` takes.

    Rows that no observation uses, and all that is not measured, stay as they are.
    """
    screen = terminal()
    folder = Path(given["folder"])
    refuse_standard_output(folder)
    check_folder(folder, SIMULATE, force=given["force"], reads=problem_at(given["file"]))
    made, files = _simulated(given)
    print_diagnostics(() if screen.quiet else made.notes, color=screen.color_errors)
    written = [(file.path, file.content) for file in files]
    write_folder(folder, written, SIMULATE, force=given["force"], reads=reads_so_far())
    if not screen.quiet:
        for file in files:
            say(f"{one_line(str(folder / file.path))}: {one_line(file.summary)}")
    return 0


def _simulated(given: dict[str, Any]) -> tuple[Simulated, tuple[OutputFile, ...]]:
    from mbm.api import simulate_file
    from mbm.report.options import SimulationSettings, SolveOptions

    outliers = given["outliers"]
    if outliers is not None and not (0.0 <= outliers[0] <= 1.0 and abs(outliers[1]) < float("inf")):
        raise MbmError(faults.bad_call("--outliers wants a fraction from 0 to 1, and a finite size", "mbm simulate"))
    options = SolveOptions(
        problem=given["problem"],
        set=named_texts("--set", given["settings"]),
        data=named_paths("--data", given["data"]),
        sandbox=None if given["sandbox"] is None else Path(given["sandbox"]),
        allow_external=given["allow_external"],
    )
    measured = {
        name: tuple(part.strip() for part in text.split(",") if part.strip())
        for name, text in named_texts("--measured", given["measured"])
    }
    settings = SimulationSettings(
        at={} if given["at"] is None else _true_values(Path(given["at"])),
        seed=given["seed"],
        noise=dict(named_texts("--noise", given["noise"])),
        measured=measured,
        outliers=outliers,
        draw_priors=given["draw_priors"],
    )
    return simulate_file(given["file"], options, settings)


def _true_values(path: Path) -> dict[str, Any]:
    note(path, option_role("--at"))
    return json_object(path)
