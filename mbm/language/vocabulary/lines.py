"""Lines in images, and distances from lines and planes.

An image line is its direction α ∈ [−π/2, π/2) and ρ = −X sin α + Y cos α (Shimada et al. 1995): (α, ρ) and (α + π, −ρ) are
the same line. Distances from an image line are signed, left of its direction positive; those from a plane are positive on
the side from which its points run counter-clockwise; those from a line of space have no sign.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from mbm.expression.algebra import (
    ONE,
    ZERO,
    apply,
    cross,
    differences,
    divide,
    dot,
    multiply,
    negate,
    subtract,
    wrap,
)
from mbm.expression.nodes import Apply, Expression, Number, Operation
from mbm.language import faults
from mbm.language.curves import CurveValue, Piece
from mbm.language.scope import scalar, vector
from mbm.language.values import Array, Builtin, Call, ImageLineValue, Placeable, Value, describe
from mbm.language.vocabulary.cameras import depth_of, project_point
from mbm.language.vocabulary.vectors import norm_of
from mbm.text.types import MbmError, Span


def line_through(p: tuple[Expression, ...], q: tuple[Expression, ...], span: Span) -> ImageLineValue:
    """The image line through two points, with its direction in [−π/2, π/2)."""
    dx, dy = differences(q, p, span)
    zero = multiply(ZERO, dx, span) if isinstance(dx, Number) else subtract(dx, dx, span)
    upright = Apply(Operation.AND, (_same(dx, zero, span), Apply(Operation.LESS, (zero, dy), span=span)), span=span)
    back = Apply(Operation.OR, (Apply(Operation.LESS, (dx, zero), span=span), upright), span=span)
    sign = apply(Operation.IF, back, negate(ONE, span), ONE, span=span)
    alpha = apply(Operation.ATAN2, multiply(sign, dy, span), multiply(sign, dx, span), span=span)
    length = apply(Operation.HYPOT, dx, dy, span=span)
    # ρ from the direction's sine and cosine themselves: no detour over the angle.
    across = subtract(multiply(p[1], dx, span), multiply(p[0], dy, span), span)
    return ImageLineValue(alpha, multiply(sign, divide(across, length, span), span))


def _same(a: Expression, b: Expression, span: Span) -> Apply:
    return Apply(Operation.EQUAL, (a, b), span=span)


def line_difference(measured: Value, model: Value, span: Span) -> tuple[Expression, ...] | None:
    """The difference of two image lines in (α, ρ), modulo the equivalence; None where neither is one.

    Raises MbmError (`length-clash`) where only one of them is a line.
    """
    known, found = as_image_line(measured, span), as_image_line(model, span)
    if known is None and found is None:
        return None
    if known is None or found is None:
        raise MbmError(faults.length_clash(span, describe(measured), describe(model)))
    turn = subtract(found.alpha, known.alpha, span)
    opposite = Apply(Operation.LESS, (apply(Operation.COS, turn, span=span), ZERO), span=span)
    half = apply(Operation.ATAN2, ZERO, negate(ONE, span), span=span)
    straight = wrap(turn, span)
    turned = apply(Operation.IF, opposite, wrap(subtract(turn, half, span), span), straight, span=span)
    rho = apply(Operation.IF, opposite, negate(found.rho, span), found.rho, span=span)
    return turned, subtract(rho, known.rho, span)


def as_image_line(value: Value, span: Span) -> ImageLineValue | None:
    """An image line: as such, or a line feature of a shape that was projected; None for anything else."""
    if isinstance(value, ImageLineValue):
        return value
    ends = value.ends() if isinstance(value, Placeable) else None
    if ends is None or len(ends) != 2 or ends[0].shape != (2,):
        return None
    return line_through(ends[0].elements, ends[1].elements, span)


def signed_distance(line: ImageLineValue, p: tuple[Expression, ...], span: Span) -> Expression:
    """−X sin α + Y cos α − ρ."""
    c, s = (apply(operation, line.alpha, span=span) for operation in (Operation.COS, Operation.SIN))
    return subtract(subtract(multiply(p[1], c, span), multiply(p[0], s, span), span), line.rho, span)


def image_of(call: Call, camera: Value | None, thing: Value, span: Span) -> Value:
    """The image of a point, [u v], of a line: an image line, or of a curve: a curve of the image."""
    if isinstance(thing, CurveValue):
        if thing.dimension != 3:
            raise MbmError(faults.wrong_kind(span, "a curve of space", describe(thing)))
        pieces = tuple(_piece_of(call, camera, piece) for piece in thing.pieces)
        return replace(thing, pieces=pieces, chords=IMAGE_CHORDS if thing.chords == 1 else thing.chords)
    ends = thing.ends() if isinstance(thing, Placeable) and thing.as_point() is None else None
    if ends is None:
        if isinstance(thing, Placeable) and thing.as_point() is None:
            raise MbmError(faults.not_available_yet(span, f"the projection of {thing.kind}", "images of shapes"))
        return project_point(call, camera, vector(thing, span, 3).elements)
    if len(ends) != 2:
        raise MbmError(faults.wrong_kind(span, "a point or a line", describe(thing)))
    first, second = (project_point(call, camera, end.elements) for end in ends)
    return line_through(first.elements, second.elements, call.span)


IMAGE_CHORDS = 8
"""Straight lines in which the nearest place is looked for, in the image of each piece that is straight in space."""


def _piece_of(call: Call, camera: Value | None, piece: Piece) -> Piece:
    """The image of a piece of a curve, seen where it is far enough from the camera."""
    point = project_point(call, camera, piece.point).elements
    return replace(piece, point=point, seen=depth_of(camera, piece.point, call.span))


def _image_line(call: Call) -> Value:
    alpha, rho = (scalar(v, f.span) for v, f in zip(call.arguments, call.forms, strict=True))
    return ImageLineValue(apply(Operation.AS_ANGLE, alpha, span=call.span), rho)


def _line_through(call: Call) -> Value:
    p, q = (vector(v, f.span, 2).elements for v, f in zip(call.arguments, call.forms, strict=True))
    return line_through(p, q, call.span)


def _on_image(call: Call, kind: type[Array | ImageLineValue], wanted: str) -> Value:
    found = image_of(call, call.arguments[0], call.arguments[1], call.forms[1].span)
    if not isinstance(found, kind):
        raise MbmError(faults.wrong_kind(call.forms[1].span, wanted, describe(call.arguments[1])))
    return found


_VERTEX_ON_IMAGE = partial(_on_image, kind=Array, wanted="a point")
_LINE_ON_IMAGE = partial(_on_image, kind=ImageLineValue, wanted="a line")


def _vertex_on_line(call: Call) -> Value:
    line = as_image_line(call.arguments[1], call.forms[1].span)
    if line is None:
        raise MbmError(faults.wrong_kind(call.forms[1].span, "an image line", describe(call.arguments[1])))
    return signed_distance(line, vector(call.arguments[0], call.forms[0].span, 2).elements, call.span)


def _point_line_distance(call: Call) -> Value:
    if as_image_line(call.arguments[1], call.forms[1].span) is not None:
        return _vertex_on_line(call)
    p = vector(call.arguments[0], call.forms[0].span, 3).elements
    a, b = _points(call, 2, "a line")
    along, way = differences(b, a, call.span), differences(p, a, call.span)
    return divide(norm_of(cross(way, along, call.span), call.span), norm_of(along, call.span), call.span)


def _point_plane_distance(call: Call) -> Value:
    p = vector(call.arguments[0], call.forms[0].span, 3).elements
    a, b, c = _points(call, 3, "a plane")
    normal = cross(differences(b, a, call.span), differences(c, a, call.span), call.span)
    return divide(dot(differences(p, a, call.span), normal, call.span), norm_of(normal, call.span), call.span)


def _points(call: Call, count: int, wanted: str) -> list[tuple[Expression, ...]]:
    thing = call.arguments[1]
    ends = thing.ends() if isinstance(thing, Placeable) else None
    if ends is None or (len(ends) != 2) != (count == 3) or len(ends) < count:
        raise MbmError(faults.wrong_kind(call.forms[1].span, wanted, describe(thing)))
    return [end.elements for end in ends[:count]]


FUNCTIONS: tuple[Builtin, ...] = (
    Builtin("vertex-on-image", "(vertex-on-image camera P)", "The image [u v] of a point.", 2, 2, _VERTEX_ON_IMAGE),
    Builtin("line-on-image", "(line-on-image camera L)", "The image line of a line.", 2, 2, _LINE_ON_IMAGE),
    Builtin("image-line", "(image-line alpha rho)", "The image line of direction α at ρ = −X sin α + Y cos α.", 2, 2, _image_line),
    Builtin("line-through", "(line-through p q)", "The image line through two image points.", 2, 2, _line_through),
    Builtin("vertex-on-line", "(vertex-on-line p L)", "Signed distance of an image point from an image line.", 2, 2, _vertex_on_line),
    Builtin("point-line-distance", "(point-line-distance P L)", "Distance from a line; signed from an image line.", 2, 2, _point_line_distance),
    Builtin("point-plane-distance", "(point-plane-distance P S)", "Signed distance from a plane.", 2, 2, _point_plane_distance),
)  # fmt: skip
