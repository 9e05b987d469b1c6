"""A document → JSON text that people can read too: short lists and dictionaries on one line, the others indented.

What is not printable is escaped: a terminal that shows the text does nothing, and a program reads the same.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from enum import Enum
from json.encoder import encode_basestring, encode_basestring_ascii
from math import isfinite
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

WIDEST_LINE = 100
"""Characters of a list or dictionary that is written on one line, its indentation not counted."""


_ATOMS = json.JSONEncoder(ensure_ascii=False, allow_nan=False)


def encode(value: object) -> str:
    """The JSON text of ``value`` with a line break at the end; floats with the digits that give them back.

    Raises ``ValueError`` for NaN and infinity, ``TypeError`` for values that JSON does not have.
    """
    return _lines(value, "") + "\n"


def to_bytes(text: str) -> bytes:
    """The text in UTF-8. What no UTF-8 can hold (bytes of odd file names) is escaped by ``encode`` already."""
    return text.encode("utf-8")


def plain(value: object) -> Any:
    """A value as JSON holds it: what is not finite is null."""
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, Mapping):
        return {str(name): plain(entry) for name, entry in value.items()}
    if isinstance(value, (tuple, list)):
        return [plain(entry) for entry in value]
    if isinstance(value, PurePath):
        return value.as_posix()
    if isinstance(value, float):
        return value if isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int, str)) else str(value)


def number(value: float | int | None) -> float | int | None:
    """A number as JSON holds it; None for NaN and infinity."""
    if value is None or isinstance(value, int):
        return value
    return float(value) if isfinite(value) else None


def numbers(values: NDArray[np.float64]) -> Any:
    """A number, or (nested) lists of numbers, by the shape of ``values``: None where they are not finite."""
    return objects(values).tolist()


def objects(values: NDArray[np.float64]) -> NDArray[Any]:
    """The numbers, None where they are not finite."""
    found: NDArray[Any] = np.asarray(values)
    known = np.isfinite(found)
    if not bool(known.all()):
        found = found.astype(object)
        found[~known] = None
    return found


def _text(value: str) -> str:
    """A text in its quotes; every character that is not printable as the escape for it."""
    if value.isprintable():  # as nearly all are
        return encode_basestring(value)
    return f'"{"".join(map(_escaped, encode_basestring(value)[1:-1]))}"'


def _escaped(character: str) -> str:
    return character if character.isprintable() else encode_basestring_ascii(character)[1:-1]


def _lines(value: object, indent: str) -> str:
    kind = type(value)
    if kind is float:  # nearly all of a long document, then texts, then tables
        text = repr(value)
        return _ATOMS.encode(value) if "n" in text else text  # inf and nan are refused there
    if kind is str:
        return _text(value)  # type: ignore[arg-type]
    if isinstance(value, dict | Mapping):
        return _table(value, indent) if value else "{}"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, list | Sequence):
        return _list(value, indent) if value else "[]"
    return _ATOMS.encode(value)


def _table(value: Mapping[object, object], indent: str) -> str:
    """The names with their entries."""
    inner = indent + "  "
    parts = [f"{_text(str(name))}: {_lines(entry, inner)}" for name, entry in value.items()]
    joined = ", ".join(parts)
    if len(joined) + 2 <= WIDEST_LINE and "\n" not in joined:
        return f"{{{joined}}}"
    return f"{{\n{inner}" + f",\n{inner}".join(parts) + f"\n{indent}}}"


def _list(value: Sequence[object], indent: str) -> str:
    """The entries; numbers of a long list fill lines."""
    inner = indent + "  "
    parts = [_lines(entry, inner) for entry in value]
    joined = ", ".join(parts)
    if len(joined) + 2 <= WIDEST_LINE and "\n" not in joined:
        return f"[{joined}]"
    of_numbers = all(part[0] not in '[{"' for part in parts)
    return f"[\n{inner}" + f",\n{inner}".join(_filled(parts) if of_numbers else parts) + f"\n{indent}]"


def _filled(parts: list[str]) -> list[str]:
    rows: list[str] = []
    row: list[str] = []
    length = 0
    for part in parts:
        if row and length + len(part) > WIDEST_LINE:
            rows.append(", ".join(row))
            row, length = [], 0
        row.append(part)
        length += len(part) + 2
    rows.append(", ".join(row))
    return rows
