"""``mbm expand``: what a form expands to in the scope of a file."""

from __future__ import annotations

from pathlib import Path

import click

from mbm.cli.options import verbosity_options
from mbm.cli.output import say


@click.command("expand")
@click.argument("file", type=click.Path(path_type=Path))
@click.argument("form")
@click.option("--sandbox", metavar="DIR", help="Confine reads and `use` to a folder.")
@verbosity_options
def command(file: Path, form: str, sandbox: str | None) -> int:
    """Print the expansion of the expression FORM with the definitions of FILE."""
    from mbm.api import expand

    say(expand(file, form, sandbox=None if sandbox is None else Path(sandbox)).rstrip("\n"))
    return 0
