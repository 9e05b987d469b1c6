"""Conformance of readers: `Reader` of `mbm.data.types`."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from mbm.data.types import RawTable, Reader
from mbm.testing.requirement import require, require_close
from mbm.text.types import DataPlace, MbmError

NOISE = (b"", b"\x00", b"\xff\xfe\x00", b"{", b"[[[[", b"1,2\n3", b'"', b"PK\x03\x04", bytes(range(256)) * 4)
"""Contents that are no table of any format, or hardly one."""


def check_reader(
    reader: Reader, path: Path, expected: Mapping[str, Sequence[object]], *, faulty: Iterable[Path] = ()
) -> None:
    """Whether a reader keeps what the data stage relies on.

    Args:
        reader: the reader.
        path: a sound file.
        expected: its columns by name and in order: numbers (NaN for gaps), or texts.
        faulty: files that the reader has to refuse.

    Raises:
        NotConformingError: it does not; the text says what was promised.

    """
    subject = f"reader `{reader.name}`"
    require(reader.name.isidentifier() and reader.name == reader.name.lower(), subject, "its name is a lower-case word")
    endings = all(e.startswith(".") and e == e.lower() and len(e) > 1 for e in reader.extensions)
    require(endings, subject, "its extensions are lower case and begin with a point")
    before = path.read_bytes()
    table = reader.read(path)
    _check_shape(table, subject)
    _check_columns(table, expected, subject)
    require(table.path == path.as_posix(), subject, "a table names the path as it was given")
    digest = hashlib.sha256(before).hexdigest()
    require(table.sha256 == digest, subject, "a table has the SHA-256 digest of the file's bytes")
    _check_columns(reader.read(path), expected, f"{subject}, reading again")
    require(path.read_bytes() == before, subject, "it leaves the file as it is")
    with tempfile.TemporaryDirectory() as folder:
        _check_refusals(reader, Path(folder), path.suffix, subject)
    for each in faulty:
        require(_refused(reader, each, subject), subject, f"it refuses {each.name}")


def _check_shape(table: RawTable, subject: str) -> None:
    names = [column.name for column in table.columns]
    require(bool(names), subject, "a table has columns")
    require(len(set(names)) == len(names) and all(names), subject, "columns have names, each its own")
    rows = table.file_rows
    require(rows.dtype == np.int64 and rows.ndim == 1, subject, "`file_rows` are int64, shape (rows,)")
    require(bool((rows >= 1).all() and (np.diff(rows) > 0).all()), subject, "`file_rows` ascend, from 1 on")
    for column in table.columns:
        which = f"{subject}, column `{column.name}`"
        require((column.numbers is None) != (column.texts is None), which, "it holds numbers or texts, not both")
        length = len(column.texts) if column.texts is not None else 0 if column.numbers is None else len(column.numbers)
        require(length == len(rows), which, f"it has {len(rows)} cells, one for each row")
        if column.numbers is not None:
            require(column.numbers.dtype == np.float64, which, "numbers are float64")
        require(column.unit is None, which, "a reader applies no unit")


def _check_columns(table: RawTable, expected: Mapping[str, Sequence[object]], subject: str) -> None:
    names = [column.name for column in table.columns]
    require(names == list(expected), subject, f"the columns are {list(expected)}, not {names}")
    for column in table.columns:
        which = f"{subject}, column `{column.name}`"
        cells = expected[column.name]
        if column.texts is not None:
            require(column.texts == tuple(cells), which, f"the texts are {tuple(cells)}, not {column.texts}")
        elif column.numbers is not None:
            require(not any(isinstance(cell, str) for cell in cells), which, "its cells are texts")
            wanted = np.asarray(cells, dtype=np.float64)
            require_close(column.numbers, wanted, 0.0, which, "numbers are those of the file, to the last digit")


def _check_refusals(reader: Reader, folder: Path, suffix: str, subject: str) -> None:
    require(_refused(reader, folder / f"missing{suffix}", subject), subject, "a file that is missing is refused")
    as_folder = folder / f"folder{suffix}"
    as_folder.mkdir()
    require(_refused(reader, as_folder, subject), subject, "a folder is refused")
    for number, content in enumerate(NOISE):
        path = folder / f"noise{number}{suffix}"
        path.write_bytes(content)
        refused = _refused(reader, path, subject)
        require(refused or content != b"", subject, "an empty file is refused")


def _refused(reader: Reader, path: Path, subject: str) -> bool:
    """Whether reading ends with a diagnostic that names the file; a table is no refusal, but has to be a whole one."""
    try:
        table = reader.read(path)
    except MbmError as error:
        require(bool(error.diagnostics), subject, "an error has diagnostics")
        places = [d.place.file for d in error.diagnostics if isinstance(d.place, DataPlace)]
        require(path.as_posix() in places, subject, f"an error names the file: {path.name} in {places}")
        return True
    except Exception as error:  # noqa: BLE001 - whatever else a reader raises is what this looks for
        require(kept=False, subject=subject, promise=f"it raises MbmError and nothing else, not {error!r}")
    else:
        _check_shape(table, subject)
    return False
