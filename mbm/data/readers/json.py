"""JSON (RFC 8259): a list of objects, an object of arrays, or ``{"columns": […], "data": [[…], …]}`` as pandas has it.

``null``, ``NaN`` and a field left out are gaps. Strings are texts even if they read as numbers. Records count from 1.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from mbm.data import faults
from mbm.data.cells import check_names, column_from_values, columns_of_records, counted_table
from mbm.data.content import read_text
from mbm.data.readers import faults as format_faults
from mbm.data.types import RawTable, Reader
from mbm.files.json_text import MARKS, JsonError, parsed
from mbm.problem.tables import Column
from mbm.text.types import DataPlace, MbmError

HALF_CHARACTER = re.compile(r"\\u[dD][89a-fA-F]")
SPLIT_KEYS = frozenset({"columns", "data", "index"})


def read(path: Path) -> RawTable:
    """Read a JSON file.

    Raises MbmError as ``read_text`` does, and malformed-json, wrong-json-shape, no-columns, bad-column-name,
    duplicate-column, unequal-lengths, short-row, long-row.
    """
    text, digest = read_text(path, between=MARKS)
    shown = path.as_posix()
    content = _parse(text, shown)
    if isinstance(content, list):
        columns = _of_list(content, shown)
    elif isinstance(content, dict) and _is_split(content):
        columns = _of_split(content["columns"], content["data"], shown)
    elif isinstance(content, dict):
        columns = _of_arrays(content, shown)
    else:
        raise MbmError(format_faults.wrong_json_shape(DataPlace(file=shown), "it is a single value"))
    return counted_table(shown, digest, columns)


def _parse(text: str, path: str) -> object:
    """The values in the text. JSON itself lets a name occur twice in an object; a table does not."""
    try:
        found = parsed(text)
    except JsonError as error:
        place = DataPlace(file=path, row=error.line)
        raise MbmError(format_faults.malformed_json(place, error.reason, error.column)) from None
    if found.twice is not None:
        raise MbmError(faults.duplicate_column(DataPlace(file=path), found.twice))
    if HALF_CHARACTER.search(text) is not None:
        _check_characters(found.value, path)
    return found.value


def _check_characters(content: object, path: str) -> None:
    """Check that no escape of a surrogate (U+D800 to U+DFFF) stands without its other half: it is no text."""
    try:
        json.dumps(content, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        reason = "an escape `\\ud800` … `\\udfff` is half a character"
        raise MbmError(format_faults.malformed_json(DataPlace(file=path), reason)) from None


def _of_list(records: Sequence[object], path: str) -> tuple[Column, ...]:
    """The columns of ``[{"x": 1, …}, …]``."""
    objects = [record for record in records if isinstance(record, dict)]
    if len(objects) != len(records):
        row = next(row for row, record in enumerate(records, start=1) if not isinstance(record, dict))
        place = DataPlace(file=path, row=row)
        raise MbmError(format_faults.wrong_json_shape(place, f"item {row} of the list is not an object"))
    return columns_of_records(objects, path)


def _is_split(content: Mapping[str, object]) -> bool:
    data = content.get("data")
    return (
        "columns" in content
        and SPLIT_KEYS.issuperset(content)
        and isinstance(data, list)
        and all(isinstance(row, list) for row in data)
    )


def _of_split(header: object, data: Sequence[Sequence[object]], path: str) -> tuple[Column, ...]:
    """The columns of ``{"columns": ["x", …], "data": [[1, …], …]}``."""
    place = DataPlace(file=path)
    if not isinstance(header, list):
        raise MbmError(format_faults.wrong_json_shape(place, "`columns` is not an array of names"))
    names = check_names(header, place)
    for row, cells in enumerate(data, start=1):
        if len(cells) != len(names):
            fault = faults.short_row if len(cells) < len(names) else faults.long_row
            raise MbmError(fault(DataPlace(file=path, row=row), row, len(cells), names))
    return tuple(column_from_values(name, [row[i] for row in data], path) for i, name in enumerate(names))


def _of_arrays(content: Mapping[str, object], path: str) -> tuple[Column, ...]:
    """The columns of ``{"x": [1, …], …}``."""
    names = check_names(list(content), DataPlace(file=path))
    columns = []
    for name in names:
        values = content[name]
        if not isinstance(values, list):
            place = DataPlace(file=path, column=name)
            raise MbmError(format_faults.wrong_json_shape(place, f"`{name}` is not an array"))
        columns.append(column_from_values(name, values, path))
    return tuple(columns)


READER = Reader(name="json", extensions=(".json",), read=read)
