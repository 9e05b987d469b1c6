"""``mbm fmt``: source files in their one layout."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from mbm.cli import faults
from mbm.cli.failure import write_bytes
from mbm.cli.options import terminal, verbosity_options
from mbm.text.shown import one_line, printable
from mbm.text.types import Diagnostic, MbmError, Source

UNCHANGED, CHANGED = 0, 1
_STANDARD_INPUT = "-"


@click.command("fmt")
@click.argument("files", nargs=-1, required=True, metavar="FILE…")
@click.option("--check", is_flag=True, help="Change nothing; exit status 1 if a file would change.")
@verbosity_options
def command(files: tuple[str, ...], check: bool) -> int:
    """Rewrite each FILE in the one layout of the language; `-` lays standard input out to standard output.

    Meaning and comments never change. Files that cannot be parsed are left alone and reported (exit status 2).
    """
    quiet = terminal().quiet
    wrong: list[Diagnostic] = []
    status = UNCHANGED
    for name in files:
        try:
            changed = _standard_input(check) if name == _STANDARD_INPUT else _file(Path(name), check)
        except MbmError as error:
            wrong.extend(error.diagnostics)
            continue
        if changed and check:
            status = CHANGED
        if changed and not quiet:
            click.echo(one_line(f"{name}: {'would change' if check else 'laid out'}"), err=True)
    if wrong:
        raise MbmError(*wrong)
    return status


def _file(path: Path, check: bool) -> bool:
    """Whether the file changes; rewrites it unless ``check``."""
    from mbm.files.source import read_file
    from mbm.text.formatter import format_text

    source = read_file(path, str(path))
    text = format_text(source).encode("utf-8")
    if text == path.read_bytes():
        return False
    if not check:
        try:
            path.write_bytes(text)
        except OSError as error:
            raise MbmError(faults.not_writable(str(path), error.strerror or str(error))) from error
    return True


def _standard_input(check: bool) -> bool:
    from mbm.text.formatter import format_text

    try:
        given = sys.stdin.buffer.read().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise MbmError(faults.bad_call("standard input is no UTF-8 text", "mbm fmt")) from error
    text = format_text(Source(name="<stdin>", text=given.replace("\r\n", "\n").replace("\r", "\n")))
    if not check:
        write_bytes((printable(text) if sys.stdout.isatty() else text).encode("utf-8"))
    return check and text != given
