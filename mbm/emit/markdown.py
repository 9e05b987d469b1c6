"""Texts in READMEs: the only way that a `Foreign` gets into Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from mbm.emit.foreign import Word, told
from mbm.text.shown import one_line

_ENTITIES = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;"})
_ACTIVE = re.compile(r"[\\`*_\[\]|~$#]")
_FIRST = re.compile(r"^(\d*)([-+=:.)])")
"""What makes a list, a heading or a definition of the paragraph that it begins."""


def prose(*parts: Word) -> str:
    """A text that is read as it stands: no markup, no HTML, one paragraph at most."""
    text = " ".join(one_line(told(*parts).unescaped).split())
    return _FIRST.sub(r"\1\\\2", _ACTIVE.sub(r"\\\g<0>", text.translate(_ENTITIES)))


def code(*parts: Word) -> str:
    """A text between backticks: one more than stand together anywhere in it."""
    text = one_line(told(*parts).unescaped)
    ticks = "`" * (_longest_run(text) + 1)
    pad = " " if not text.strip() or text[0] in "` " or text[-1] in "` " else ""
    return f"{ticks}{pad}{text}{pad}{ticks}"


def fenced(lines: Iterable[Word], language: str = "") -> Iterator[str]:
    """Lines of code, whatever stands in them."""
    text = [one_line(told(line).unescaped) for line in lines]
    fence = "`" * max(3, 1 + max(map(_longest_run, text), default=0))
    yield fence + language
    yield from text
    yield fence


def _longest_run(text: str) -> int:
    return max(map(len, re.findall("`+", text)), default=0)
