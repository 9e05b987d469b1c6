"""Moving points, features and shapes from frame to frame."""

from __future__ import annotations

from mbm.expression.algebra import ZERO, multiply
from mbm.expression.nodes import Expression
from mbm.language.scope import vector
from mbm.language.values import SCALARS, Array, Builtin, Call, Placeable, Transform, Value
from mbm.language.vocabulary.rigid import pose
from mbm.language.vocabulary.rotations import as_rotation
from mbm.language.vocabulary.vectors import move_point
from mbm.text.types import Span


def translation_transform(value: Value, span: Span) -> Transform:
    """``(trans v …)``."""
    return Transform(None, vector(value, span).elements, "trans", value)


def rotation_transform(value: Value, span: Span) -> Transform:
    """``(rotate r …)``: Euler angles or any rotation value."""
    return Transform(as_rotation(value, span).matrix, None, "rotate", value)


def scale_transform(value: Value, span: Span, dimension: int = 3) -> Transform:
    """``(scale s …)`` or ``(scale (sx sy sz) …)``."""
    if isinstance(value, SCALARS):
        factors: tuple[Expression, ...] = (value,) * dimension
    else:
        factors = vector(value, span).elements
    n = len(factors)
    elements = tuple(factors[i] if i == j else ZERO for i in range(n) for j in range(n))
    return Transform(Array((n, n), elements), None, "scale", value)


def _move(call: Call, by: Transform) -> Value:
    thing = call.arguments[1]
    if isinstance(thing, Placeable):
        return thing.moved(by)
    return move_point(by, vector(thing, call.forms[1].span), call.span)


def _trans(call: Call) -> Value:
    return _move(call, translation_transform(call.arguments[0], call.forms[0].span))


def _rotate(call: Call) -> Value:
    return _move(call, rotation_transform(call.arguments[0], call.forms[0].span))


def _scale(call: Call) -> Value:
    thing = call.arguments[1]
    dimension = thing.dimension if isinstance(thing, Placeable) else vector(thing, call.forms[1].span).shape[0]
    return _move(call, scale_transform(call.arguments[0], call.forms[0].span, dimension))


def _transform(call: Call) -> Value:
    p = pose(call.arguments[0], call.forms[0].span)
    m = p.rotation.matrix
    if p.scale is not None:
        m = Array(m.shape, tuple(multiply(p.scale, e, call.span) for e in m.elements))
    return _move(call, Transform(m, p.translation, "transform", p))


FUNCTIONS: tuple[Builtin, ...] = (
    Builtin("trans", "(trans v X)", "X moved by v.", 2, 2, _trans),
    Builtin("rotate", "(rotate r X)", "X turned: r is (φ θ ψ), a rotation, or an angle in the plane.", 2, 2, _rotate),
    Builtin("scale", "(scale s X)", "X stretched by s or by (sx sy sz).", 2, 2, _scale),
    Builtin("transform", "(transform P X)", "X by a pose or similarity: c R x + t.", 2, 2, _transform),
)
