"""``mbm compile``: a problem as a folder with a solver that needs no mbm."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from mbm.cli.documents import refuse_standard_output
from mbm.cli.inputs import initial_values, named_paths, named_texts
from mbm.cli.options import problem_at, reads_so_far, terminal, verbosity_options
from mbm.cli.output import say
from mbm.files.folders import check_folder, write_folder
from mbm.files.names import COMPILE
from mbm.text.shown import one_line

TARGETS = ("c", "python", "casadi")


@click.command("compile")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--target", type=click.Choice(TARGETS), required=True, help="What the solver is written in.")
@click.option("-o", "--output", "folder", metavar="DIR", required=True, help="The folder to write.")
@click.option("--problem", metavar="NAME", help="The problem of the file, where it holds several.")
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="A constant or initial value: h=70cm.")
@click.option("--data", multiple=True, metavar="NAME=PATH", help="The file of a table.")
@click.option("--init", metavar="VALUES.json", help="Initial values: name → value, or a result document.")
@click.option("--force", is_flag=True, help="Write into a folder that holds other files.")
@click.option("--sandbox", metavar="DIR", help="Confine reads and `use` to a folder.")
@verbosity_options
def command(**given: Any) -> int:
    """Write a folder with a solver for the problem in FILE that needs no mbm, how to build and call it, and a test.

    c: C99 that needs the mathematical library only. python: one module that needs NumPy only. casadi: serialised CasADi
    functions of the residuals and their Jacobian.
    """
    from mbm.api.files import emit_file
    from mbm.report.options import SolveOptions

    folder = Path(given["folder"])
    refuse_standard_output(folder)
    check_folder(folder, COMPILE, force=given["force"], reads=problem_at(given["file"]))
    options = SolveOptions(
        problem=given["problem"],
        set=named_texts("--set", given["settings"]),
        data=named_paths("--data", given["data"]),
        init=None if given["init"] is None else initial_values(Path(given["init"])),
        sandbox=None if given["sandbox"] is None else Path(given["sandbox"]),
    )
    files = emit_file(given["file"], options, given["target"])
    made = [(file.path, file.content) for file in files]
    write_folder(folder, made, COMPILE, force=given["force"], reads=reads_so_far())
    if not terminal().quiet:
        for path, _ in made:
            say(one_line(str(folder / path)))
    return 0
