"""Texts in READMEs: the only way that a `Foreign` gets into Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from mbm.emit.foreign import Word, told

_ACTIVE = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", **{sign: f"\\{sign}" for sign in "\\`*_[]|~$#"}})
_FIRST = re.compile(r"^(\d*)([-+=:.)])")
"""What makes a list, a heading or a definition of the paragraph that it begins."""


def prose(*parts: Word) -> str:
    """A text that is read as it stands: no markup, no HTML, one paragraph at most."""
    text = " ".join(told(*parts).unescaped_line().split())
    return _FIRST.sub(r"\1\\\2", text.translate(_ACTIVE))


def code(*parts: Word) -> str:
    """A text between backticks: one more than stand together anywhere in it."""
    text = told(*parts).unescaped_line()
    ticks = "`" * (_longest_run(text) + 1)
    pad = " " if not text.strip() or text[0] in "` " or text[-1] in "` " else ""
    return f"{ticks}{pad}{text}{pad}{ticks}"


def fenced(lines: Iterable[Word], language: str = "") -> Iterator[str]:
    """Lines of code, whatever stands in them."""
    text = [told(line).unescaped_line() for line in lines]
    fence = "`" * max(3, 1 + max(map(_longest_run, text), default=0))
    yield fence + language
    yield from text
    yield fence


def _longest_run(text: str) -> int:
    return max(map(len, re.findall("`+", text)), default=0)
