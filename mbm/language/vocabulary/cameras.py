"""Projections: the paper's ``perse`` and cameras with distortion.

Axes ``opencv``: z forward, x right, y down, pixel centres at whole numbers. Axes ``paper``: x forward, y left, z up,
X = k0 y/x, Y = k1 z/x (Oyama & Tachi 1989, sect. 3 (2)). Distortion is Brown's model in OpenCV's order k1 k2 p1 p2 k3.
"""

from __future__ import annotations

from mbm.expression.algebra import add, divide, multiply
from mbm.expression.dimension import NONE
from mbm.expression.nodes import Expression, Number
from mbm.language import faults
from mbm.language.coerce import scalar, vector
from mbm.language.values import Array, Builtin, Call, CameraValue, Placeable, Value, describe
from mbm.text.types import MbmError, Span

_ONE = Number(1, NONE)
_TWO = Number(2, NONE)


def point_in_space(call: Call, position: int) -> tuple[Expression, ...]:
    """The argument at ``position`` as a point of space."""
    value, span = call.arguments[position], call.forms[position].span
    if isinstance(value, Placeable) and value.as_point() is None:
        raise MbmError(faults.not_available_yet(span, f"the projection of {value.kind}", "images of lines and curves"))
    return vector(value, span, 3).elements


def _perse(call: Call) -> Value:
    x, y, z = point_in_space(call, 0)
    k0, k1 = (_focal(call, name) for name in ("k0", "k1"))
    span = call.span
    return Array((2,), (multiply(k0, divide(y, x, span), span), multiply(k1, divide(z, x, span), span)))


def _focal(call: Call, name: str) -> Expression:
    value = call.evaluator.world.lookup(name, call.span)
    if value is None:
        call.evaluator.warn(faults.default_focal_length(call.span, name))
        return _ONE
    return scalar(value, call.span)


def _project(call: Call) -> Value:
    camera = call.arguments[0]
    if not isinstance(camera, CameraValue):
        raise MbmError(faults.wrong_kind(call.forms[0].span, "a camera", describe(camera)))
    a, b, c = point_in_space(call, 1)
    span = call.span
    x, y = (
        (divide(a, c, span), divide(b, c, span))
        if camera.axes == "opencv"
        else (divide(b, a, span), divide(c, a, span))
    )
    x, y = _distort(camera, x, y, span)
    pixels = zip(camera.focal, (x, y), camera.center, strict=True)
    return Array((2,), tuple(add(multiply(f, e, span), c0, span) for f, e, c0 in pixels))


def _distort(camera: CameraValue, x: Expression, y: Expression, span: Span) -> tuple[Expression, Expression]:
    if not camera.distortion:
        return x, y
    k1, k2, p1, p2, k3 = camera.distortion
    xx, yy, xy = multiply(x, x, span), multiply(y, y, span), multiply(x, y, span)
    r2 = add(xx, yy, span)
    radial: Expression = add(k2, multiply(r2, k3, span), span)
    radial = add(_ONE, multiply(r2, add(k1, multiply(r2, radial, span), span), span), span)

    def tangential(own: Expression, cross: Expression, square: Expression) -> Expression:
        mixed = multiply(_TWO, multiply(own, xy, span), span)
        return add(mixed, multiply(cross, add(r2, multiply(_TWO, square, span), span), span), span)

    return (
        add(multiply(x, radial, span), tangential(p1, p2, xx), span),
        add(multiply(y, radial, span), tangential(p2, p1, yy), span),
    )


FUNCTIONS: tuple[Builtin, ...] = (
    Builtin("perse", "(perse v)", "The paper's projection (k0 y/x, k1 z/x); k0, k1 are the problem's, else 1.", 1, 1, _perse),
    Builtin("project", "(project camera X)", "The image [u v] of a point in the camera's frame.", 2, 2, _project),
)  # fmt: skip
