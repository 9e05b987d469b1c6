"""``mbm check``: what is wrong with a problem, without solving it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from mbm.cli.documents import STANDARD_OUTPUT, check_document
from mbm.cli.failure import print_diagnostics, write_json
from mbm.cli.inputs import named_paths
from mbm.cli.options import allow_external_option, reads_so_far, terminal, verbosity_options
from mbm.cli.output import say
from mbm.cli.statuses import OK, WRONG
from mbm.text.shown import one_line
from mbm.text.types import Severity


@click.command("check")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--problem", metavar="NAME", help="The problem of the file to check; all of them if left out.")
@click.option("--data", multiple=True, metavar="NAME=PATH", help="The file of a table.")
@click.option("--strict-units", is_flag=True, help="Require a unit for every column and unknown.")
@click.option("--json", "json_path", metavar="PATH|-", help="Write the diagnostics as JSON.")
@click.option("--sandbox", metavar="DIR", help="Confine reads and `use` to a folder.")
@allow_external_option
@verbosity_options
def command(
    file: Path,
    problem: str | None,
    data: tuple[str, ...],
    strict_units: bool,
    json_path: str | None,
    sandbox: str | None,
    allow_external: bool,
) -> int:
    """Parse and expand FILE, check names, shapes, units, data and what can be estimated, and print what is wrong.

    Exit status: 0 nothing, or nothing but warnings; 2 errors.
    """
    from mbm.api import check, sequences

    check_document(json_path, ())
    given: dict[str, Any] = {
        "data": named_paths("--data", data),
        "sandbox": None if sandbox is None else Path(sandbox),
        "allow_external": allow_external,
    }
    found = check(file, problem=problem, strict_units=strict_units, **given)
    screen = terminal()
    errors = [diagnostic for diagnostic in found if diagnostic.severity is Severity.ERROR]
    print_diagnostics(errors if screen.quiet else found, color=screen.color_errors)
    if json_path is not None:
        write_json(found, json_path, reads=reads_so_far())
    if json_path != STANDARD_OUTPUT and not screen.quiet:
        for line in () if errors else sequences(file, problem=problem, **given):
            say(f"{one_line(str(file))}: {line}")
        say(f"{one_line(str(file))}: {_counted(len(errors), 'error')}, {_counted(len(found) - len(errors), 'warning')}")
    return WRONG if errors else OK


def _counted(count: int, noun: str) -> str:
    return f"{count or 'no'} {noun}{'' if count == 1 else 's'}"
