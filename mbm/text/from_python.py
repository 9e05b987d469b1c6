"""Python values → forms, for problems that are built without text."""

from __future__ import annotations

from fractions import Fraction
from math import isfinite

from mbm.text import faults
from mbm.text.types import Bracket, Form, Keyword, MbmError, Numeral, Sequence, Source, Span, Symbol, Text


def _span(text: str) -> Span:
    if not isinstance(text, str):
        raise TypeError(f"a name is a text (`str`), not a value of type {type(text).__name__}")
    return Span(source=Source("<python>", text), start=0, end=len(text))


def symbol(name: str) -> Symbol:
    """A name."""
    return Symbol(name=name, span=_span(name))


def keyword(name: str) -> Keyword:
    """An option name such as ``:sigma``, given without its colon."""
    return Keyword(name=name, span=_span(f":{name}"))


def from_python(value: object, deepest: int) -> Form:
    """Tuples → lists, lists and arrays → vectors, strings → texts, numbers → numerals; forms stay what they are.

    Args:
        value: what is made a form; NumPy's numbers and arrays are those of Python.
        deepest: levels of tuples and lists that may stand in one another.

    Raises:
        MbmError: there are more levels (`too-deeply-nested`), or a number is not finite (`bad-number`).
        TypeError: a value of another kind.

    """
    return _form(value, deepest, 0)


def _form(value: object, deepest: int, level: int) -> Form:
    if isinstance(value, Symbol | Keyword | Text | Numeral | Sequence):
        return value
    if isinstance(value, bool):
        return symbol("true" if value else "false")
    if isinstance(value, float) and not isfinite(value):
        raise MbmError(faults.no_finite_number(_span(str(value))))
    if isinstance(value, int | float | Fraction) and type(value).__module__ != "numpy":
        return Numeral(value=value, unit=None, span=_span(str(value)))
    if isinstance(value, str):
        return Text(value=str(value), span=_span(value))
    if isinstance(value, tuple | list):
        if level == deepest:
            raise MbmError(faults.too_deeply_nested(_span(""), deepest))
        bracket = Bracket.ROUND if isinstance(value, tuple) else Bracket.SQUARE
        items = tuple(_form(each, deepest, level + 1) for each in value)
        return Sequence(items=items, bracket=bracket, span=_span(""))
    if type(value).__module__ == "numpy" and callable(as_python := getattr(value, "tolist", None)):
        return _form(as_python(), deepest, level)
    raise TypeError(f"a value of type {type(value).__name__} is no form")
