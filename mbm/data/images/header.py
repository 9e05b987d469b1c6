"""What an image file says of itself: its kind and size, read before anything is unpacked, and whether it is whole.

Decoders take memory for the size that a header announces, and fill up what a file lacks with grey. So images of kinds
that are not known here are refused, and files that end too early.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable

from mbm.data.images import faults
from mbm.text.types import DataPlace, MbmError

Size = tuple[int, int]
"""Width and height in pixels."""

PNG, JPEG, BMP = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"BM"
MOST_SCANS = 100
"""Passes in which a JPEG file may refine an image; programs write ten or so, and each takes the time of an image."""

KINDS = "PNG, JPEG, BMP, binary PGM and PPM"
EXTENSIONS = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm")

_COLOUR_TYPE, _ALPHA = 25, 4
"""Where a PNG says what its channels are, and the bit that stands for opacity."""

_FRAMES = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})
_BARE = frozenset({0x01, *range(0xD0, 0xDA)})
"""Markers of JPEG: of the frame's header, and those without a length."""

_SCAN, _END = 0xDA, b"\xff\xd9"
_CUT = "the file is truncated, it ends in the middle"


class _DamagedError(Exception):
    """What is wrong with a file, in words."""


def size_of(content: bytes, path: str) -> Size:
    """The size that an image has by its header.

    Raises:
        MbmError: not-an-image, damaged-image.

    """
    place = DataPlace(file=path)
    for magic, read in _READERS.items():
        if content.startswith(magic):
            try:
                width, height = read(content)
            except _DamagedError as error:
                raise MbmError(faults.damaged_image(place, str(error))) from None
            except (struct.error, IndexError):  # what is read next lies beyond the end
                raise MbmError(faults.damaged_image(place, _CUT)) from None
            except ValueError:
                raise MbmError(faults.damaged_image(place, "its header is wrong")) from None
            if width < 1 or height < 1:
                raise MbmError(faults.damaged_image(place, f"its size is {width} × {height} pixels"))
            return width, height
    raise MbmError(faults.not_an_image(place, KINDS))


def may_be_transparent(content: bytes) -> bool:
    """Whether an image file says how opaque its pixels are: a PNG with a channel, or an entry, for that.

    OpenCV takes the fourth channel of BMP, which many programs leave at nothing, for colour.
    """
    if not content.startswith(PNG):
        return False
    return content[_COLOUR_TYPE] & _ALPHA != 0 or b"tRNS" in content[: content.find(b"IDAT")]


def _png(content: bytes) -> Size:
    if content[12:16] != b"IHDR":
        raise _DamagedError("it does not begin with a header")
    width, height = struct.unpack_from(">II", content, 16)
    position = len(PNG)
    while True:
        (length,) = struct.unpack_from(">I", content, position)
        kind, end = content[position + 4 : position + 8], position + 8 + length
        (check,) = struct.unpack_from(">I", content, end)
        if zlib.crc32(memoryview(content)[position + 4 : end]) != check:
            raise _DamagedError("a check sum in it is wrong")
        if kind == b"IEND":
            return width, height
        position = end + 4


def _jpeg(content: bytes) -> Size:
    position, size = 2, None
    while True:
        if content[position] != 0xFF:
            raise _DamagedError("there is something between its segments")
        marker = content[position + 1]
        if marker == 0xFF:  # padding
            position += 1
            continue
        if marker in _BARE:
            position += 2
            continue
        (length,) = struct.unpack_from(">H", content, position + 2)
        if marker in _FRAMES:
            height, width = struct.unpack_from(">HH", content, position + 5)
            size = width, height
        if marker == _SCAN:
            break
        position += 2 + length
    if size is None:
        raise _DamagedError("it announces no size")
    if content.rfind(_END) < position:
        raise _DamagedError(_CUT)
    if content.count(bytes((0xFF, _SCAN)), position) > MOST_SCANS:
        raise _DamagedError(f"it has more than {MOST_SCANS} passes")
    return size


def _bmp(content: bytes) -> Size:
    (header,) = struct.unpack_from("<I", content, 14)
    if header == 12:
        width, height = struct.unpack_from("<HH", content, 18)
        return width, height
    width, height = struct.unpack_from("<ii", content, 18)
    (total,) = struct.unpack_from("<I", content, 2)
    if len(content) < total:
        raise _DamagedError(_CUT)
    return width, abs(height)


def _pnm(content: bytes) -> Size:
    numbers: list[int] = []
    position = 2
    while len(numbers) < 3:
        if position >= len(content):
            raise _DamagedError(_CUT)
        if content[position : position + 1] == b"#":
            end = content.find(b"\n", position)
            position = end if end >= 0 else len(content)
        elif content[position : position + 1].isspace():
            position += 1
        else:
            end = position
            while content[end : end + 1].isdigit() and end - position < 10:
                end += 1
            numbers.append(int(content[position:end]))
            position = end
    width, height, most = numbers
    channels = 1 if content.startswith(b"P5") else 3
    if len(content) - position - 1 < width * height * channels * (1 if most < 256 else 2):
        raise _DamagedError(_CUT)
    return width, height


_READERS: dict[bytes, Callable[[bytes], Size]] = {PNG: _png, JPEG: _jpeg, BMP: _bmp, b"P5": _pnm, b"P6": _pnm}
