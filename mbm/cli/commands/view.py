"""``mbm view``: a picture of models, or of a solved problem."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mbm.cli.documents import refuse_standard_output
from mbm.cli.failure import print_diagnostics
from mbm.cli.inputs import solve_options
from mbm.cli.interrupts import interruptible
from mbm.cli.options import (
    NumberFrom,
    Terminal,
    allow_external_option,
    problem_at,
    reads_so_far,
    terminal,
    verbosity_options,
)
from mbm.cli.output import say_error
from mbm.cli.statuses import ATTENTION, OK
from mbm.files.journal import Read
from mbm.files.writing import checked_target, write_whole
from mbm.text.shown import one_line

if TYPE_CHECKING:
    from mbm.api.viewing import Picture

KINDS = ("models", "scene", "overlay", "map")


@click.command("view")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("-o", "--output", "out", metavar="OUT", required=True, help="The picture to write (.png .svg .pdf).")
@click.option("--model", "models", multiple=True, metavar="CALL", help='Draw a model: "(box 3 2 1)".')
@click.option("--show", multiple=True, type=click.Choice(KINDS), help="What to draw of a problem; else what suits.")
@click.option("--photo", "photos", multiple=True, metavar="NAME", help="Draw the image of this name only.")
@click.option("--image", metavar="FILE|DIR", help="The photograph beneath, or a folder of them by their names.")
@click.option("--solve", type=NumberFrom(1), default=1, metavar="N", help="Which solve, of many (from 1).")
@click.option("--problem", metavar="NAME", help="The problem of the file, where it holds several.")
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="A constant, initial value or argument.")
@click.option("--data", multiple=True, metavar="NAME=PATH", help="The file of a table.")
@click.option("--init", metavar="VALUES.json", help="Initial values: name → value, or a result document.")
@click.option("--seed", type=NumberFrom(0), metavar="N", help="Seed of all random numbers.")
@click.option("--sandbox", metavar="DIR", help="Confine reads and `use` to a folder.")
@allow_external_option
@verbosity_options
def command(**given: Any) -> int:
    """Draw FILE into OUT.

    Of a file of models each model, with its hidden lines, feature numbers and axes; arguments without a default are
    given by `--set`, or the whole call by `--model`. A problem is solved first. Then its images are drawn, with
    measured and predicted points, residuals and the uncertainty of the predictions, and the scene of its cameras; or
    the map of its poses.

    Exit status: 0 drawn; 1 drawn, but the answer should not be trusted as it stands; 2 nothing was drawn.
    """
    from mbm.report.figures import format_of

    refuse_standard_output(given["out"])
    ending, screen = format_of(given["out"]), terminal()
    _check(given["out"], problem_at(given["file"]))
    made = _drawn(given, ending)
    write_whole(given["out"], made.content, reads=reads_so_far())
    _tell(made, screen)
    return OK if made.trusted else ATTENTION


def _drawn(given: dict[str, Any], ending: str) -> Picture:
    from mbm.api import view_file
    from mbm.equations.interruption import Interruption
    from mbm.report.view.wishes import Show, Wishes

    interruption = Interruption()
    options = replace(
        solve_options(given), interruption=interruption, loaded=lambda: _check(given["out"], reads_so_far())
    )
    wishes = Wishes(
        show=tuple(Show(kind) for kind in given["show"]),
        models=given["models"],
        photos=given["photos"],
        image=None if given["image"] is None else Path(given["image"]),
        solve=given["solve"],
    )
    with interruptible(interruption):
        return view_file(given["file"], options, wishes, ending)


def _check(out: str, reads: tuple[Read, ...]) -> None:
    """Whether the picture may be written, before the work is done."""
    checked_target(out, reads=reads)


def _tell(made: Picture, screen: Terminal) -> None:
    """What is doubtful, and what was left out of the picture."""
    if screen.quiet:
        return
    print_diagnostics(made.doubts, color=screen.color_errors)
    for note in made.notes:
        say_error(one_line(note))
