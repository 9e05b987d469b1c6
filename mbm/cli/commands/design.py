"""``mbm design``: the accuracy to expect of an experiment, and what to measure next."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mbm.cli.inputs import initial_values, solve_options
from mbm.cli.options import NumberFrom, Terminal, allow_external_option, verbosity_options
from mbm.cli.output import say
from mbm.cli.outputs import answered, outputs_at

if TYPE_CHECKING:
    from mbm.report.designs.answer import Design


@click.command("design")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--at", metavar="VALUES.json", help="Where to expect it: name → value, or a result document.")
@click.option("--for", "quantity", metavar="QUANTITY", help="The estimate or derived quantity that is to be accurate.")
@click.option("--candidates", metavar="TABLE", help="What could be measured: a file, or a table of the problem.")
@click.option("--observation", metavar="NAME", help="The observation that the candidates are rows of, if unclear.")
@click.option("--criterion", type=click.Choice(["A", "c", "D"]), help="What is to be small (one number: c).")
@click.option("--choose", type=NumberFrom(1, 10_000), metavar="N", help="Choose the best N candidates.")
@click.option(
    "--budget", type=NumberFrom(0, whole=False), metavar="COST", help="Choose as many as their `cost` allows."
)
@click.option("--repeats", is_flag=True, help="A candidate may be chosen more than once.")
@click.option("--sigma", metavar="VALUE", help="A wanted standard deviation: tell the repeats it takes.")
@click.option("--problem", metavar="NAME", help="The problem of the file, where it holds several.")
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="A constant or initial value: h=70cm.")
@click.option("--data", multiple=True, metavar="NAME=PATH", help="The file of a table.")
@click.option("--solve", type=NumberFrom(1), default=1, metavar="N", help="Which solve, of many (from 1).")
@click.option("--seed", type=NumberFrom(0), default=1, metavar="N", help="Seed of the search for sets.")
@click.option("--json", "json_path", metavar="PATH|-", help="Write everything as JSON.")
@click.option("--csv", "csv_path", metavar="PATH", help="Write the candidates (without any: what to expect) as CSV.")
@click.option("--plot", "plot_path", metavar="PATH", help="Draw candidates and the worth of rows (.png .svg .pdf).")
@click.option("--sandbox", metavar="DIR", help="Confine reads and `use` to a folder.")
@allow_external_option
@verbosity_options
def command(**given: Any) -> int:
    """Tell how accurate the estimates of FILE will be, before anything is measured: the column that is measured may be
    empty or missing. With candidates, tell what each would add, and which to choose.

    Exit status: 0; 1 if something that is estimated, or the quantity asked for, is not determined.
    """
    return answered(
        given,
        outputs_at(given, {"csv_path": _rows}, _drawn),
        lambda _: _design(given),
        _say,
        doubts=lambda design: design.notes,
        fine=lambda design: design.observable,
    )


def _say(design: Design, screen: Terminal) -> None:
    from mbm.report.designs.answer import text

    say(text(design, color=screen.color, full=screen.verbose), end="")


def _rows(design: Design) -> bytes:
    from mbm.report.designs.answer import design_rows

    return design_rows(design).encode("utf-8", "backslashreplace")


def _drawn(design: Design) -> Any:
    from mbm.report.designs.plots import draw

    return draw(design)


def _design(given: dict[str, Any]) -> Design:
    from mbm.api import design_file
    from mbm.report.designs.types import DesignWish

    options = solve_options(given)
    wish = DesignWish(
        quantity=given["quantity"],
        criterion=given["criterion"],
        choose=given["choose"],
        budget=given["budget"],
        repeats=given["repeats"],
        sigma=given["sigma"],
        observation=given["observation"],
        seed=given["seed"],
        solve=given["solve"],
    )
    at = None if given["at"] is None else initial_values(Path(given["at"]))
    return design_file(given["file"], options, at, given["candidates"], wish)
