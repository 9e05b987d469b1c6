"""``mbm compile``: a problem as a folder with a solver that needs no mbm."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mbm.cli import faults
from mbm.cli.inputs import named_paths, named_texts
from mbm.cli.options import terminal, verbosity_options
from mbm.text.shown import one_line
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from mbm.emit.types import OutputFile

TARGETS = ("c", "python", "casadi")

MANIFEST = ".mbm-compile"
"""The file that says which files of a folder this command wrote."""


@click.command("compile")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--target", type=click.Choice(TARGETS), required=True, help="What the solver is written in.")
@click.option("-o", "--output", "folder", metavar="DIR", required=True, help="The folder to write.")
@click.option("--problem", metavar="NAME", help="The problem of the file, where it holds several.")
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="A constant or initial value: h=70cm.")
@click.option("--data", multiple=True, metavar="NAME=PATH", help="The file of a table.")
@click.option("--force", is_flag=True, help="Write into a folder that holds other files.")
@click.option("--sandbox", metavar="DIR", help="Confine reads and `use` to a folder.")
@verbosity_options
def command(**given: Any) -> int:
    """Write a folder with a solver for the problem in FILE that needs no mbm, how to build and call it, and a test.

    c: C99 that needs the mathematical library only. python: one module that needs NumPy only. casadi: serialised CasADi
    functions of the residuals and their Jacobian.
    """
    from mbm.api.emitting import emit_file
    from mbm.report.options import SolveOptions

    folder = Path(given["folder"])
    _refuse_foreign(folder, force=given["force"])
    options = SolveOptions(
        problem=given["problem"],
        set=named_texts("--set", given["settings"]),
        data=named_paths("--data", given["data"]),
        sandbox=None if given["sandbox"] is None else Path(given["sandbox"]),
    )
    files = emit_file(given["file"], options, given["target"])
    _write(folder, files)
    if not terminal().quiet:
        for file in files:
            click.echo(one_line(str(folder / file.path)))
    return 0


def _refuse_foreign(folder: Path, *, force: bool) -> None:
    """A folder with files is written to only if this command made it, or with ``force``."""
    if force or not folder.is_dir() or (folder / MANIFEST).is_file():
        return
    other = next((entry.name for entry in sorted(folder.iterdir())), None)
    if other is not None:
        raise MbmError(faults.foreign_folder(str(folder), other))


def _write(folder: Path, files: tuple[OutputFile, ...]) -> None:
    try:
        for file in files:
            target = folder / file.path
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(file.content)
        (folder / MANIFEST).write_text("".join(f"{file.path}\n" for file in files), encoding="utf-8")
    except OSError as error:
        raise MbmError(faults.not_writable(str(folder), error.strerror or str(error))) from error
