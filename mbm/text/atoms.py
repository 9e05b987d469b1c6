"""Tokens → atoms: numbers kept exact, escapes resolved, names; and what is wrong with a single token."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import TYPE_CHECKING

from mbm.text import faults
from mbm.text.types import Diagnostic, Form, Keyword, Numeral, Source, Span, Symbol, Text

if TYPE_CHECKING:
    from lark import Token

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
