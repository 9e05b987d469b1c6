"""The text of a source file."""

from __future__ import annotations

import codecs
from pathlib import Path

from mbm.files.faults import FILE_TOO_LARGE
from mbm.files.reading import read_bytes
from mbm.text import faults
from mbm.text.characters import LARGEST_TEXT, check_characters
from mbm.text.types import DataPlace, MbmError, Place, Source, Span


def read_file(path: Path, name: str, asked: Place | None = None) -> Source:
    """The text of a file, as `source_of` has it.

    ``name`` is what messages print; ``asked`` is the place that names the file (a ``use`` form). Without one the path
    comes from whoever runs mbm, and may be a stream that the shell hands over (``/dev/stdin``).

    Raises:
        MbmError: missing-file, not-a-file, unreadable-file, not-text, text-too-large (above `LARGEST_TEXT`).

    """
    place = DataPlace(file=name) if asked is None else asked
    try:
        data = read_bytes(path, place, largest=LARGEST_TEXT, streams=asked is None)
    except MbmError as error:
        if error.diagnostics[0].code is FILE_TOO_LARGE:
            raise MbmError(faults.text_too_large(name, LARGEST_TEXT, asked)) from None
        raise
    return source_of(data, name)


def source_of(data: bytes, name: str) -> Source:
    """The text of UTF-8 bytes; a byte order mark is dropped and every line break becomes a line feed.

    Raises:
        MbmError: not-text.

    """
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
