"""The bytes of a data file, unpacked where its name ends in .gz, .bz2 or .xz, and the text in them."""

from __future__ import annotations

from hashlib import sha256
from io import BufferedIOBase, BytesIO
from pathlib import Path

from mbm.data import faults
from mbm.files import reading
from mbm.text.types import DataPlace, MbmError

LARGEST_FILE = 2_000_000_000
"""The size in bytes from which on a file is refused: its table would not fit the memory of an ordinary machine."""

UNPACKED, PACKED_SHARE = 100_000_000, 100
"""Bytes to which a small file may unpack, and how many times its own size a larger one: measurements written as text
shrink to a tenth or so; what shrinks to a thousandth was made to fill the memory."""

COMPRESSED = (".gz", ".bz2", ".xz")
"""Endings of compressed files; the ending before it tells the format."""


def read_bytes(path: Path, *, largest: int = LARGEST_FILE) -> tuple[bytes, str]:
    """The content of a file, read once and unpacked, and the SHA-256 digest of its bytes in hexadecimal.

    Raises MbmError as `mbm.files.reading.read_bytes` does, and empty-file, damaged-archive; file-too-large also for
    what it unpacks to.
    """
    place = DataPlace(file=path.as_posix())
    content = reading.read_bytes(path, place, largest=largest)
    if not content:
        raise MbmError(faults.empty_file(place))
    digest = sha256(content).hexdigest()
    if path.suffix.lower() in COMPRESSED:
        content = _unpacked(content, path, largest)
        if not content:
            raise MbmError(faults.empty_file(place))
    return content, digest


def _unpacked(content: bytes, path: Path, largest: int) -> bytes:
    """The content of a compressed file; never more than ``largest`` bytes are unpacked, nor UNPACKED of a small one."""
    import lzma
    import zlib

    place = DataPlace(file=path.as_posix())
    largest = min(largest, max(UNPACKED, PACKED_SHARE * len(content)))
    try:
        with _packed_stream(content, path.suffix.lower()) as stream:
            unpacked = stream.read(largest + 1)
    except (OSError, EOFError, ValueError, zlib.error, lzma.LZMAError) as error:
        raise MbmError(faults.damaged_archive(place, str(error))) from None
    if len(unpacked) > largest:
        raise MbmError(faults.unpacks_too_large(place, len(content), largest))
    return unpacked


def _packed_stream(content: bytes, ending: str) -> BufferedIOBase:
    """The stream that unpacks ``content``."""
    import bz2
    import gzip
    import lzma

    if ending == ".gz":
        return gzip.GzipFile(fileobj=BytesIO(content))
    return bz2.BZ2File(BytesIO(content)) if ending == ".bz2" else lzma.LZMAFile(BytesIO(content))


def read_text(path: Path) -> tuple[str, str]:
    """The text of a UTF-8 file without a byte order mark, and the SHA-256 digest of its bytes.

    Raises MbmError as ``read_bytes`` does, and not-text; empty-file also for nothing but white space.
    """
    content, digest = read_bytes(path)
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
    return text, digest
