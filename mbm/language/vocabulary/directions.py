"""Directions from point to point, as instruments measure them."""

from __future__ import annotations

from mbm.expression.algebra import apply, subtract
from mbm.expression.nodes import Expression, Operation
from mbm.language import faults
from mbm.language.scope import vector
from mbm.language.values import Array, Builtin, Call, Value, describe
from mbm.language.vocabulary.vectors import pair_of_vectors
from mbm.text.types import MbmError


def _difference(call: Call) -> Array:
    if len(call.arguments) == 1:
        return vector(call.arguments[0], call.forms[0].span)
    a, b = pair_of_vectors(call)
    pairs = zip(a.elements, b.elements, strict=True)
    return Array(a.shape, tuple(subtract(y, x, call.span) for x, y in pairs))


def _bearing(call: Call) -> Value:
    v = _difference(call)
    if v.shape[0] not in (2, 3):
        raise MbmError(faults.length_clash(call.span, describe(v), "a point of the plane or of space"))
    return apply(Operation.ATAN2, v.elements[1], v.elements[0], span=call.span)


def _elevation(call: Call) -> Value:
    v = _difference(call)
    if v.shape[0] != 3:
        raise MbmError(faults.length_clash(call.span, describe(v), "a point of space"))
    x, y, z = v.elements
    level: Expression = apply(Operation.HYPOT, x, y, span=call.span)
    return apply(Operation.ATAN2, z, level, span=call.span)


FUNCTIONS: tuple[Builtin, ...] = (
    Builtin("bearing", "(bearing p q) or (bearing v)", "Angle from x towards y of the way from p to q; wraps.", 1, 2, _bearing),
    Builtin("elevation", "(elevation p q) or (elevation v)", "Angle above the x-y plane of the way from p to q.", 1, 2, _elevation),
)  # fmt: skip
