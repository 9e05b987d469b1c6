"""``mbm new``: a folder with a problem and its data, to begin with."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import click

from mbm.cli import faults
from mbm.cli.options import terminal, verbosity_options
from mbm.text.shown import one_line
from mbm.text.types import MbmError

TEMPLATES = ("image", "ranges", "trajectory", "curve")
PROBLEM_FILE = "problem.mbm"
"""The problem of a template; it is called after the new folder."""


@click.command("new")
@click.argument("name", type=click.Path(path_type=Path))
@click.option("--template", type=click.Choice(TEMPLATES), default="curve", show_default=True, help="What is measured.")
@verbosity_options
def command(name: Path, template: str) -> int:
    """Write the folder NAME with a problem file and its data.

    image: where a desk stands, from corners in one picture. ranges: positions from distances, one for each epoch.
    trajectory: a drifting track laid onto absolute positions. curve: the parameters of a decay.
    """
    if name.exists() and (not name.is_dir() or any(name.iterdir())):
        raise MbmError(faults.exists_already(str(name)))
    title = name.resolve().name
    written = []
    try:
        name.mkdir(parents=True, exist_ok=True)
        for source in sorted(_files(template)):
            target = name / (f"{title}.mbm" if source == PROBLEM_FILE else source)
            target.write_bytes(_content(template, source))
            written.append(target)
    except OSError as error:
        raise MbmError(faults.not_writable(str(name), error.strerror or str(error))) from error
    if not terminal().quiet:
        click.echo(one_line("wrote " + ", ".join(str(path) for path in written)))
        click.echo(one_line(f"solve it: mbm solve {name / f'{title}.mbm'}"))
    return 0


def _files(template: str) -> list[str]:
    folder = resources.files("mbm.cli") / "templates" / template
    return [entry.name for entry in folder.iterdir() if entry.name.endswith((".mbm", ".csv"))]


def _content(template: str, file: str) -> bytes:
    return (resources.files("mbm.cli") / "templates" / template / file).read_bytes()
