"""Characters → forms: ``read`` for a text, ``read_file`` for the text of a file."""

from __future__ import annotations

import codecs
from pathlib import Path
from typing import TYPE_CHECKING

from mbm.text import faults
from mbm.text.atoms import atom, span_of, token_faults
from mbm.text.comments import Comment, blank_blocks, find_comments
from mbm.text.grammar import parse, tokenize
from mbm.text.structure import nesting_faults
from mbm.text.types import (
    Bracket,
    DataPlace,
    Diagnostic,
    Form,
    MbmError,
    Place,
    Sequence,
    Source,
    Span,
    Symbol,
)

if TYPE_CHECKING:
    from lark import Token, Tree

LARGEST_TEXT = 4 * 2**20
"""Characters of a text, bytes of a file: beyond it, measurements belong into data files."""

MOST_FAULTS = 30
"""Diagnostics of one text that are worth a reader's time."""

_QUOTES = {"QUOTE": "quote", "QUASIQUOTE": "quasiquote", "UNQUOTE": "unquote", "UNQUOTE_SPLICING": "unquote-splicing"}


def read(source: Source) -> tuple[Form, ...]:
    """The top-level forms of a text.

    Raises ``MbmError`` with all syntax errors of the text, in the order of their places.
    """
    _check_characters(source)
    comments = find_comments(source) if "#|" in source.text else ()
    text = blank_blocks(source, comments) if comments else source.text
    tokens = tokenize(text)
    found = _faults(tokens, comments, source)
    if found:
        raise MbmError(*found)
    return _forms(tokens, source)


def read_file(path: Path, name: str, asked: Place | None = None) -> Source:
    """The text of a UTF-8 file; a byte order mark is dropped and every line break becomes a line feed.

    ``name`` is what messages print; ``asked`` is the place that names the file (a ``use`` form), if there is one.
    Raises ``MbmError``: no such file, a directory, unreadable, no UTF-8 text, larger than ``LARGEST_TEXT``.
    """
    place = DataPlace(file=name) if asked is None else asked
    try:
        with path.open("rb") as stream:
            data = stream.read(LARGEST_TEXT + 1)
    except (FileNotFoundError, NotADirectoryError):
        raise MbmError(faults.missing_file(path, place)) from None
    except IsADirectoryError:
        raise MbmError(faults.not_a_file(path, place)) from None
    except OSError as error:
        raise MbmError(faults.unreadable_file(path, error.strerror or type(error).__name__, place)) from None
    except ValueError:  # a path with a NUL character
        raise MbmError(faults.unreadable_file(path, "no file can have this name", place)) from None
    if len(data) > LARGEST_TEXT:
        raise MbmError(faults.text_too_large(name, LARGEST_TEXT, asked))
    data = data.removeprefix(codecs.BOM_UTF8)
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        readable = Source(name, data[: error.start].decode("utf-8"))
        at = Span(source=readable, start=len(readable.text), end=len(readable.text))
        raise MbmError(faults.not_text(name, f"the byte 0x{data[error.start]:02x}", at)) from None
    source = Source(name, text.replace("\r\n", "\n").replace("\r", "\n"))
    _check_characters(source)
    return source


def _check_characters(source: Source) -> None:
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


def _faults(tokens: tuple[Token, ...], comments: tuple[Comment, ...], source: Source) -> list[Diagnostic]:
    found = [fault for token in tokens for fault in token_faults(token, source)]
    open_string = bool(tokens) and tokens[-1].type == "OPEN_STRING"
    open_comment = bool(comments) and not comments[-1].closed
    if open_string:
        found.append(_open_string_fault(tokens, source))
    if open_comment:
        start = comments[-1].span.start
        found.append(faults.unterminated_comment(Span(source=source, start=start, end=start + 2)))
    found.extend(nesting_faults(tokens, source, cut_off=open_string or open_comment))
    found.sort(key=_start)
    if len(found) > MOST_FAULTS:
        rest = faults.more_faults(len(found) - MOST_FAULTS, found[MOST_FAULTS].place)
        found[MOST_FAULTS:] = [rest]
    return found


def _start(diagnostic: Diagnostic) -> int:
    return diagnostic.place.start if isinstance(diagnostic.place, Span) else 0


def _open_string_fault(tokens: tuple[Token, ...], source: Source) -> Diagnostic:
    opening = tokens[-1].start_pos or 0
    several_lines = next((token for token in tokens if token.type == "STRING" and "\n" in token), None)
    earlier = None if several_lines is None else span_of(several_lines, source)
    return faults.unterminated_string(Span(source=source, start=opening, end=opening + 1), earlier)


def _forms(tokens: tuple[Token, ...], source: Source) -> tuple[Form, ...]:
    return tuple(_form(child, source) for child in parse(tokens).children)


def _form(node: Tree[Token] | Token, source: Source) -> Form:
    """The form of a tree; recursive, for the nesting has been found to be within bounds."""
    if isinstance(node, str):
        return atom(node, source)
    first = node.children[0]
    if not isinstance(first, str):
        return _form(first, source)
    opening = span_of(first, source)
    if node.data == "quoted":
        quoted = _form(node.children[1], source)
        span = Span(source=source, start=opening.start, end=quoted.span.end)
        head = Symbol(name=_QUOTES[first.type], span=opening)
        return Sequence(items=(head, quoted), bracket=Bracket.ROUND, span=span)
    closing = node.children[-1]
    end = closing.end_pos if isinstance(closing, str) else None
    return Sequence(
        items=tuple(_form(child, source) for child in node.children[1:-1]),
        bracket=Bracket.ROUND if first.type == "OPEN_ROUND" else Bracket.SQUARE,
        span=Span(source=source, start=opening.start, end=end or opening.end),
    )
