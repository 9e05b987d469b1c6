"""What the command line says: the only way by which anything gets to standard output and standard error.

Text is looked at a last time before a terminal may have it. A reader who goes away has read what was wanted: from then
on all goes nowhere, and the exit status is that of the answer. Standard output that cannot be written for another
reason is an error like any other; where standard error cannot be written, nobody can be told.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from io import TextIOBase
from typing import Any, TextIO

from mbm.files.faults import output_not_writable, reason_of
from mbm.text.shown import printable
from mbm.text.types import MbmError

_GONE = (BrokenPipeError, ConnectionResetError)
"""Nobody reads any more."""


def say(text: str, *, color: bool = False, end: str = "\n") -> None:
    """A text on standard output; with ``color``, what `Paint` added stays.

    Raises:
        MbmError: not-writable.

    """
    _to_output(sys.stdout, _encoded(printable(text, color=color) + end, sys.stdout))


def write_bytes(content: bytes) -> None:
    """Bytes on standard output, as they are: for programs, which read JSON or a laid-out source.

    Raises:
        MbmError: not-writable.

    """
    stream = getattr(sys.stdout, "buffer", None)
    if stream is None:  # something of Python's in its place, which takes text
        _to_output(sys.stdout, content.decode("utf-8", errors="replace"))
    else:
        _to_output(stream, content)


def say_error(text: str, *, color: bool = False) -> None:
    """A text on standard error."""
    try:
        _write(sys.stderr, _encoded(printable(text, color=color) + "\n", sys.stderr))
    except (OSError, ValueError):
        _discard(sys.stderr)


class ErrorStream(TextIOBase):
    """Standard error for what draws on it, and may put itself in its place; what is drawn is not looked at."""

    def __init__(self) -> None:
        self._stream = sys.stderr

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """That of standard error."""
        return self._stream.encoding or "utf-8"

    def write(self, text: str) -> int:
        """Write it, or let it go nowhere."""
        try:
            _write(self._stream, text)
        except (OSError, ValueError):
            _discard(self._stream)
        return len(text)

    def isatty(self) -> bool:
        """Whether somebody watches."""
        return is_terminal(self._stream)

    def fileno(self) -> int:
        """The number that the system has for it."""
        return self._stream.fileno()


def is_terminal(stream: TextIO) -> bool:
    """Whether a person reads what goes to ``stream``."""
    try:
        return stream.isatty()
    except ValueError:  # it is closed
        return False


def shows_colors(stream: TextIO) -> bool:
    """``stream`` is a terminal that shows colours, and NO_COLOR (no-color.org) is not set."""
    return is_terminal(stream) and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def open_closed_streams() -> None:
    """Fill the places of standard streams that whoever started the process has closed.

    Files that are opened later would get their numbers, and what is said would be written into them. Standard input and
    output that were closed cannot be read and written, as a program in C finds; what goes to standard error is lost.
    """
    for number, name, flags in ((0, "stdin", os.O_WRONLY), (1, "stdout", os.O_RDONLY), (2, "stderr", os.O_WRONLY)):
        if getattr(sys, name) is None:
            null = os.open(os.devnull, flags)
            if null == number:
                os.set_inheritable(null, True)
            else:
                os.dup2(null, number)
                os.close(null)
            setattr(sys, name, os.fdopen(number, "r" if number == 0 else "w", encoding="utf-8"))


def flush() -> None:
    """What others wrote on both streams goes out, or nowhere: the process ends."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            _discard(stream)


def _encoded(text: str, stream: TextIO) -> str:
    """The text with question marks for characters that a stream does not have (``±`` in ASCII)."""
    encoding = getattr(stream, "encoding", None) or "utf-8"
    return text.encode(encoding, errors="replace").decode(encoding)


def _to_output(stream: Any, content: str | bytes) -> None:
    try:
        _write(stream, content)
    except _GONE:
        _discard(sys.stdout)
    except (OSError, ValueError) as error:
        _discard(sys.stdout)
        reason = reason_of(error) if isinstance(error, OSError) else "it is closed"
        raise MbmError(output_not_writable(reason)) from None


def _write(stream: Any, content: str | bytes) -> None:
    stream.write(content)
    stream.flush()


def _discard(stream: TextIO) -> None:
    """What is said from now on, and what is still waiting, goes nowhere."""
    with suppress(OSError, ValueError):
        number = stream.fileno()
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, number)
        os.close(null)
        stream.flush()
