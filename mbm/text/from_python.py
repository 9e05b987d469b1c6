"""Python values → forms, for problems that are built without text."""

from __future__ import annotations

from fractions import Fraction

from mbm.text.types import Bracket, Form, Keyword, Numeral, Sequence, Source, Span, Symbol, Text


def _span(text: str) -> Span:
    return Span(source=Source("<python>", text), start=0, end=len(text))


def symbol(name: str) -> Symbol:
    """A name."""
    return Symbol(name=name, span=_span(name))


def keyword(name: str) -> Keyword:
    """An option name such as ``:sigma``, given without its colon."""
    return Keyword(name=name, span=_span(f":{name}"))


def from_python(value: object) -> Form:
    """Tuples → lists, lists → vectors, strings → texts, numbers → numerals; forms stay what they are.

    Raises:
        TypeError: a value of another kind.

    """
    if isinstance(value, Symbol | Keyword | Text | Numeral | Sequence):
        return value
    if isinstance(value, bool):
        return symbol("true" if value else "false")
    if isinstance(value, int | float | Fraction):
        return Numeral(value=value, unit=None, span=_span(str(value)))
    if isinstance(value, str):
        return Text(value=value, span=_span(value))
    if isinstance(value, tuple | list):
        bracket = Bracket.ROUND if isinstance(value, tuple) else Bracket.SQUARE
        return Sequence(items=tuple(from_python(v) for v in value), bracket=bracket, span=_span(""))
    raise TypeError(f"a value of type {type(value).__name__} is no form")
