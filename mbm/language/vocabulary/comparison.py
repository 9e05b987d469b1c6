"""Comparisons and logic. Texts compare while compiling; numbers may make a piecewise condition."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from itertools import pairwise

from mbm.expression.algebra import fold_values, number, subtract, wrap
from mbm.expression.nodes import Apply, Expression, Number, Operation
from mbm.language import faults
from mbm.language.scope import condition, scalar
from mbm.language.values import Builtin, Call, Placeable, StaticColumnNeeded, TextColumn, Value, describe
from mbm.text.types import MbmError, Span


class Unitable(Placeable):
    """What has a union with others of its kind."""

    __slots__ = ()

    @abstractmethod
    def united(self, call: Call) -> Value:
        """What ``(or …)`` of it, the first argument, and the others is.

        Raises:
            MbmError: one of the others does not go with it.

        """


def _compare(operation: Operation, a: Expression, b: Expression, span: Span) -> bool | Apply:
    if (
        isinstance(a, Number)
        and isinstance(b, Number)
        and (a.dimension is None or b.dimension is None or a.dimension == b.dimension)
    ):
        return bool(fold_values(operation, [a.value, b.value]))
    return Apply(operation, (a, b), span=span)


def both(parts: list[bool | Apply], operation: Operation, span: Span) -> bool | Apply:
    """``and`` or ``or`` of conditions; what is known while compiling is decided."""
    neutral = operation is Operation.AND
    open_parts: list[Apply] = []
    for part in parts:
        if isinstance(part, bool):
            if part is not neutral:
                return part
        else:
            open_parts.append(part)
    if not open_parts:
        return neutral
    result = open_parts[0]
    for part in open_parts[1:]:
        result = Apply(operation, (result, part), span=span)
    return result


def _chain(operation: Operation, *, swapped: bool = False) -> Callable[[Call], Value]:
    def function(call: Call) -> Value:
        values = [scalar(v, f.span) for v, f in zip(call.arguments, call.forms, strict=True)]
        pairs = pairwise(values)
        parts = [_compare(operation, *((b, a) if swapped else (a, b)), call.span) for a, b in pairs]
        return both(parts, Operation.AND, call.span)

    return function


def equal(a: Value, b: Value, span: Span) -> bool | Apply:
    """Whether two numbers, texts or truth values are equal."""
    for value in (a, b):
        if isinstance(value, TextColumn):
            raise StaticColumnNeeded(value, span)
    if isinstance(a, bool) and isinstance(b, bool):
        return a is b
    if isinstance(a, str) or isinstance(b, str):
        if isinstance(a, str) and isinstance(b, str):
            return a == b
        other = b if isinstance(a, str) else a
        raise MbmError(faults.wrong_kind(span, "two texts or two numbers to compare", f"a text and {describe(other)}"))
    left, right = scalar(a, span), scalar(b, span)
    if left.angle or right.angle:
        return _compare(Operation.EQUAL, wrap(subtract(left, right, span), span), number(0), span)
    return _compare(Operation.EQUAL, left, right, span)


def _equal(call: Call) -> Value:
    pairs = pairwise(call.arguments)
    return both([equal(a, b, call.span) for a, b in pairs], Operation.AND, call.span)


def _logic(operation: Operation) -> Callable[[Call], Value]:
    def function(call: Call) -> Value:
        parts = [condition(v, f.span) for v, f in zip(call.arguments, call.forms, strict=True)]
        return both(parts, operation, call.span)

    return function


def _or(call: Call) -> Value:
    """The union of shapes, or whether a condition holds."""
    first = call.arguments[0] if call.arguments else None
    return first.united(call) if isinstance(first, Unitable) else _either(call)


_either = _logic(Operation.OR)


def _not(call: Call) -> Value:
    part = condition(call.arguments[0], call.span)
    return (not part) if isinstance(part, bool) else Apply(Operation.NOT, (part,), span=call.span)


def _finite(call: Call) -> Value:
    node = scalar(call.arguments[0], call.span)
    return math.isfinite(node.value) if isinstance(node, Number) else Apply(Operation.FINITE, (node,), span=call.span)


FUNCTIONS: tuple[Builtin, ...] = (
    Builtin("=", "(= a b …)", "Whether all are equal: numbers or texts.", 2, None, _equal),
    Builtin("<", "(< a b …)", "Whether each is less than the next.", 2, None, _chain(Operation.LESS)),
    Builtin("<=", "(<= a b …)", "Whether none is greater than the next.", 2, None, _chain(Operation.LESS_EQUAL)),
    Builtin(">", "(> a b …)", "Whether each is greater than the next.", 2, None, _chain(Operation.LESS, swapped=True)),
    Builtin(">=", "(>= a b …)", "Whether none is less than the next.", 2, None, _chain(Operation.LESS_EQUAL, swapped=True)),
    Builtin("and", "(and a b …)", "Whether all hold.", 0, None, _logic(Operation.AND)),
    Builtin("or", "(or a b …)", "Whether one holds; of shapes, their union.", 0, None, _or),
    Builtin("not", "(not a)", "Whether a does not hold.", 1, 1, _not),
    Builtin("finite", "(finite x)", "Whether x is a number that is there: neither missing nor infinite.", 1, 1, _finite),
)  # fmt: skip
