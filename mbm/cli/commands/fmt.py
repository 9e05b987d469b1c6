"""``mbm fmt``: source files in their one layout."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from mbm.cli.options import terminal, verbosity_options
from mbm.cli.output import is_terminal, say, say_error, write_bytes
from mbm.files.faults import not_a_file
from mbm.text.characters import LARGEST_TEXT
from mbm.text.shown import one_line
from mbm.text.types import DataPlace, Diagnostic, MbmError, Sequence, Source

UNCHANGED, CHANGED = 0, 1
_STANDARD_INPUT = "-"


@click.command("fmt")
@click.argument("files", nargs=-1, required=True, metavar="FILE…")
@click.option("--check", is_flag=True, help="Write nothing; exit status 1 if a file would change.")
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
            say_error(f"{one_line(name)}: {'would change' if check else 'laid out'}")
    if wrong:
        raise MbmError(*wrong)
    return status


def _file(path: Path, check: bool) -> bool:
    """Whether the file changes; rewrites it unless ``check``."""
    from mbm.files.reading import read_bytes, source_of
    from mbm.files.targets import is_source, target_of
    from mbm.files.writing import write_whole
    from mbm.text.formatter import format_text

    place = DataPlace(file=str(path))
    before = read_bytes(path, place, largest=LARGEST_TEXT)
    source = source_of(before, str(path))
    if not is_source(path):
        _check_definitions(source)
    text = format_text(source).encode("utf-8")
    if text == before:
        return False
    if not check:
        if not target_of(path).is_ordinary:
            raise MbmError(not_a_file(path, place, folder=False))
        write_whole(path, text, replaces_source=True)
    return True


def _check_definitions(source: Source) -> None:
    """Refuse a text that holds anything but lists, as sources do: words and numbers may be a table of measurements.

    Raises:
        MbmError: bad-form, and whatever is wrong with the characters.

    """
    from mbm.language.faults import bad_top_level
    from mbm.text.reader import read

    others = [form.span for form in read(source) if not isinstance(form, Sequence)]
    if others:
        raise MbmError(bad_top_level(others[0]))


def _standard_input(check: bool) -> bool:
    from mbm.files.reading import STANDARD_INPUT, read_bytes, source_of
    from mbm.text.formatter import format_text

    name = "<stdin>"
    before = read_bytes(STANDARD_INPUT, DataPlace(file=name), largest=LARGEST_TEXT, streams=True)
    text = format_text(source_of(before, name))
    if not check:
        if is_terminal(sys.stdout):
            say(text, end="")
        else:
            write_bytes(text.encode("utf-8"))
    return check and text.encode("utf-8") != before
