"""The bytes of a data file, unpacked where its name ends in .gz, .bz2 or .xz, and the text in them."""

from __future__ import annotations

from hashlib import sha256
from io import BufferedIOBase, BytesIO
from pathlib import Path
from stat import S_ISREG

from mbm.data import faults
from mbm.text.faults import missing_file
from mbm.text.types import DataPlace, MbmError, Place

LARGEST_FILE = 2_000_000_000
"""The size in bytes from which on a file is refused: its table would not fit the memory of an ordinary machine."""

UNPACKED, PACKED_SHARE = 100_000_000, 100
"""Bytes to which a small file may unpack, and how many times its own size a larger one: measurements written as text
shrink to a tenth or so; what shrinks to a thousandth was made to fill the memory."""

COMPRESSED = (".gz", ".bz2", ".xz")
"""Endings of compressed files; the ending before it tells the format."""


def check_file(path: Path, place: Place, *, largest: int = LARGEST_FILE) -> None:
    """Check that ``path`` is an ordinary file of bounded size; a fault stands at ``place``.

    Pipes and devices are refused: reading them may never end.
    Raises MbmError: missing-file, not-a-file, unreadable-file, file-too-large.
    """
    shown = path.as_posix()
    try:
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        raise MbmError(missing_file(path, place)) from None
    except OSError as error:
        raise MbmError(faults.unreadable_file(place, shown, error.strerror or str(error))) from None
    except ValueError:  # a NUL character in the name: no such file can exist
        raise MbmError(missing_file(path, place)) from None
    if not S_ISREG(status.st_mode):
        raise MbmError(faults.not_a_file(place, shown, folder=path.is_dir()))
    if status.st_size > largest:
        raise MbmError(faults.file_too_large(place, shown, status.st_size, largest))


def read_bytes(path: Path, *, largest: int = LARGEST_FILE) -> tuple[bytes, str]:
    """The content of a file, read once and unpacked, and the SHA-256 digest of its bytes in hexadecimal.

    Raises MbmError as ``check_file`` does, and empty-file, damaged-archive.
    """
    place = DataPlace(file=path.as_posix())
    check_file(path, place, largest=largest)
    try:
        with path.open("rb") as stream:
            content = stream.read(largest + 1)
    except OSError as error:
        raise MbmError(faults.unreadable_file(place, place.file, error.strerror or str(error))) from None
    if len(content) > largest:  # it grew since it was checked
        raise MbmError(faults.file_too_large(place, place.file, len(content), largest))
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
