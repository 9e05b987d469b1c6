"""The text of a file or of a caller, as it may be read: UTF-8, of bounded size, one kind of line break."""

from __future__ import annotations

import codecs
from pathlib import Path

from mbm.text import faults
from mbm.text.types import DataPlace, MbmError, Place, Source, Span

LARGEST_TEXT = 4 * 2**20
"""Characters of a text, bytes of a file: beyond it, measurements belong into data files."""


def read_file(path: Path, name: str, asked: Place | None = None) -> Source:
    """The text of a UTF-8 file; a byte order mark is dropped and every line break becomes a line feed.

    ``name`` is what messages print; ``asked`` is the place that names the file (a ``use`` form), if there is one.
    Raises ``MbmError``: no such file, a directory, unreadable, no UTF-8 text, larger than ``LARGEST_TEXT``.
    """
    place = DataPlace(file=name) if asked is None else asked
    try:
        with path.open("rb") as stream:
            data = stream.read(LARGEST_TEXT + 1)
    except (FileNotFoundError, NotADirectoryError):
        raise MbmError(faults.missing_file(path, place)) from None
    except IsADirectoryError:
        raise MbmError(faults.not_a_file(path, place)) from None
    except OSError as error:
        raise MbmError(faults.unreadable_file(path, error.strerror or type(error).__name__, place)) from None
    except ValueError:  # a path with a NUL character
        raise MbmError(faults.unreadable_file(path, "no file can have this name", place)) from None
    if len(data) > LARGEST_TEXT:
        raise MbmError(faults.text_too_large(name, LARGEST_TEXT, asked))
    data = data.removeprefix(codecs.BOM_UTF8)
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        readable = Source(name, data[: error.start].decode("utf-8"))
        at = Span(source=readable, start=len(readable.text), end=len(readable.text))
        raise MbmError(faults.not_text(name, f"the byte 0x{data[error.start]:02x}", at)) from None
    source = Source(name, text.replace("\r\n", "\n").replace("\r", "\n"))
    check_characters(source)
    return source


def check_characters(source: Source) -> None:
    """Refuse what is no text.

    Raises ``MbmError``: larger than ``LARGEST_TEXT``, a NUL character, half of a surrogate pair.
    """
    if len(source.text) > LARGEST_TEXT:
        raise MbmError(faults.text_too_large(source.name, LARGEST_TEXT))
    nul = source.text.find("\0")
    if nul >= 0:
        raise MbmError(faults.not_text(source.name, "a NUL character", Span(source=source, start=nul, end=nul + 1)))
    try:
        source.text.encode("utf-8")
    except UnicodeEncodeError as error:
        at = Span(source=source, start=error.start, end=error.start + 1)
        raise MbmError(faults.not_text(source.name, "half of a surrogate pair", at)) from None
