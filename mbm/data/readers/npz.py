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
from mbm.data.cells import column_from_array
from mbm.data.columns import check_names, counted_table
from mbm.data.content import LARGEST_FILE, read_bytes
from mbm.data.readers import faults as format_faults
from mbm.data.types import RawTable, Reader
from mbm.files.faults import file_too_large
from mbm.text.types import DataPlace, MbmError

ARRAY_SUFFIX = ".npy"


def read(path: Path) -> RawTable:
    """Read an npz file.

    Raises MbmError as ``read_bytes`` does, and malformed-npz, no-columns, bad-column-name, duplicate-column, bad-array,
    bad-cell, unequal-lengths.
    """
    content, digest = read_bytes(path)
    shown = path.as_posix()
    columns = [column_from_array(name, array, shown) for name, array in _arrays(content, shown, LARGEST_FILE)]
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
        size = sum(member.file_size for member in members)
        if size > largest:
            raise MbmError(file_too_large(Path(path), size, largest, place))
        names = check_names([member.filename.removesuffix(ARRAY_SUFFIX) for member in members], place)
        arrays = []
        for name, member in zip(names, members, strict=True):
            if not member.filename.endswith(ARRAY_SUFFIX):
                raise MbmError(format_faults.malformed_npz(place, f"`{member.filename}` in it is no array"))
            if member.compress_type not in (ZIP_STORED, ZIP_DEFLATED) or member.flag_bits & 1:
                raise MbmError(format_faults.malformed_npz(place, f"`{member.filename}` is packed in an unusual way"))
            try:
                unpacked = archive.read(member)
            except damage as error:
                raise MbmError(format_faults.malformed_npz(place, f"`{member.filename}`: {error}")) from None
            arrays.append((name, _array(unpacked, name, path)))
    return arrays


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
