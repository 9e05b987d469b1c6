"""``mbm propagate``: trials with inputs drawn from their distributions; intervals, document and joint samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mbm.cli import faults
from mbm.cli.documents import refuse_standard_output
from mbm.cli.inputs import solve_options
from mbm.cli.interrupts import interruptible
from mbm.cli.options import NumberFrom, Terminal, allow_external_option, terminal, verbosity_options
from mbm.cli.output import say
from mbm.cli.outputs import answered, outputs_at
from mbm.cli.progress import ProgressBar
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from mbm.report.propagation.answer import Propagated

AUTO = "auto"


@click.command("propagate")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--trials", metavar="N|auto", default=AUTO, help="Trials of each solve; auto: until the results settle.")
@click.option("--problem", metavar="NAME", help="The problem of the file, where it holds several.")
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="A constant or initial value: h=70cm.")
@click.option("--data", multiple=True, metavar="NAME=PATH", help="The file of a table.")
@click.option("--init", metavar="VALUES.json", help="Initial values: name → value, or a result document.")
@click.option("--seed", type=NumberFrom(0), metavar="N", help="Seed of all random numbers.")
@click.option("--json", "json_path", metavar="PATH|-", help="Write the result document, with what the trials say.")
@click.option("--samples", "samples_path", metavar="PATH", help="Write the joint samples (.npz .parquet .nc).")
@click.option("--workers", type=NumberFrom(1), metavar="N", help="Threads; else all cores.")
@click.option("--sandbox", metavar="DIR", help="Confine reads and `use` to a folder.")
@allow_external_option
@verbosity_options
def command(**given: Any) -> int:
    """Solve FILE, then solve it again in many trials, each with its inputs drawn from their distributions: measured
    values by their noise, priors and constants by theirs (GUM Supplement 1).

    Prints mean, standard deviation, the probabilistically symmetric and the shortest coverage interval of each
    quantity, and whether the linear interval of `mbm solve` agrees to two digits of the standard deviation.

    Exit status: as `mbm solve`.
    """
    trials, contents = _trials(given["trials"]), {}
    if given["samples_path"] is not None:
        from mbm.report.propagation.answer import sample_format

        refuse_standard_output(given["samples_path"])
        written = sample_format(given["samples_path"])
        contents["samples_path"] = lambda found: written(found.solves)
    return answered(
        given, outputs_at(given, contents), lambda loaded: _propagated(given, trials, terminal(), loaded), _say
    )


def _say(found: Propagated, screen: Terminal) -> None:
    say(found.table(width=screen.width, color=screen.color, full=screen.verbose), color=screen.color, end="")


def _trials(text: str) -> int | str:
    """The number of trials; 1e6 is one, too.

    Raises:
        MbmError: `bad-call`.

    """
    if text == AUTO:
        return AUTO
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not 2.0 <= number < 1e12 or number != int(number):
        raise MbmError(
            faults.bad_call(f"--trials is {text}; `auto` or a whole number from 2 is wanted", "mbm propagate")
        )
    return int(number)


def _propagated(given: dict[str, Any], trials: int | str, screen: Terminal, loaded: Callable[[], None]) -> Propagated:
    from mbm.api import propagate_file
    from mbm.equations.interruption import Interruption
    from mbm.report.options import PropagationSettings

    interruption = Interruption()
    options = replace(solve_options(given), workers=given["workers"], interruption=interruption, loaded=loaded)
    with ProgressBar(shown=screen.shows_progress) as progress, interruptible(interruption):
        settings = PropagationSettings(
            trials=trials,
            seed=given["seed"],
            workers=given["workers"],
            progress=progress.advance,
            interruption=interruption,
        )
        return propagate_file(given["file"], options, settings)
