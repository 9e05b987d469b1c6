"""What a text of a file or of a caller may consist of."""

from __future__ import annotations

from mbm.text import faults
from mbm.text.types import MbmError, Source, Span

LARGEST_TEXT = 4 * 2**20
"""Characters of a text, bytes of a file: beyond it, measurements belong into data files."""


def check_characters(source: Source) -> None:
    """Refuse what is no text.

    Raises ``MbmError``: larger than ``LARGEST_TEXT``, a NUL character, half of a surrogate pair.
    """
    if len(source.text) > LARGEST_TEXT:
        raise MbmError(faults.text_too_large(source.name, LARGEST_TEXT))
    nul = source.text.find("\0")
    if nul >= 0:
        raise MbmError(faults.not_text(source.name, "a NUL character", Span(source=source, start=nul, end=nul + 1)))
    try:
        source.text.encode("utf-8")
    except UnicodeEncodeError as error:
        at = Span(source=source, start=error.start, end=error.start + 1)
        raise MbmError(faults.not_text(source.name, "half of a surrogate pair", at)) from None
