"""Expressions with others in the place of leaves, and their derivatives with respect to one leaf."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

from mbm.expression.algebra import ONE, TWO, UndefinedValueError, add, apply, divide, multiply, negate, subtract
from mbm.expression.nodes import CONDITIONS, Apply, Expression, Leaf, Number, Operation, postorder
from mbm.text.types import Span
from mbm.values import dataclass


def substituted(roots: tuple[Expression, ...], values: Mapping[Leaf, Expression]) -> tuple[Expression, ...]:
    """``roots`` with ``values`` in the place of their keys; what holds no key stays the same node.

    Raises:
        UndefinedValueError: constants that now meet lie outside an operation's domain.

    """
    return _rebuilt(roots, depending(roots, frozenset(values)), values)


@dataclass(frozen=True, slots=True, eq=False)
class Formula:
    """Expressions in one ``leaf``, to be had at many values of it; ``steps`` are the operations that depend on it."""

    roots: tuple[Expression, ...]
    leaf: Leaf
    steps: tuple[Apply, ...]

    @classmethod
    def of(cls, roots: tuple[Expression, ...], leaf: Leaf) -> Formula:
        """The formula of ``roots``."""
        return cls(roots, leaf, depending(roots, frozenset((leaf,))))

    def at(self, value: Expression) -> tuple[Expression, ...]:
        """The roots where the leaf is ``value``.

        Raises:
            UndefinedValueError: constants that now meet lie outside an operation's domain.

        """
        return _rebuilt(self.roots, self.steps, {self.leaf: value})


def depending(roots: tuple[Expression, ...], leaves: frozenset[Leaf]) -> tuple[Apply, ...]:
    """The operations below ``roots`` that depend on one of ``leaves``, arguments first."""
    found = {id(leaf) for leaf in leaves}
    steps = []
    for node in postorder(roots):
        if isinstance(node, Apply) and any(id(a) in found for a in node.arguments):
            found.add(id(node))
            steps.append(node)
    return tuple(steps)


def _rebuilt(
    roots: tuple[Expression, ...], steps: tuple[Apply, ...], values: Mapping[Leaf, Expression]
) -> tuple[Expression, ...]:
    found: dict[int, Expression] = {id(leaf): value for leaf, value in values.items()}
    for node in steps:
        arguments = tuple(found.get(id(a), a) for a in node.arguments)
        found[id(node)] = (
            apply(node.operation, *arguments, span=node.span)
            if node.output is None
            else Apply(node.operation, arguments, node.angle, node.span, node.output)
        )
    return tuple(found.get(id(root), root) for root in roots)


Slope: TypeAlias = Callable[[Expression, Expression, Span | None], Expression]
"""The derivative of a function of one number, from its argument and its value."""

Rule: TypeAlias = Callable[[Apply, tuple[Expression, ...]], Expression]
"""The derivative of an operation, from the derivatives of its arguments."""


def derivatives(roots: tuple[Expression, ...], leaf: Leaf) -> tuple[Expression, ...]:
    """The derivatives of ``roots`` with respect to ``leaf``; steps count as level, kinks have the slope of one side.

    Raises:
        UndefinedValueError: an operation has no derivative, or it is infinite at constants.

    """
    found: dict[int, Expression] = {id(leaf): ONE}
    for node in postorder(roots):
        if not isinstance(node, Apply) or not any(id(a) in found for a in node.arguments):
            continue
        if node.operation in LEVEL:
            continue
        rule, slope = _RULES.get(node.operation), _SLOPES.get(node.operation)
        if slope is not None and id(node.arguments[0]) in found:
            factor = slope(node.arguments[0], node, node.span)
            found[id(node)] = multiply(factor, found[id(node.arguments[0])], node.span)
        elif rule is not None:
            found[id(node)] = rule(node, tuple(found.get(id(a), _NONE) for a in node.arguments))
        else:
            raise UndefinedValueError(f"the derivative of `{node.operation.value}`")
    return tuple(_of_its_own(found.get(id(root), _NONE)) for root in roots)


_NONE = Number(0)
"""The derivative of what does not depend on the leaf: of whatever dimension is asked for."""


def _of_its_own(slope: Expression) -> Expression:
    """Zero as a number of its own: one that many places share takes the dimension of all of them."""
    return Number(0) if slope is _NONE else slope


LEVEL = CONDITIONS | {Operation.SIGN, Operation.FLOOR, Operation.HELD}
"""Operations whose value changes in steps only, or counts as constant."""


def _square(a: Expression, span: Span | None) -> Expression:
    return multiply(a, a, span)


def _beside_one(sign: Callable[..., Expression], a: Expression, span: Span | None) -> Expression:
    """1 + a² or 1 − a²."""
    return sign(ONE, _square(a, span), span)


def _root(a: Expression, span: Span | None) -> Expression:
    return apply(Operation.SQRT, a, span=span)


_SLOPES: Mapping[Operation, Slope] = {
    Operation.SQRT: lambda a, v, s: divide(ONE, multiply(TWO, v, s), s),
    Operation.EXP: lambda a, v, s: v,
    Operation.LOG: lambda a, v, s: divide(ONE, a, s),
    Operation.ABS: lambda a, v, s: apply(Operation.SIGN, a, span=s),
    Operation.SIN: lambda a, v, s: apply(Operation.COS, a, span=s),
    Operation.COS: lambda a, v, s: negate(apply(Operation.SIN, a, span=s), s),
    Operation.TAN: lambda a, v, s: _beside_one(add, v, s),
    Operation.ASIN: lambda a, v, s: divide(ONE, _root(_beside_one(subtract, a, s), s), s),
    Operation.ACOS: lambda a, v, s: negate(divide(ONE, _root(_beside_one(subtract, a, s), s), s), s),
    Operation.ATAN: lambda a, v, s: divide(ONE, _beside_one(add, a, s), s),
    Operation.SINH: lambda a, v, s: apply(Operation.COSH, a, span=s),
    Operation.COSH: lambda a, v, s: apply(Operation.SINH, a, span=s),
    Operation.TANH: lambda a, v, s: _beside_one(subtract, v, s),
    Operation.ASINH: lambda a, v, s: divide(ONE, _root(_beside_one(add, a, s), s), s),
    Operation.ACOSH: lambda a, v, s: divide(ONE, _root(subtract(_square(a, s), ONE, s), s), s),
    Operation.ATANH: lambda a, v, s: divide(ONE, _beside_one(subtract, a, s), s),
    Operation.WRAP: lambda a, v, s: ONE,
    Operation.AS_ANGLE: lambda a, v, s: ONE,
}


def _product(node: Apply, slopes: tuple[Expression, ...]) -> Expression:
    (a, b), (da, db) = node.arguments, slopes
    return add(multiply(da, b, node.span), multiply(a, db, node.span), node.span)


def _quotient(node: Apply, slopes: tuple[Expression, ...]) -> Expression:
    (_, b), (da, db) = node.arguments, slopes
    return divide(subtract(da, multiply(node, db, node.span), node.span), b, node.span)


def _power(node: Apply, slopes: tuple[Expression, ...]) -> Expression:
    """n aⁿ⁻¹ a′ for a constant exponent; else aᵇ (b′ log a + b a′/a)."""
    (a, b), (da, db), span = node.arguments, slopes, node.span
    if db is _NONE:
        lower = apply(Operation.POWER, a, subtract(b, ONE, span), span=span)
        return multiply(multiply(b, lower, span), da, span)
    grown = multiply(db, apply(Operation.LOG, a, span=span), span)
    return multiply(node, add(grown, divide(multiply(b, da, span), a, span), span), span)


def _hypot(node: Apply, slopes: tuple[Expression, ...]) -> Expression:
    (a, b), (da, db), span = node.arguments, slopes, node.span
    return divide(add(multiply(a, da, span), multiply(b, db, span), span), node, span)


def _atan2(node: Apply, slopes: tuple[Expression, ...]) -> Expression:
    (y, x), (dy, dx), span = node.arguments, slopes, node.span
    across = subtract(multiply(x, dy, span), multiply(y, dx, span), span)
    return divide(across, add(_square(x, span), _square(y, span), span), span)


def _extreme(node: Apply, slopes: tuple[Expression, ...]) -> Expression:
    """The slope of the lesser or of the greater one; of the first where they are equal."""
    pair = node.arguments if node.operation is Operation.MINIMUM else node.arguments[::-1]
    first = Apply(Operation.LESS_EQUAL, pair, span=node.span)
    return apply(Operation.IF, first, *map(_of_its_own, slopes), span=node.span)


_RULES: Mapping[Operation, Rule] = {
    Operation.ADD: lambda node, slopes: add(slopes[0], slopes[1], node.span),
    Operation.SUBTRACT: lambda node, slopes: subtract(slopes[0], slopes[1], node.span),
    Operation.NEGATE: lambda node, slopes: negate(slopes[0], node.span),
    Operation.MULTIPLY: _product,
    Operation.DIVIDE: _quotient,
    Operation.POWER: _power,
    Operation.HYPOT: _hypot,
    Operation.ATAN2: _atan2,
    Operation.MINIMUM: _extreme,
    Operation.MAXIMUM: _extreme,
    Operation.IF: lambda node, slopes: apply(
        Operation.IF, node.arguments[0], *map(_of_its_own, slopes[1:]), span=node.span
    ),
}
