"""npz: an archive of one-dimensional NumPy arrays, one for each column, as ``numpy.savez`` writes it.

Nothing is unpickled. Records count from 1.
"""

from __future__ import annotations

import struct
import zlib
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbm.data import faults
from mbm.data.cells import check_names, column_from_array, counted_table
from mbm.data.content import PER_ROW, check_numbers, check_table, most_unpacked, read_bytes
from mbm.data.readers import faults as format_faults
from mbm.data.types import RawTable, Reader
from mbm.files.memory import PER_VALUE
from mbm.text.types import DataPlace, MbmError

ARRAY_SUFFIX = ".npy"

PER_NUMBER = 16
"""Bytes for a number: in the column, and once more while it is made."""


def read(path: Path) -> RawTable:
    """Read an npz file.

    Raises MbmError as ``read_bytes`` and ``check_numbers`` do, and malformed-npz, no-columns, too-many-columns,
    bad-column-name, duplicate-column, too-much-memory, bad-array, unequal-lengths.
    """
    content, digest = read_bytes(path)
    shown = path.as_posix()
    arrays = _arrays(content, shown, most_unpacked(len(content)))
    cells = sum(array.size for _, array in arrays)
    rows = max((array.size for _, array in arrays), default=0)
    check_numbers(path, len(content), cells)
    check_table(path, cells, sum(_needed(array) for _, array in arrays) + PER_ROW * rows)
    columns = [column_from_array(name, array, shown) for name, array in arrays]
    return counted_table(shown, digest, columns)


def _arrays(content: bytes, path: str, largest: int) -> list[tuple[str, NDArray[Any]]]:
    """The arrays of the archive with their names, in its order; together they may unpack to ``largest`` bytes."""
    # zipfile is slow to import and needed here only
    from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile

    # what zipfile raises on damaged archives: it trusts the offsets and flags that it reads
    damage = (BadZipFile, zlib.error, struct.error, ValueError, EOFError, OSError, RuntimeError)
    place = DataPlace(file=path)
    try:
        archive = ZipFile(BytesIO(content))
    except damage as error:
        raise MbmError(format_faults.malformed_npz(place, str(error))) from None
    with archive:
        members = archive.infolist()
        if sum(member.file_size for member in members) > largest:  # nothing beyond these sizes is unpacked
            raise MbmError(faults.unpacks_too_large(place, len(content), largest))
        names = check_names([member.filename.removesuffix(ARRAY_SUFFIX) for member in members], place)
        arrays = []
        for name, member in zip(names, members, strict=True):
            if not member.filename.endswith(ARRAY_SUFFIX):
                raise MbmError(format_faults.malformed_npz(place, f"`{member.filename}` in it is no array"))
            if member.compress_type not in (ZIP_STORED, ZIP_DEFLATED) or member.flag_bits & 1:
                raise MbmError(format_faults.malformed_npz(place, f"`{member.filename}` is packed in an unusual way"))
            try:
                with archive.open(member) as stream:  # not more than it says, whatever there is
                    unpacked = stream.read(member.file_size)
            except damage as error:
                raise MbmError(format_faults.malformed_npz(place, f"`{member.filename}`: {error}")) from None
            arrays.append((name, _array(unpacked, name, path)))
    return arrays


def _needed(array: NDArray[Any]) -> int:
    """Bytes for an array beside its column; texts become Python objects."""
    return array.nbytes + (PER_VALUE if array.dtype.kind in "OSTUV" else PER_NUMBER) * array.size


def _array(content: bytes, name: str, path: str) -> NDArray[Any]:
    """The array in the bytes of a ``.npy`` file."""
    # the header is a Python literal, which NumPy splits with tokenize if it does not parse
    from tokenize import TokenError

    try:
        array = np.lib.format.read_array(BytesIO(content), allow_pickle=False)
    except (
        ValueError,
        TypeError,
        SyntaxError,
        TokenError,
        EOFError,
        OverflowError,
        RecursionError,
        MemoryError,
    ) as error:
        if "Object arrays" in str(error):
            raise MbmError(faults.bad_array(DataPlace(file=path, column=name), "an array of Python objects")) from None
        reason = f"the array `{name}` is damaged: {error}"
        raise MbmError(format_faults.malformed_npz(DataPlace(file=path, column=name), reason)) from None
    return array


READER = Reader(name="npz", extensions=(".npz",), read=read)
