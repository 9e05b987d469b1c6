"""Makes forms that no text was read for: what later stages build in place of what the user wrote."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction

from mbm.text.types import Bracket, Form, Numeral, Sequence, Span, Symbol, Text


def symbol(name: str, span: Span) -> Symbol:
    """The name ``name``, blamed on ``span``."""
    return Symbol(name=name, span=span)


def text(value: str, span: Span) -> Text:
    """A string literal of the characters ``value``."""
    return Text(value=value, span=span)


def numeral(value: int | Fraction | float, span: Span, unit: str | None = None) -> Numeral:
    """A number; ``unit`` is unit text such as ``m/s``, not looked up."""
    return Numeral(value=value, unit=unit, span=span)


def sequence(items: Iterable[Form], span: Span, bracket: Bracket = Bracket.ROUND) -> Sequence:
    """The list of ``items``; with ``Bracket.SQUARE`` the literal vector."""
    return Sequence(items=tuple(items), bracket=bracket, span=span)


def call(head: str, arguments: Iterable[Form], span: Span) -> Sequence:
    """The list ``(head argument…)``; its head is blamed on the same span."""
    return sequence((symbol(head, span), *arguments), span)
