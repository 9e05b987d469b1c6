"""A document → JSON text that people can read too: short lists and dictionaries on one line, the others indented."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from math import isfinite

WIDEST = 100
"""Characters of a list or dictionary that is written on one line, its indentation not counted."""


_ATOMS = json.JSONEncoder(ensure_ascii=False, allow_nan=False)


def encode(value: object) -> str:
    """The JSON text of ``value`` with a line break at the end; floats with the digits that give them back.

    Raises ``ValueError`` for NaN and infinity, ``TypeError`` for values that JSON does not have.
    """
    return _lines(value, "") + "\n"


def to_bytes(text: str) -> bytes:
    """The text in UTF-8; what no UTF-8 can hold (bytes of odd file names) becomes the JSON escape for it."""
    return text.encode("utf-8", errors="backslashreplace")


def _lines(value: object, indent: str) -> str:
    if isinstance(value, (float, int, str)):
        return _atom(value)
    inner = indent + "  "
    if isinstance(value, (dict, Mapping)) and value:
        parts = [f"{_atom(str(name))}: {_lines(entry, inner)}" for name, entry in value.items()]
        return _joined(parts, "{", "}", indent)
    if isinstance(value, (list, Sequence)) and value:
        parts = [_lines(entry, inner) for entry in value]
        return _joined(parts, "[", "]", indent)
    return _atom(value)


def _joined(parts: list[str], opening: str, closing: str, indent: str) -> str:
    """On one line if it fits and nothing inside is broken; numbers of a long list fill lines."""
    if sum(len(part) + 2 for part in parts) <= WIDEST and not any("\n" in part for part in parts):
        return f"{opening}{', '.join(parts)}{closing}"
    inner = indent + "  "
    of_numbers = opening == "[" and all(part[0] not in '[{"' for part in parts)
    rows = _filled(parts) if of_numbers else parts
    return f"{opening}\n{inner}" + f",\n{inner}".join(rows) + f"\n{indent}{closing}"


def _filled(parts: list[str]) -> list[str]:
    rows: list[str] = []
    row: list[str] = []
    length = 0
    for part in parts:
        if row and length + len(part) > WIDEST:
            rows.append(", ".join(row))
            row, length = [], 0
        row.append(part)
        length += len(part) + 2
    rows.append(", ".join(row))
    return rows


def _atom(value: object) -> str:
    if type(value) is float and isfinite(value):  # nearly all of a long document
        return repr(value)
    return _ATOMS.encode(value)
