"""Texts in generated Python: strings, comments, docstrings. The only way that a `Foreign` gets there, but for names."""

from __future__ import annotations

from collections.abc import Iterable
from textwrap import wrap

from mbm.emit.foreign import Word, told
from mbm.machine.escaping import in_docstring

WIDTH = 116


def literal(*parts: Word) -> str:
    """A string of Python; what is not printable is written by its number."""
    return repr(told(*parts).unescaped)


def optional(text: Word | None) -> str:
    """A string of Python, or None."""
    return "None" if text is None else literal(text)


def remark(*parts: Word) -> str:
    """A comment to the end of the line."""
    return f"# {told(*parts).unescaped_line()}"


def docstring(lines: Iterable[Word]) -> list[str]:
    """The documentation of a function, long lines over several."""
    found: list[str] = []
    for text in (told(line).unescaped_line() for line in lines):
        indent = text[: len(text) - len(text.lstrip())]
        found += wrap(text, WIDTH - 4, subsequent_indent=indent + "    ", break_long_words=False) or [""]
    found = [in_docstring(line) for line in found]
    if len(found) == 1:
        return [f'    """{found[0]}"""']
    return [f'    """{found[0]}', *(f"    {line}".rstrip() for line in found[1:]), '    """']
