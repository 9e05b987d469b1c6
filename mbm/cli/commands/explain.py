"""``mbm explain``: the derived observation model as text."""

from __future__ import annotations

from pathlib import Path

import click

from mbm.cli.options import allow_external_option, verbosity_options
from mbm.cli.output import say

STAGES = ("forms", "problem", "symbolic", "kernels")


@click.command("explain")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--problem", metavar="NAME", help="The problem of the file, where it holds several.")
@click.option("--latex", is_flag=True, help="Write the equations as LaTeX.")
@click.option("--stage", type=click.Choice(STAGES), help="Print what one stage of the compiler makes.")
@click.option("--sandbox", metavar="DIR", help="Confine reads and `use` to a folder.")
@allow_external_option
@verbosity_options
def command(
    file: Path, problem: str | None, latex: bool, stage: str | None, sandbox: str | None, allow_external: bool
) -> int:
    """Print the observation equations of FILE, its unknowns and constraints, the structure of the Jacobian, the chosen
    solver and why.
    """
    from mbm.api import explain

    confined = None if sandbox is None else Path(sandbox)
    text = explain(file, problem=problem, latex=latex, stage=stage, sandbox=confined, allow_external=allow_external)
    say(text.rstrip("\n"))
    return 0
