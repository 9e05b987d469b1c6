"""Projections: the paper's ``perse`` and cameras with distortion.

Axes ``opencv``: z forward, x right, y down, pixel centres at whole numbers. Axes ``paper``: x forward, y left, z up,
X = k0 y/x, Y = k1 z/x (Oyama & Tachi 1989, sect. 3 (2)). Axes ``opengl``: x right, y up, −z forward. Distortion is Brown's model in OpenCV's order k1 k2 p1 p2 k3;
of a fisheye the radius is f (θ + k1 θ³ + k2 θ⁵ + k3 θ⁷ + k4 θ⁹) with θ the angle from the optical axis (Kannala and Brandt
2006). Weak-perspective and orthographic cameras do not divide by the depth: u = f x + c, with f the scale in px per length.
"""

from __future__ import annotations

from fractions import Fraction

from mbm.expression.algebra import ONE, TWO, ZERO, add, apply, divide, dot, multiply, subtract
from mbm.expression.nodes import Apply, Expression, Number, Operation
from mbm.expression.projection import NEAR, Projection, by_axes
from mbm.expression.units import NONE
from mbm.language import faults
from mbm.language.scope import scalar
from mbm.language.values import Array, Call, CameraValue, Value, describe
from mbm.text.types import MbmError, Span

_NEAR = Number(1e-8, NONE)
"""Squared tangent of the angle from the axis below which two terms of its series do (the third is below 1e-16)."""


def project_point(call: Call, camera: Value | None, point: tuple[Expression, ...]) -> Array:
    """The image [u v] of a point in the camera's frame; without a camera the paper's ``perse``."""
    if camera is None:
        x, y, z = point
        k0, k1 = (_focal(call, name) for name in ("k0", "k1"))
        span = call.span
        return Array((2,), (multiply(k0, divide(y, x, span), span), multiply(k1, divide(z, x, span), span)))
    if not isinstance(camera, CameraValue):
        raise MbmError(faults.wrong_kind(call.forms[0].span, "a camera", describe(camera)))
    return _project(camera, point, call.span)


def depth_of(camera: Value | None, point: tuple[Expression, ...], span: Span) -> Expression | None:
    """How much farther than ``near`` a point in the camera's frame is; None for cameras to which depth is nothing.

    Of a fisheye, which looks to all sides, it is the distance that counts.
    """
    if not isinstance(camera, CameraValue):
        return subtract(point[0], NEAR, span)
    if camera.model == "fisheye":
        return subtract(apply(Operation.SQRT, dot(point, point, span), span=span), camera.near, span)
    if camera.model != "pinhole":
        return None
    return subtract(by_axes(point, camera.axes, span)[2], camera.near, span)


def _focal(call: Call, name: str) -> Expression:
    value = call.evaluator.world.lookup(name, call.span)
    if value is None:
        call.evaluator.warn(faults.default_focal_length(call.span, name))
        return ONE
    return scalar(value, call.span)


def _project(camera: CameraValue, point: tuple[Expression, ...], span: Span) -> Array:
    across, up, depth = by_axes(point, camera.axes, span)
    if camera.model == "pinhole":
        x, y = _distort(camera, divide(across, depth, span), divide(up, depth, span), span)
    elif camera.model == "fisheye":
        x, y = _fisheye(camera, across, up, depth, span)
    else:
        x, y = across, up
    pixels = zip(camera.focal, (x, y), camera.center, strict=True)
    image = tuple(add(multiply(f, e, span), c0, span) for f, e, c0 in pixels)
    projection = Projection(
        camera=camera.name,
        model=camera.model,
        axes=camera.axes,
        focal=camera.focal,
        center=camera.center,
        distortion=camera.distortion,
        point=point,
    )
    return Array((2,), image, projection)


def _fisheye(
    camera: CameraValue, across: Expression, up: Expression, depth: Expression, span: Span
) -> tuple[Expression, Expression]:
    """The angle from the axis in place of its tangent; behind the camera's plane too. Near the axis by two terms."""
    squared = add(multiply(across, across, span), multiply(up, up, span), span)
    share = divide(squared, multiply(depth, depth, span), span)
    ahead = Apply(Operation.LESS, (ZERO, divide(depth, apply(Operation.ABS, depth, span=span), span)), span=span)
    near = Apply(Operation.AND, (Apply(Operation.LESS, (share, _NEAR), span=span), ahead), span=span)
    unit = divide(multiply(depth, depth, span), Number(Fraction(10**9), NONE), span)
    radius = apply(Operation.SQRT, apply(Operation.IF, near, unit, squared, span=span), span=span)
    far = divide(apply(Operation.ATAN2, radius, depth, span=span), radius, span)
    series = subtract(ONE, divide(share, Number(3, NONE), span), span)
    ratio = apply(Operation.IF, near, divide(series, depth, span), far, span=span)
    theta2 = multiply(multiply(ratio, ratio, span), squared, span)
    factor: Expression = ONE
    if camera.distortion:
        radial: Expression = ZERO
        for k in reversed(camera.distortion):
            radial = multiply(theta2, add(k, radial, span), span)
        factor = add(ONE, radial, span)
    scale = multiply(ratio, factor, span)
    return multiply(across, scale, span), multiply(up, scale, span)


def _distort(camera: CameraValue, x: Expression, y: Expression, span: Span) -> tuple[Expression, Expression]:
    if not camera.distortion:
        return x, y
    k1, k2, p1, p2, k3 = camera.distortion
    xx, yy, xy = multiply(x, x, span), multiply(y, y, span), multiply(x, y, span)
    r2 = add(xx, yy, span)
    radial: Expression = add(k2, multiply(r2, k3, span), span)
    radial = add(ONE, multiply(r2, add(k1, multiply(r2, radial, span), span), span), span)

    def tangential(own: Expression, cross: Expression, square: Expression) -> Expression:
        mixed = multiply(TWO, multiply(own, xy, span), span)
        return add(mixed, multiply(cross, add(r2, multiply(TWO, square, span), span), span), span)

    return (
        add(multiply(x, radial, span), tangential(p1, p2, xx), span),
        add(multiply(y, radial, span), tangential(p2, p1, yy), span),
    )
