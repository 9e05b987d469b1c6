"""What a text of a file or of a caller may consist of."""

from __future__ import annotations

import re
from itertools import islice

from mbm.text import faults
from mbm.text.types import MbmError, Source, Span

LARGEST_TEXT = 4 * 2**20
"""Characters of a text, bytes of a file: beyond it, measurements belong into data files."""


MOST_WORDS = 200_000
"""Names, numbers, texts, brackets and comments of a text: each takes some ten microseconds to be read."""

_WORD = re.compile(r"""[()\[\]'`,]|"[^"\\]*(?:\\.[^"\\]*)*"?|;[^\n]*|[^\s()\[\]"';`,]+""", re.DOTALL)


def words_in(text: str) -> int:
    """How many words there are, about: what stands in block comments counts too."""
    return sum(1 for _ in _WORD.finditer(text))


def check_characters(source: Source) -> None:
    """Refuse what is no text.

    Raises ``MbmError``: larger than ``LARGEST_TEXT``, more than ``MOST_WORDS``, a NUL character, half of a surrogate
    pair.
    """
    if len(source.text) > LARGEST_TEXT:
        raise MbmError(faults.text_too_large(source.name, LARGEST_TEXT))
    if len(source.text) > MOST_WORDS:
        beyond = next(islice(_WORD.finditer(source.text), MOST_WORDS, None), None)
        if beyond is not None:
            place = Span(source=source, start=beyond.start(), end=beyond.end())
            raise MbmError(faults.too_many_words(place, MOST_WORDS))
    nul = source.text.find("\0")
    if nul >= 0:
        raise MbmError(faults.not_text(source.name, "a NUL character", Span(source=source, start=nul, end=nul + 1)))
    try:
        source.text.encode("utf-8")
    except UnicodeEncodeError as error:
        at = Span(source=source, start=error.start, end=error.start + 1)
        raise MbmError(faults.not_text(source.name, "half of a surrogate pair", at)) from None
