"""How much memory the work on one problem may take: one bound for all that is read, unpacked, compiled and solved."""

from __future__ import annotations

import os
import re
from functools import cache

from mbm.files import faults
from mbm.text.types import MbmError, Place

VARIABLE = "MBM_MEMORY"
"""Environment variable: the bytes that may be taken, such as ``4GB``."""

USUAL = 1_500_000_000
"""Bytes that may be taken where nobody says otherwise, on a machine that has four times as much."""

SHARE = 4
"""One part in so many of the machine's memory may be taken where nobody says otherwise."""

FILE_SHARE = 3
"""A file may have one part in so many: its content is there twice while it is taken apart."""

COPIES, WIDE_COPIES, PER_VALUE = 4, 16, 100
"""What a text takes while it is taken apart: so many times its bytes, more where one character may make all of them
four bytes wide, and bytes for each value in it, which is a Python object before it is a number (measured: 40 to 90 for
CSV and JSON, up to 130 for graphs)."""

_UNITS = {"": 1, "B": 1, "KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}
_STATED = re.compile(r"\s*(\d{1,18}(?:\.\d{1,9})?)\s*([KMGT]?B|)\s*", re.IGNORECASE | re.ASCII)


def allowed() -> int:
    """Bytes that the work on one problem may take.

    Raises:
        MbmError: bad-memory-bound, `VARIABLE` states no number of bytes.

    """
    text = os.environ.get(VARIABLE)
    if text is None or not text.strip():
        return min(USUAL, _installed() // SHARE)
    stated = _STATED.fullmatch(text)
    if stated is None:
        raise MbmError(faults.bad_memory_bound(VARIABLE, text))
    return int(float(stated[1]) * _UNITS[stated[2].upper()])


def check_memory(needed: int, what: str, place: Place | None) -> None:
    """Refuse work before it takes the memory: ``what`` needs about ``needed`` bytes.

    Raises:
        MbmError: too-much-memory, more than is `allowed`.

    """
    most = allowed()
    if needed > most:
        raise MbmError(faults.too_much_memory(what, needed, most, VARIABLE, place))


def largest_file() -> int:
    """Bytes of a file that are read."""
    return allowed() // FILE_SHARE


def text_memory(content: bytes, values: int) -> int:
    """Bytes that it takes to take a text apart that holds about so many values."""
    return (COPIES if content.isascii() else WIDE_COPIES) * len(content) + PER_VALUE * values


@cache
def _installed() -> int:
    """The memory of this machine in bytes; where the system does not tell, as much as the usual bound wants."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return SHARE * USUAL
