"""Diagnostics → standard error, and to where ``--json`` asks for them."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import click

from mbm.cli import faults
from mbm.cli.options import colorful
from mbm.text.shown import one_line, printable
from mbm.text.types import Diagnostic


def report_failure(diagnostics: Sequence[Diagnostic], arguments: Sequence[str], fault: Exception | None = None) -> None:
    """Prints what went wrong, and writes it as ``{"diagnostics": […]}`` where ``--json`` of the call points.

    ``arguments`` is the command line, which may not have been readable. ``fault`` is an unforeseen exception, whose
    traceback ``-v`` shows.
    """
    verbose = any(argument in ("-v", "--verbose") for argument in arguments)
    if fault is not None and verbose:
        import traceback

        click.echo(printable("".join(traceback.format_exception(fault))), err=True, nl=False)
    print_diagnostics(diagnostics, color="--no-color" not in arguments and colorful(sys.stderr))
    destination = _json_destination(arguments)
    said = any(d.code is faults.NOT_WRITABLE and f"`{one_line(str(destination))}`" in d.message for d in diagnostics)
    if destination is not None and not said:
        write_json(diagnostics, destination)


def print_diagnostics(diagnostics: Iterable[Diagnostic], *, color: bool) -> None:
    """The diagnostics with their excerpts on standard error, an empty line between two."""
    every = tuple(diagnostics)
    if every:
        from mbm.text.render import render

        texts = (render(_mendable(diagnostic), color=color) for diagnostic in every)
        click.echo("\n\n".join(texts), err=True, color=color)


def _mendable(diagnostic: Diagnostic) -> Diagnostic:
    """The diagnostic with a hint: where one with a place has none of its own, what its code says in general."""
    if diagnostic.hint is not None or diagnostic.place is None:
        return diagnostic
    mend = diagnostic.code.mend
    return replace(diagnostic, hint=mend[:1].lower() + mend[1:].rstrip("."))


def _json_destination(arguments: Sequence[str]) -> str | None:
    """What follows the last ``--json``."""
    destination = None
    for argument, following in zip(arguments, (*arguments[1:], None), strict=True):
        if argument == "--":
            break
        if argument == "--json":
            destination = following
        elif argument.startswith("--json="):
            destination = argument.removeprefix("--json=")
    return destination


def write_json(diagnostics: Iterable[Diagnostic], destination: str) -> None:
    """``{"diagnostics": […]}`` into a file, or to standard output for ``-``; a file that cannot be written is said."""
    from mbm.report.encode import encode, to_bytes
    from mbm.text.render import as_json

    content = to_bytes(encode({"diagnostics": [as_json(_mendable(diagnostic)) for diagnostic in diagnostics]}))
    if destination == "-":
        write_bytes(content)
        return
    try:
        Path(destination).write_bytes(content)
    except OSError as error:
        print_diagnostics((faults.not_writable(destination, error.strerror or str(error)),), color=False)


def write_bytes(content: bytes) -> None:
    """Bytes to standard output."""
    sys.stdout.buffer.write(content)
    sys.stdout.buffer.flush()
