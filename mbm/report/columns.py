"""Texts → columns of a plain table: padding, points below one another, colour that does not count as width."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence

_WHOLE_PART = r"\(?[+-]?[0-9]+"


def aligned(texts: Sequence[str]) -> list[str]:
    """Numbers as texts, padded to one width so that their decimal points stand below one another."""
    whole = [_whole_width(text) for text in texts]
    before = max(whole, default=0)
    padded = [" " * (before - width) + text for text, width in zip(texts, whole, strict=True)]
    after = max(map(len, padded), default=0)
    return [text.ljust(after) for text in padded]


def left(texts: Iterable[str]) -> list[str]:
    """Texts padded on the right to one width."""
    items = list(texts)
    width = max(map(len, items), default=0)
    return [text.ljust(width) for text in items]


def right(texts: Iterable[str]) -> list[str]:
    """Texts padded on the left to one width."""
    items = list(texts)
    width = max(map(len, items), default=0)
    return [text.rjust(width) for text in items]


def wrapped(text: str, width: int) -> list[str]:
    """A sentence on lines of at most ``width`` columns, the later ones indented; one empty line for no text."""
    return textwrap.wrap(text, width, subsequent_indent="    ", break_on_hyphens=False) or [""]


def _whole_width(text: str) -> int:
    """Columns before the decimal point, or before where it would stand."""
    match = re.match(_WHOLE_PART, text)
    return len(text) if match is None else match.end()
