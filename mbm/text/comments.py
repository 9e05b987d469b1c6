"""Text → its comments, and the text with its block comments blanked."""

from __future__ import annotations

import re

from mbm.text.types import Source, Span
from mbm.values import dataclass

_OUTSIDE = re.compile(r'"[^"\\]*(?:\\.[^"\\]*)*(?:"|\\?\Z)|;[^\n]*|#\|', re.DOTALL)
_INSIDE = re.compile(r"#\||\|#")


@dataclass(frozen=True, slots=True, kw_only=True)
class Comment:
    """``; …`` to the end of the line, or ``#| … |#``; ``closed`` is false for a block that the text ends in."""

    span: Span
    block: bool
    closed: bool = True


def find_comments(source: Source) -> tuple[Comment, ...]:
    """All comments in order; of nested block comments the outermost."""
    found: list[Comment] = []
    text = source.text
    position = 0
    while match := _OUTSIDE.search(text, position):
        position = match.end()
        if match[0] == "#|":
            end = _end_of_block(text, position)
            position = len(text) if end is None else end
            span = Span(source=source, start=match.start(), end=position)
            found.append(Comment(span=span, block=True, closed=end is not None))
        elif match[0][0] == ";":
            span = Span(source=source, start=match.start(), end=match.start() + len(match[0].rstrip()))
            found.append(Comment(span=span, block=False))
    return tuple(found)


def blank_blocks(source: Source, comments: tuple[Comment, ...]) -> str:
    """The text with every block comment replaced by as many spaces, line breaks kept, so that places stay the same."""
    pieces: list[str] = []
    done = 0
    for comment in comments:
        if comment.block:
            pieces.append(source.text[done : comment.span.start])
            pieces.append(re.sub(r"[^\n]", " ", comment.span.text))
            done = comment.span.end
    pieces.append(source.text[done:])
    return "".join(pieces)


def _end_of_block(text: str, position: int) -> int | None:
    depth = 1
    for match in _INSIDE.finditer(text, position):
        depth += 1 if match[0] == "#|" else -1
        if depth == 0:
            return match.end()
    return None
