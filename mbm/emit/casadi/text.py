"""Texts in JSON: the only way that a `Foreign` gets into the documents beside CasADi functions."""

from __future__ import annotations

import json

from mbm.emit.foreign import Foreign


def document(value: object, *, indent: int | None = None) -> str:
    """A document with a line break at its end; what is not printable is written by its number."""
    text = json.dumps(_plain(value), indent=indent, ensure_ascii=False)
    return "".join(c if c.isprintable() or c == "\n" else json.dumps(c)[1:-1] for c in text) + "\n"


def _plain(value: object) -> object:
    """The value with texts for what is foreign, names of members too."""
    if isinstance(value, Foreign):
        return value.unescaped
    if isinstance(value, dict):
        return {_plain(key): _plain(held) for key, held in value.items()}
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value
