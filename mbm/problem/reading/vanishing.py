"""What must be zero for a norm, an absolute value or a power to be zero: these have no slope where they are.

``(= (distance p q) 0)`` takes away as many dimensions as the points have coordinates; its derivative there takes none.
"""

from __future__ import annotations

from mbm.expression.algebra import constant_value
from mbm.expression.nodes import Apply, Expression, Operation

THROUGH = frozenset({Operation.ABS, Operation.SQRT, Operation.NEGATE, Operation.HYPOT})
"""Operations that are zero where their argument is, and nowhere else."""


def vanishing(node: Expression) -> tuple[Expression, ...]:
    """The expressions that are zero together where ``node`` is zero; the node itself where nothing better is known."""
    found: list[Expression] = []
    left = [node]
    while left:
        each = left.pop()
        inner = _inner(each)
        if inner is None:
            found.append(each)
        else:
            left.extend(reversed(inner))
    return tuple(found)


def _inner(node: Expression) -> tuple[Expression, ...] | None:
    """What is zero where ``node`` is, and nowhere else; None where that is the node itself."""
    if not isinstance(node, Apply):
        return None
    if node.operation in THROUGH:
        return node.arguments
    if node.operation is Operation.POWER:
        exponent = constant_value(node.arguments[1])
        return node.arguments[:1] if exponent is not None and exponent > 0 else None
    if node.operation in (Operation.ADD, Operation.MULTIPLY):
        return _roots(node)
    return None


def _roots(node: Expression) -> tuple[Expression, ...] | None:
    """The numbers whose squares ``node`` sums up; None where it is no sum of squares."""
    found: list[Expression] = []
    left = [node]
    while left:
        each = left.pop()
        if not isinstance(each, Apply):
            return None
        if each.operation is Operation.ADD:
            left.extend(reversed(each.arguments))
        elif _is_square(each):
            found.append(each.arguments[0])
        else:
            return None
    return tuple(found)


def _is_square(node: Apply) -> bool:
    if node.operation is Operation.MULTIPLY:
        return node.arguments[0] is node.arguments[1]
    return node.operation is Operation.POWER and constant_value(node.arguments[1]) == 2
