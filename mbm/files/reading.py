"""The bytes of one file: an ordinary file, of bounded size, opened without waiting. The text of a source file."""

from __future__ import annotations

import codecs
import os
import sys
from pathlib import Path
from stat import S_ISDIR, S_ISREG
from typing import BinaryIO, NoReturn

from mbm.files import faults
from mbm.files.faults import FILE_TOO_LARGE
from mbm.files.journal import note
from mbm.text import faults as text_faults
from mbm.text.characters import LARGEST_TEXT, check_characters
from mbm.text.types import DataPlace, MbmError, Place, Source, Span

_PLAIN = os.O_RDONLY | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
_FLAGS = _PLAIN | getattr(os, "O_NONBLOCK", 0)
"""A pipe that nobody writes to is opened at once, and then refused; so is one that takes a file's place meanwhile."""

AT_ONCE = 2**20
"""Bytes that are asked of a stream at once: Python takes memory for all that is asked for before it reads."""

STANDARD_INPUT = Path("-")
"""The path that means standard input, where the person who runs mbm gives it."""

STREAMS = ("/dev/stdin", "/dev/fd/")
"""Beginnings of the paths by which a shell hands over a stream that is open already."""


def read_bytes(path: Path, place: Place, *, largest: int, streams: bool = False) -> bytes:
    """The content of a file, ``largest`` bytes at most; faults stand at ``place``. It is noted as read.

    Pipes and devices are refused, for reading them may never end; but where the path comes from the person who runs
    mbm and not from a file (``streams``), standard input (``-``) and what the shell has opened (``/dev/fd/63``) are
    read to their end or to the bound.

    Raises:
        MbmError: missing-file, not-a-file, unreadable-file, file-too-large.

    """
    note(path)
    return look_into(path, place, largest=largest, streams=streams)


def look_into(path: Path, place: Place, *, largest: int, streams: bool = False) -> bytes:
    """As `read_bytes`, of a file that is to be replaced and only looked at before: it is not noted as read."""
    if streams and path == STANDARD_INPUT:
        return _standard_input(place, largest)
    handed_over = streams and path.as_posix().startswith(STREAMS)
    if not handed_over:  # looked at before it is opened: opening a device may do something
        check_ordinary(path, place, largest=largest)
    try:
        with open(os.open(path, _PLAIN if handed_over else _FLAGS), "rb") as stream:  # noqa: PTH123 - with these flags
            status = os.fstat(stream.fileno())
            if not handed_over and not S_ISREG(status.st_mode):  # it changed since it was looked at
                raise MbmError(faults.not_a_file(path, place, folder=S_ISDIR(status.st_mode)))
            content = _at_most(largest + 1, stream, status.st_size)
    except (OSError, ValueError) as error:
        _refuse(path, place, error)
    if len(content) > largest:
        raise MbmError(faults.file_too_large(path, max(status.st_size, len(content)), largest, place))
    return content


def _standard_input(place: Place, largest: int) -> bytes:
    try:
        content = _at_most(largest + 1, sys.stdin.buffer, 0)
    except (OSError, ValueError) as error:
        _refuse(STANDARD_INPUT, place, error)
    if len(content) > largest:
        raise MbmError(faults.file_too_large(STANDARD_INPUT, len(content), largest, place))
    return content


def _at_most(most: int, stream: BinaryIO, expected: int) -> bytes:
    """What is left in a stream, of more than ``most`` bytes only these; memory is taken for what there is."""
    parts, total = [], 0
    while part := stream.read(min(most - total, max(expected + 1, AT_ONCE))):
        parts.append(part)
        total += len(part)
    return parts[0] if len(parts) == 1 else b"".join(parts)


def check_ordinary(path: Path, place: Place, *, largest: int) -> None:
    """Check that ``path`` leads to an ordinary file of ``largest`` bytes at most, without opening it.

    Raises:
        MbmError: missing-file, not-a-file, unreadable-file, file-too-large.

    """
    try:
        status = path.stat()
    except (OSError, ValueError) as error:
        _refuse(path, place, error)
    if not S_ISREG(status.st_mode):
        raise MbmError(faults.not_a_file(path, place, folder=S_ISDIR(status.st_mode)))
    if status.st_size > largest:
        raise MbmError(faults.file_too_large(path, status.st_size, largest, place))


def _refuse(path: Path, place: Place, error: OSError | ValueError) -> NoReturn:
    """Raise what the system objects to, or that no file can have this name (a NUL in it), as a diagnostic."""
    if isinstance(error, FileNotFoundError | NotADirectoryError | ValueError):
        raise MbmError(faults.missing_file(path, place)) from None
    raise MbmError(faults.unreadable_file(path, error.strerror or type(error).__name__, place)) from None


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
            raise MbmError(text_faults.text_too_large(name, LARGEST_TEXT, asked)) from None
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
        raise MbmError(text_faults.not_text(name, f"the byte 0x{data[error.start]:02x}", at)) from None
    source = Source(name, text.replace("\r\n", "\n").replace("\r", "\n"))
    check_characters(source)
    return source
