"""Diagnostics → standard error, and to where ``--json`` asks for them."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence

from mbm.cli.documents import write_document
from mbm.cli.output import say_error, shows_colors
from mbm.files.journal import WRITTEN, Journal, Read
from mbm.files.targets import target_of
from mbm.text.types import Diagnostic, MbmError


def report_failure(
    diagnostics: Sequence[Diagnostic], arguments: Sequence[str], journal: Journal, fault: Exception | None = None
) -> None:
    """Prints what went wrong, and writes it as ``{"diagnostics": […]}`` where ``--json`` of the call points.

    ``arguments`` is the command line, which may not have been readable, ``journal`` what was read before it went wrong.
    ``fault`` is an unforeseen exception, whose traceback ``-v`` shows.
    """
    verbose = any(argument in ("-v", "--verbose") for argument in arguments)
    if fault is not None and verbose:
        import traceback

        say_error("".join(traceback.format_exception(fault)).rstrip("\n"))
    color = "--no-color" not in arguments and shows_colors(sys.stderr)
    print_diagnostics(diagnostics, color=color)
    place = _json_place(arguments)
    if place is None:
        return
    number, destination = place
    others = _files_of(argument for at, argument in enumerate(arguments) if at != number)
    try:
        if not _was_written(destination, journal.reads()):
            write_json(diagnostics, destination, reads=(*journal.reads(), *others))
    except MbmError as error:
        print_diagnostics((d for d in error.diagnostics if d not in diagnostics), color=color)


def _was_written(destination: str, reads: Iterable[Read]) -> bool:
    """Whether the call had written its document already: that is worth more than what went wrong afterwards."""
    written = [read.path for read in reads if WRITTEN in read.roles]
    return bool(written) and any(map(target_of(destination).is_file, written))


def print_diagnostics(diagnostics: Iterable[Diagnostic], *, color: bool) -> None:
    """The diagnostics with their excerpts on standard error, an empty line between two."""
    every = tuple(diagnostics)
    if every:
        from mbm.text.render import render

        texts = (render(diagnostic, color=color) for diagnostic in every)
        say_error("\n\n".join(texts), color=color)


def _json_place(arguments: Sequence[str]) -> tuple[int, str] | None:
    """What follows the last ``--json``, and which argument it stands in."""
    place = None
    for number, argument in enumerate(arguments):
        if argument == "--":
            break
        if argument == "--json" and number + 1 < len(arguments):
            place = number + 1, arguments[number + 1]
        elif argument.startswith("--json="):
            place = number, argument.removeprefix("--json=")
    return place


def _files_of(arguments: Iterable[str]) -> Iterator[Read]:
    """Files that a call may be about: whatever an argument is, or holds behind an equals sign (``--data d=today.csv``).

    A call that went wrong may not have come to read them.
    """
    for argument in arguments:
        parts = argument.split("=")
        for count in range(len(parts)):
            name = "=".join(parts[count:])
            yield Read(path=name, name=name, roles=("a file that this call is about",))


def write_json(diagnostics: Iterable[Diagnostic], destination: str, *, reads: Iterable[Read]) -> None:
    """``{"diagnostics": […]}`` into a file, or to standard output for ``-``; never onto what the call read.

    Raises:
        MbmError: not-writable, would-overwrite; what stood there is as it was.

    """
    from mbm.report.encode import encode, to_bytes
    from mbm.text.render import as_json

    content = to_bytes(encode({"diagnostics": [as_json(diagnostic) for diagnostic in diagnostics]}))
    write_document(content, destination, reads=reads)
