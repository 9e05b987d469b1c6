"""Conditions whose truth is known while compiling: over numbers and constants."""

from __future__ import annotations

from mbm.expression.algebra import constant_value, fold_values
from mbm.expression.nodes import Apply, Expression, Operation


def truth(test: bool | Expression) -> bool | None:
    """Whether a condition holds, or None where a column or an unknown decides.

    Raises:
        UndefinedValueError: a constant part has no finite value.

    """
    if isinstance(test, bool):
        return test
    if not isinstance(test, Apply):
        return None
    if test.operation in (Operation.NOT, Operation.AND, Operation.OR):
        parts = [truth(a) for a in test.arguments]
        if test.operation is Operation.NOT:
            return None if parts[0] is None else not parts[0]
        decisive = test.operation is Operation.OR
        if decisive in parts:
            return decisive
        return None if None in parts else not decisive
    values = [constant_value(a) for a in test.arguments]
    known = [v for v in values if v is not None]
    if len(known) < len(values):
        return None
    return bool(fold_values(test.operation, known))
