"""Steps of Newton's method that stay between two bounds."""

from __future__ import annotations

from fractions import Fraction

from mbm.expression.algebra import add, multiply
from mbm.expression.dimension import NONE
from mbm.expression.nodes import Expression, Number
from mbm.language.piecewise import chosen, equal, less
from mbm.text.types import Span
from mbm.values import dataclass

_HALF = Number(Fraction(1, 2), NONE)


def middle(a: Expression, b: Expression, span: Span) -> Expression:
    """(a + b)/2."""
    return multiply(_HALF, add(a, b, span), span)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bracket:
    """Between ``low`` and ``high`` lies what is looked for; it began with ``ends``."""

    low: Expression
    high: Expression
    ends: tuple[Expression, Expression]
    span: Span

    @classmethod
    def of(cls, low: Expression, high: Expression, span: Span) -> Bracket:
        """The bracket at the beginning."""
        return cls(low=low, high=high, ends=(low, high), span=span)

    def narrowed(self, at: Expression, right: Expression) -> Bracket:
        """What is left of it where ``right`` says whether what is looked for lies right of ``at``."""
        low, high = chosen(right, at, self.low, self.span), chosen(right, self.high, at, self.span)
        return Bracket(low=low, high=high, ends=self.ends, span=self.span)

    def left(self, number: int) -> Expression:
        """Where a step goes that would leave it on the left: half the way, every other time to the end itself.

        An end may be what is looked for. Steps are counted by ``number`` from 0.
        """
        return self._outside(self.low, self.ends[0], number)

    def right(self, number: int) -> Expression:
        """The same on the right."""
        return self._outside(self.high, self.ends[1], number)

    def kept(self, step: Expression, number: int) -> Expression:
        """Where a step leads."""
        found = chosen(less(self.high, step, self.span), self.right(number), step, self.span)
        return chosen(less(step, self.low, self.span), self.left(number), found, self.span)

    def _outside(self, bound: Expression, end: Expression, number: int) -> Expression:
        half = middle(self.low, self.high, self.span)
        return half if number % 2 else chosen(equal(bound, end, self.span), end, half, self.span)
