"""``mbm new``: a folder with a problem and its data, to begin with."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import click

from mbm.cli.documents import refuse_standard_output
from mbm.cli.options import terminal, verbosity_options
from mbm.cli.output import say
from mbm.text.shown import one_line

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
    from mbm.files.folders import write_new_folder

    refuse_standard_output(name)
    title = name.absolute().name or name.resolve().name
    problem = f"{title}.mbm"
    files = [(problem if file == PROBLEM_FILE else file, _content(template, file)) for file in sorted(_files(template))]
    write_new_folder(name, files)
    if not terminal().quiet:
        say("wrote " + ", ".join(one_line(str(name / file)) for file, _ in files))
        say(f"solve it: mbm solve {one_line(str(name / problem))}")
    return 0


def _files(template: str) -> list[str]:
    folder = resources.files("mbm.cli") / "templates" / template
    return [entry.name for entry in folder.iterdir() if entry.name.endswith((".mbm", ".csv"))]


def _content(template: str, file: str) -> bytes:
    return (resources.files("mbm.cli") / "templates" / template / file).read_bytes()
