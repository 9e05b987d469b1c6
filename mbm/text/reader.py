"""Characters → forms."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from mbm.text import faults
from mbm.text.atoms import atom, span_of, token_faults
from mbm.text.characters import check_characters
from mbm.text.comments import Comment, blank_blocks, find_comments
from mbm.text.structure import nesting_faults
from mbm.text.types import Bracket, Diagnostic, Form, MbmError, Sequence, Source, Span, Symbol

if TYPE_CHECKING:
    from lark import Lark, Token, Tree

MOST_COUNTED = 10_000
"""Faulty words that are looked at."""

_QUOTES = {"QUOTE": "quote", "QUASIQUOTE": "quasiquote", "UNQUOTE": "unquote", "UNQUOTE_SPLICING": "unquote-splicing"}


def read(source: Source) -> tuple[Form, ...]:
    """The top-level forms of a text.

    Raises ``MbmError`` with all syntax errors of the text, in the order of their places.
    """
    check_characters(source)
    comments = find_comments(source) if "#|" in source.text else ()
    text = blank_blocks(source, comments) if comments else source.text
    tokens = tokenize(text)
    found = _faults(tokens, comments, source)
    if found:
        raise MbmError(*found)
    return _forms(tokens, source)


def _faults(tokens: tuple[Token, ...], comments: tuple[Comment, ...], source: Source) -> tuple[Diagnostic, ...]:
    found = list(islice((fault for token in tokens for fault in token_faults(token, source)), MOST_COUNTED))
    open_string = bool(tokens) and tokens[-1].type == "OPEN_STRING"
    open_comment = bool(comments) and not comments[-1].closed
    if open_string:
        found.append(_open_string_fault(tokens, source))
    if open_comment:
        start = comments[-1].span.start
        found.append(faults.unterminated_comment(Span(source=source, start=start, end=start + 2)))
    found.extend(nesting_faults(tokens, source, cut_off=open_string or open_comment))
    found.sort(key=_start)
    return faults.worth_reading(found, ended=len(found) >= MOST_COUNTED)


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


def grammar_text() -> str:
    """The grammar as text: that of an installed package, else that of the checkout.

    Raises ``FileNotFoundError`` if the installation holds neither.
    """
    shipped = Path(__file__).parents[1] / "grammar" / "mbm.lark"
    in_checkout = Path(__file__).parents[2] / "grammar" / "mbm.lark"
    return (shipped if shipped.is_file() else in_checkout).read_text(encoding="utf-8")


def tokenize(text: str) -> tuple[Token, ...]:
    """The tokens of a text, comments and white space left out. Every text has some: faulty words are tokens too."""
    return tuple(_parser().lex(text))


def parse(tokens: Iterable[Token]) -> Tree[Token]:
    """The tree of tokens whose nesting is sound; its children are the top-level forms."""
    from lark import Token

    parsing = _parser().parse_interactive()
    for token in tokens:
        parsing.feed_token(token)
    tree: Tree[Token] = parsing.feed_token(Token("$END", ""))
    return tree


@cache
def _parser() -> Lark:
    from lark import Lark  # here, not above: a start-up that reads no file need not pay for it

    return Lark(grammar_text(), parser="lalr", lexer="basic", maybe_placeholders=False)
