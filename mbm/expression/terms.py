"""Expressions with Python's operators: for formulas that mbm writes out itself."""

from __future__ import annotations

from collections.abc import Sequence

from mbm.expression.algebra import apply
from mbm.expression.nodes import Expression, Number, Operation
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """One number of a formula; plain numbers stand beside it as they are."""

    node: Expression

    def __add__(self, other: Term | float) -> Term:
        return _made(Operation.ADD, self, other)

    def __radd__(self, other: float) -> Term:
        return _made(Operation.ADD, other, self)

    def __sub__(self, other: Term | float) -> Term:
        return _made(Operation.SUBTRACT, self, other)

    def __rsub__(self, other: float) -> Term:
        return _made(Operation.SUBTRACT, other, self)

    def __mul__(self, other: Term | float) -> Term:
        return _made(Operation.MULTIPLY, self, other)

    def __rmul__(self, other: float) -> Term:
        return _made(Operation.MULTIPLY, other, self)

    def __truediv__(self, other: Term | float) -> Term:
        return _made(Operation.DIVIDE, self, other)

    def __rtruediv__(self, other: float) -> Term:
        return _made(Operation.DIVIDE, other, self)

    def __neg__(self) -> Term:
        return _made(Operation.NEGATE, self)

    def __lt__(self, other: Term | float) -> Term:
        return _made(Operation.LESS, self, other)

    def __gt__(self, other: Term | float) -> Term:
        return _made(Operation.LESS, other, self)

    def __and__(self, other: Term) -> Term:
        return _made(Operation.AND, self, other)

    def __invert__(self) -> Term:
        return _made(Operation.NOT, self)


def _node(value: Term | float) -> Expression:
    return value.node if isinstance(value, Term) else Number(value)


def _made(operation: Operation, *arguments: Term | float) -> Term:
    return Term(apply(operation, *map(_node, arguments)))


def function(operation: Operation, *arguments: Term | float) -> Term:
    """An elementary function of terms."""
    return _made(operation, *arguments)


def square_root(a: Term) -> Term:
    """√a."""
    return _made(Operation.SQRT, a)


def square(a: Term) -> Term:
    """a²."""
    return a * a


def held(a: Term) -> Term:
    """A number that counts as constant where derivatives are made."""
    return _made(Operation.HELD, a)


def chosen(condition: Term, then: Term | float, other: Term | float) -> Term:
    """``then`` where the condition holds, else ``other``; the one that is not chosen may have no finite value."""
    if isinstance(condition.node, Number):
        return Term(_node(then if condition.node.value else other))
    return _made(Operation.IF, condition, then, other)


def polynomial(coefficients: Sequence[float], x: Term) -> Term:
    """``c₀ + c₁ x + c₂ x² + …``, by Horner's rule."""
    result: Term | float = coefficients[-1]
    for each in reversed(coefficients[:-1]):
        result = each + x * result
    return x * 0 + result if isinstance(result, float | int) else result
