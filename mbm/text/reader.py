"""Characters → forms; tokens → what is wrong with their nesting: brackets, quotes, depth. Tokens → atoms: numbers kept
exact, escapes resolved, names; and what is wrong with a single token.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import field
from fractions import Fraction
from functools import cache
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from mbm.text import faults
from mbm.text.characters import check_characters
from mbm.text.comments import Comment, blank_blocks, find_comments
from mbm.text.types import Bracket, Diagnostic, Form, Keyword, MbmError, Numeral, Sequence, Source, Span, Symbol, Text
from mbm.values import dataclass

if TYPE_CHECKING:
    from lark import Lark, Token, Tree

LONGEST_NUMBER = 400
"""Characters of a number: more digits than any double has, before its exponent is out of range."""

_NUMBER = re.compile(r"(?P<number>[+-]?(?:[0-9]+/[0-9]+|[0-9.]+(?:[eE][+-]?[0-9]+)?))(?P<unit>.*)", re.DOTALL)
_SEXAGESIMAL = re.compile(r"(?P<sign>[+-]?)(?P<d>[0-9]+)d(?P<m>[0-9]+)m(?:(?P<s>[0-9]+(?:\.[0-9]*)?)s)?")
_ESCAPE = re.compile(r"\\(.)", re.DOTALL)
_ESCAPED = {'"': '"', "\\": "\\", "n": "\n", "t": "\t"}
_STARTS_NUMBER = re.compile(r"[+-]?\.?[0-9]")
_OUTSIDE_NAMES = re.compile(r"[^\w\-+*/<>=!?.%^&@]")


def span_of(token: Token, source: Source) -> Span:
    """Where a token stands."""
    return Span(source=source, start=token.start_pos or 0, end=token.end_pos or 0)


def atom(token: Token, source: Source) -> Form:
    """The atom that a faultless token denotes."""
    span = span_of(token, source)
    match token.type:
        case "NUMBER":
            angle = _SEXAGESIMAL.fullmatch(token)
            if angle is not None:
                return Numeral(value=_degrees(angle), unit="deg", span=span)
            number, unit = _parts(token)
            return Numeral(value=_value(number), unit=unit or None, span=span)
        case "STRING":
            return Text(value=_ESCAPE.sub(lambda found: _ESCAPED[found[1]], token[1:-1]), span=span)
        case "KEYWORD":
            return Keyword(name=str(token[1:]), span=span)
        case _:
            return Symbol(name=str(token), span=span)


def token_faults(token: Token, source: Source) -> Iterator[Diagnostic]:
    """What is wrong with a token by itself."""
    check = _CHECKS.get(token.type)
    if check is not None:
        yield from check(token, source)


def _parts(token: Token) -> tuple[str, str]:
    match = _NUMBER.fullmatch(token)
    return (str(token), "") if match is None else (match["number"], match["unit"])


def _value(number: str) -> int | Fraction | float:
    if "/" in number:
        fraction = Fraction(number)
        return fraction.numerator if fraction.denominator == 1 else fraction
    if any(sign in number for sign in ".eE"):
        return float(number)
    return int(number)


def _degrees(angle: re.Match[str]) -> int | Fraction:
    """The angle ``12d30m15.5s`` in degrees, exactly."""
    size = int(angle["d"]) + Fraction(int(angle["m"]), 60) + Fraction(angle["s"] or "0") / 3600
    value = -size if angle["sign"] == "-" else size
    return value.numerator if value.denominator == 1 else value


def _number_faults(token: Token, source: Source) -> Iterator[Diagnostic]:
    number, _unit = _parts(token)
    span = span_of(token, source)
    if len(number) > LONGEST_NUMBER or (len(token) > LONGEST_NUMBER and _SEXAGESIMAL.fullmatch(token)):
        yield faults.number_out_of_range(span, f"has more than {LONGEST_NUMBER} digits")
        return
    angle = _SEXAGESIMAL.fullmatch(token[:LONGEST_NUMBER])
    if angle is not None and max(int(angle["m"]), float(angle["s"] or 0)) >= 60:
        yield faults.sixty_minutes(span)
        return
    if re.search(r"/0+\Z", number):
        yield faults.zero_denominator(span)
        return
    value = _value(number)
    try:
        size = float(value)
    except OverflowError:
        size = math.inf
    if math.isinf(size):
        yield faults.number_out_of_range(span, "is too large")
    elif size == 0 and isinstance(value, float) and re.search(r"[1-9]", re.split("[eE]", number)[0]):
        yield faults.number_out_of_range(span, "is too close to zero")


def _string_faults(token: Token, source: Source) -> Iterator[Diagnostic]:
    start = token.start_pos or 0
    for match in _ESCAPE.finditer(token, 1, len(token) - 1):
        if match[1] not in _ESCAPED:
            yield faults.unknown_escape(Span(source=source, start=start + match.start(), end=start + match.end()))


def _word_faults(token: Token, source: Source) -> Iterator[Diagnostic]:
    span = span_of(token, source)
    if _STARTS_NUMBER.match(token):
        yield faults.bad_number(span)
        return
    stray = _OUTSIDE_NAMES.search(token)
    if stray is not None and stray.start() == 0 and token[0] == ":":
        stray = _OUTSIDE_NAMES.search(token, 1)
        if stray is None:
            yield faults.empty_keyword(span)
            return
    first = span.start + (0 if stray is None else stray.start())
    yield faults.stray_character(Span(source=source, start=first, end=first + 1))


def _colon_faults(token: Token, source: Source) -> Iterator[Diagnostic]:
    yield faults.empty_keyword(span_of(token, source))


_CHECKS: dict[str, Callable[[Token, Source], Iterator[Diagnostic]]] = {
    "NUMBER": _number_faults,
    "STRING": _string_faults,
    "BAD_WORD": _word_faults,
    "BARE_COLON": _colon_faults,
}


DEEPEST = 200
"""Levels of brackets and quotes that the reader follows."""

_OPENING = {"OPEN_ROUND": "CLOSE_ROUND", "OPEN_SQUARE": "CLOSE_SQUARE"}
_CLOSING = frozenset(_OPENING.values())
_PREFIXES = {"QUOTE": 0, "QUASIQUOTE": 1, "UNQUOTE": -1, "UNQUOTE_SPLICING": -1}


def nesting_faults(tokens: Iterable[Token], source: Source, *, cut_off: bool) -> tuple[Diagnostic, ...]:
    """Every independent fault of nesting, in order.

    If brackets stay open, the text is judged again under the assumption that a bracket in column 1 starts a new
    top-level form, so that one forgotten bracket does not hide what is wrong further down. ``cut_off`` says that
    the text ends inside a string or comment, which has swallowed closing brackets: open ones are then no fault.
    """
    tokens = tuple(tokens)
    walk = _Walk(source=source)
    walk.run(tokens)
    if walk.open and not walk.stopped and not cut_off:
        walk = _Walk(source=source, restarts=True)
        walk.run(tokens)
        walk.report_unclosed(None)
    return tuple(walk.found)


@dataclass(slots=True, kw_only=True)
class _Opened:
    """An open bracket: its token, the quasi-quotation level and depth of its items, the prefixes waiting for a form."""

    token: Token | None
    level: int
    depth: int
    prefixes: list[Token] = field(default_factory=list)


@dataclass(slots=True, kw_only=True)
class _Walk:
    """One pass over the tokens; ``restarts``: a bracket in column 1 starts anew."""

    source: Source
    restarts: bool = False
    found: list[Diagnostic] = field(default_factory=list)
    open: list[_Opened] = field(default_factory=list)
    top: _Opened = field(default_factory=lambda: _Opened(token=None, level=0, depth=0))
    suspect: tuple[int, _Opened, Token] | None = None  # number of open brackets, the innermost, a token left of it
    silent: bool = False  # this top-level form has had its fault: what follows from it is not reported
    stopped: bool = False
    line: int = 0

    def run(self, tokens: tuple[Token, ...]) -> None:
        """Takes all tokens, or those up to the first that is nested too deeply."""
        for token in tokens:
            first_on_line, self.line = token.line != self.line, token.line or 0
            if token.type in _OPENING and token.column == 1 and (self.restarts or not self.open):
                self._restart(token)
            if token.type in _CLOSING:
                self._close(token)
            else:
                if first_on_line:
                    self._note_layout(token)
                self._take(token)
            if self.stopped:
                return
        self._need_form()

    def report_unclosed(self, noticed: Token | None) -> None:
        """Blames the brackets open now on one of them; ``noticed`` is the top-level form that begins too early."""
        if self.open and not self.silent:
            culprit, place = self.open[-1], noticed
            if self.suspect is not None:
                _count, culprit, place = self.suspect
            if culprit.token is not None:
                where = None if place is None else span_of(place, self.source)
                opening = span_of(culprit.token, self.source)
                self.found.append(faults.unclosed_bracket(opening, where, len(self.open) - 1))
        self.open.clear()
        self.suspect, self.silent = None, False

    def _inner(self) -> _Opened:
        return self.open[-1] if self.open else self.top

    def _restart(self, token: Token) -> None:
        if self.open:
            self._need_form()
        self.report_unclosed(token)

    def _note_layout(self, token: Token) -> None:
        """What begins a line not right of the innermost open bracket suggests that this one should be closed."""
        if self.suspect is None and self.open:
            opened = self.open[-1]
            if opened.token is not None and (token.column or 0) <= (opened.token.column or 0):
                self.suspect = (len(self.open), opened, token)

    def _take(self, token: Token) -> None:
        inner = self._inner()
        level = inner.level + sum(_PREFIXES[prefix.type] for prefix in inner.prefixes)
        depth = inner.depth + len(inner.prefixes) + 1
        if token.type in _PREFIXES:
            if _PREFIXES[token.type] < 0 and level <= 0:
                self.found.append(faults.unexpected_comma(span_of(token, self.source)))
                return
            inner.prefixes.append(token)
        elif token.type in _OPENING:
            inner.prefixes.clear()
            self.open.append(_Opened(token=token, level=level, depth=depth))
        else:
            inner.prefixes.clear()
            return
        if depth > DEEPEST:
            self.found.append(faults.too_deeply_nested(span_of(token, self.source), DEEPEST))
            self.stopped = True

    def _close(self, token: Token) -> None:
        self._need_form()
        if not self.open:
            if not self.silent:
                self.found.append(faults.surplus_bracket(span_of(token, self.source)))
            self.silent = True
            return
        opened = self.open.pop()
        if opened.token is not None and _OPENING[opened.token.type] != token.type and not self.silent:
            closing, opening = span_of(token, self.source), span_of(opened.token, self.source)
            self.found.append(faults.mismatched_bracket(closing, opening))
            self.silent = True
        if self.suspect is not None and len(self.open) < max(self.suspect[0] - 1, 1):
            self.suspect = None  # what encloses it was closed after all: the layout was only unusual

    def _need_form(self) -> None:
        inner = self._inner()
        if inner.prefixes:
            self.found.append(faults.nothing_to_quote(span_of(inner.prefixes[-1], self.source)))
            inner.prefixes.clear()


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
