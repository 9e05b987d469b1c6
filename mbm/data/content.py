"""The bytes of a data file, unpacked where its name ends in .gz, .bz2 or .xz, and the text in them.

What comes in is bounded by the memory that mbm may take (`mbm.files.memory`): a file by its size, a compressed one by
what it unpacks to, a text by the cells in it, each before the memory is taken.
"""

from __future__ import annotations

from hashlib import sha256
from io import BufferedIOBase, BytesIO
from pathlib import Path

import numpy as np

from mbm.data import faults
from mbm.files import reading
from mbm.files.memory import PER_VALUE, check_memory, largest_file, text_memory
from mbm.text.types import DataPlace, MbmError

UNPACKED, PACKED_SHARE = 16_000_000, 100
"""Bytes to which a small file may unpack, and how many times its own size a larger one: measurements written as text
shrink to a tenth or so; what shrinks to a thousandth was made to fill the memory."""

PER_ROW = 48
"""Bytes for a row beside its cells: its number in the file, and which rows are used for what."""

COMPRESSED = (".gz", ".bz2", ".xz")
"""Endings of compressed files; the ending before it tells the format."""

LISTED, BLANKS = b",", b" \t\v\f\x1c\x1d\x1e\x1f"
"""What stands between the cells of a line: each of these characters ends one, or any number of them do."""

LINE_ENDS = b"\n\r"
"""Where lines end."""

_AT_ONCE = 1 << 22


def read_bytes(path: Path, *, largest: int | None = None) -> tuple[bytes, str]:
    """The content of a file, read once and unpacked, and the SHA-256 digest of its bytes in hexadecimal.

    ``largest`` bytes are read at most (None: `largest_file`).

    Raises MbmError as `mbm.files.reading.read_bytes` does, and empty-file, damaged-archive; file-too-large also for
    what it unpacks to.
    """
    place = DataPlace(file=path.as_posix())
    most = largest_file() if largest is None else largest
    content = reading.read_bytes(path, place, largest=most)
    if not content:
        raise MbmError(faults.empty_file(place))
    digest = sha256(content).hexdigest()
    if path.suffix.lower() in COMPRESSED:
        content = _unpacked(content, path, most)
        if not content:
            raise MbmError(faults.empty_file(place))
    return content, digest


def most_unpacked(packed: int, largest: int | None = None) -> int:
    """Bytes to which so many ``packed`` ones may unpack: never more than a file may hold."""
    most = largest_file() if largest is None else largest
    return min(most, max(UNPACKED, PACKED_SHARE * packed))


def check_numbers(path: Path, packed: int, numbers: int) -> None:
    """Refuse a file of so many ``packed`` bytes whose ``numbers`` take more than it may unpack to, 8 bytes for each.

    Raises:
        MbmError: file-too-large.

    """
    most = most_unpacked(packed)
    if np.dtype(np.float64).itemsize * numbers > most:
        raise MbmError(faults.unpacks_too_large(DataPlace(file=path.as_posix()), packed, most))


def _unpacked(content: bytes, path: Path, largest: int) -> bytes:
    """The content of a compressed file; never more than ``largest`` bytes are unpacked, nor UNPACKED of a small one."""
    import lzma
    import zlib

    place = DataPlace(file=path.as_posix())
    most = most_unpacked(len(content), largest)
    try:
        with _packed_stream(content, path.suffix.lower()) as stream:
            unpacked = stream.read(most + 1)
    except (OSError, EOFError, ValueError, MemoryError, zlib.error, lzma.LZMAError) as error:
        raise MbmError(faults.damaged_archive(place, str(error))) from None
    if len(unpacked) > most:
        raise MbmError(faults.unpacks_too_large(place, len(content), most))
    return unpacked


def _packed_stream(content: bytes, ending: str) -> BufferedIOBase:
    """The stream that unpacks ``content``."""
    import bz2
    import gzip
    import lzma

    if ending == ".gz":
        return gzip.GzipFile(fileobj=BytesIO(content))
    return bz2.BZ2File(BytesIO(content)) if ending == ".bz2" else lzma.LZMAFile(BytesIO(content))


def lines_in(text: str) -> list[str]:
    """The lines as editors count them: `str.splitlines` also ends them at form feeds and separators of paragraphs."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return lines if lines[-1] else lines[:-1]


def read_text(path: Path, *, between: bytes = LISTED) -> tuple[str, str]:
    """The text of a UTF-8 file without a byte order mark, and the SHA-256 digest of its bytes.

    ``between`` is what stands between the cells of the format.

    Raises MbmError as ``read_bytes`` does, and not-text; empty-file also for nothing but white space; too-much-memory
    where all cells together would take more than there may be.
    """
    content, digest = read_bytes(path)
    check_text(path, content, between)
    return text_of(content, path), digest


def check_text(path: Path, content: bytes, between: bytes) -> None:
    """Refuse a text whose cells would not fit the memory.

    Raises:
        MbmError: too-much-memory.

    """
    cells = cells_in(content, between)
    check_table(path, cells, text_memory(content, cells))


def check_table(path: Path, cells: int, needed: int | None = None) -> None:
    """Refuse a table of so many cells that needs more bytes than there may be (None: what Python objects take).

    Raises:
        MbmError: too-much-memory.

    """
    shown = path.as_posix()
    needed = PER_VALUE * cells if needed is None else needed
    check_memory(needed, faults.table_of_cells(shown, cells), DataPlace(file=shown))


def cells_in(content: bytes, between: bytes) -> int:
    """How many cells and lines a text has, about; blanks count once, however many stand between two cells."""
    lines = sum(content.count(end) for end in LINE_ENDS)
    if between != BLANKS:
        return 1 + lines + sum(content.count(separator) for separator in between)
    blank = np.zeros(256, dtype=bool)
    blank[list(BLANKS + LINE_ENDS)] = True
    count, before = lines, True
    for first in range(0, len(content), _AT_ONCE):
        here = blank[np.frombuffer(content, dtype=np.uint8, count=min(_AT_ONCE, len(content) - first), offset=first)]
        count += int(np.count_nonzero(here[:-1] & ~here[1:])) + int(before and not here[0])
        before = bool(here[-1])
    return count


def text_of(content: bytes, path: Path) -> str:
    """The text in the bytes of a file.

    Raises MbmError: not-text, empty-file.
    """
    shown = path.as_posix()
    nul = content.find(b"\0")
    if nul >= 0:
        raise MbmError(faults.not_text(DataPlace(file=shown, row=content.count(b"\n", 0, nul) + 1), byte=0))
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        # the codec counts behind the byte order mark, which holds no line break: only the byte itself must be looked up
        offending = error.object[error.start]
        row = error.object.count(b"\n", 0, error.start) + 1
        raise MbmError(faults.not_text(DataPlace(file=shown, row=row), byte=offending)) from None
    if not text or text.isspace():
        raise MbmError(faults.empty_file(DataPlace(file=shown)))
    return text
