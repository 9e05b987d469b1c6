"""How a profile is swept: straight from section to section, or smoothly, in frames along a path.

A frame has the profile's z along the path. Along a path of the plane its y is z of space and its x points to the left
of the path. Along one of space it begins that way (with x along x where the path begins upright) and is turned by the
least rotation from direction to direction (parallel transport, Bishop 1975); at a smooth path, from the beginning of
each piece.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise

from mbm.expression.algebra import ONE, ZERO, add, apply, cross, divide, dot, multiply, negate, subtract
from mbm.expression.derivative import derivatives, substituted
from mbm.expression.nodes import Expression, Number, Operation, Parameter, nearest
from mbm.expression.units import NONE
from mbm.language import faults
from mbm.language.curves import CurveValue, Piece, Point, in_space
from mbm.language.scope import scalar
from mbm.language.values import Value
from mbm.language.vocabulary.curves import curve_of
from mbm.language.vocabulary.vectors import norm_of
from mbm.text.types import MbmError, Span
from mbm.values import dataclass

STRETCHES = 16
"""Parts of equal range into which a smooth path of one piece is cut: the frame is transported from one to the next."""

_ROUNDING = 1e-12
"""Of an angle that was written in degrees, or as 2 π."""

Placing = Callable[[Point], Point]
"""Where a point of the profile comes to lie."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stretch:
    """A part of a smooth motion: ``place`` holds its ``parameter``, which runs from ``first`` to ``last``."""

    parameter: Parameter
    first: Expression
    last: Expression
    place: Placing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """Where the profile stands: in ``sections``, each joined to the next, the last to the first if ``closed``.

    ``stretches`` are empty where it goes straight from section to section. ``against``: it moves against the side from
    which the profile is seen counter-clockwise.
    """

    sections: tuple[Placing, ...]
    stretches: tuple[Stretch, ...] = ()
    closed: bool = False
    against: bool = False


def motion_of(head: str, way: Value, span: Span) -> Motion:
    """How ``extrude``, ``revolve`` or ``sweep`` moves a profile, by the value that tells how far or where.

    Raises:
        MbmError: it is no length, no angle up to a full turn, or no curve.

    """
    if head == "sweep":
        return along(curve_of(way, span), span)
    wanted = "a positive length" if head == "extrude" else "an angle above 0 up to 360deg"
    size = scalar(way, span, wanted)
    if isinstance(size, Number):
        value = nearest(size.value)
        most = math.inf if head == "extrude" else 2 * math.pi * (1 + _ROUNDING)
        if not 0 < value <= most:
            raise MbmError(faults.wrong_kind(span, wanted, f"{value:g}"))
        if head == "revolve" and value >= 2 * math.pi * (1 - _ROUNDING):
            return revolved(Number(2 * math.pi, NONE), span, closed=True)
    return extruded(size, span) if head == "extrude" else revolved(size, span, closed=False)


def extruded(length: Expression, span: Span) -> Motion:
    """From z = 0 to z = ``length``."""
    return Motion(sections=(lambda p: p, lambda p: (p[0], p[1], add(p[2], length, span))))


def revolved(angle: Expression, span: Span, *, closed: bool) -> Motion:
    """About z, by ``angle``, the profile's x outward and its y up; a full turn has sections at its quarters."""
    turn = Parameter("angle", span)

    def placed(at: Expression) -> Placing:
        c, s = (apply(operation, at, span=span) for operation in (Operation.COS, Operation.SIN))
        return lambda p: (multiply(p[0], c, span), multiply(p[0], s, span), p[1])

    quarters = [multiply(angle, Number(Fraction(k, 4), NONE), span) for k in range(4)]
    sections = quarters if closed else [ZERO, angle]
    stretch = Stretch(parameter=turn, first=ZERO, last=angle, place=placed(turn))
    return Motion(sections=tuple(map(placed, sections)), stretches=(stretch,), closed=closed, against=True)


def along(path: CurveValue, span: Span) -> Motion:
    """Along a curve; a closed one of the plane has no ends."""
    flat = path.dimension == 2
    closed, path = path.closed and flat, in_space(path)
    slopes = [derivatives(piece.point, path.parameter) for piece in path.pieces]
    if all(_is_level(derivatives(slope, path.parameter)) for slope in slopes):
        return _straight(path, [_unit(slope, span) for slope in slopes], span, flat=flat, closed=closed)
    return _smooth(path, span, flat=flat, closed=closed)


def _is_level(slope: Point) -> bool:
    return all(isinstance(each, Number) and each.value == 0 for each in slope)


def _straight(path: CurveValue, ways: list[Point], span: Span, *, flat: bool, closed: bool) -> Motion:
    """Straight pieces: at a corner the section stands in the plane that halves the angle."""
    lefts = [_left(ways[0], span)]
    for before, way in pairwise(ways):
        lefts.append(_left(way, span) if flat else _transported(lefts[-1], before, way, span))
    starts = [substituted(piece.point, {path.parameter: piece.first}) for piece in path.pieces]
    end = path.pieces[-1]
    starts.append(substituted(end.point, {path.parameter: end.last}))
    sections = [_section(starts[i], ways[i], lefts[i], _corner(ways, i, closed, span), span) for i in range(len(ways))]
    if not closed:
        sections.append(_section(starts[-1], ways[-1], lefts[-1], None, span))
    return Motion(sections=tuple(sections), closed=closed)


def _corner(ways: list[Point], i: int, closed: bool, span: Span) -> Point | None:
    """The normal of the section where way ``i`` begins; None where it is square to it."""
    if i == 0 and not closed:
        return None
    return tuple(add(a, b, span) for a, b in zip(ways[i - 1], ways[i], strict=True))


def _section(at: Point, way: Point, left: Point, normal: Point | None, span: Span) -> Placing:
    up = cross(way, left, span)
    if normal is None:
        return lambda p: _sum(at, (p[0], left), (p[1], up), span)
    steep = dot(way, normal, span)

    def placed(p: Point) -> Point:
        across = _sum((ZERO,) * 3, (p[0], left), (p[1], up), span)
        back = negate(divide(dot(across, normal, span), steep, span), span)
        return _sum(at, (ONE, across), (back, way), span)

    return placed


def _smooth(path: CurveValue, span: Span, *, flat: bool, closed: bool) -> Motion:
    pieces = path.pieces if len(path.pieces) > 1 or flat else _cut(path.pieces[0], span)
    stretches, left = [], None
    for piece in pieces:
        way = _unit(derivatives(piece.point, path.parameter), span)
        first, last = (substituted(way, {path.parameter: end}) for end in (piece.first, piece.last))
        if flat:
            here = _left(way, span)
        else:
            left = _left(first, span) if left is None else left
            here = _transported(left, first, way, span)
            left = _transported(left, first, last, span)
        place = _section(piece.point, way, here, None, span)
        stretches.append(Stretch(parameter=path.parameter, first=piece.first, last=piece.last, place=place))
    begin, end = stretches[0], stretches[-1]
    sections = [_held(begin, begin.first)] if closed else [_held(begin, begin.first), _held(end, end.last)]
    return Motion(sections=tuple(sections), stretches=tuple(stretches), closed=closed)


def _held(stretch: Stretch, at: Expression) -> Placing:
    return lambda p: substituted(stretch.place(p), {stretch.parameter: at})


def _cut(piece: Piece, span: Span) -> tuple[Piece, ...]:
    way = subtract(piece.last, piece.first, span)
    ends = [add(piece.first, multiply(Number(Fraction(k, STRETCHES), NONE), way, span), span) for k in range(STRETCHES)]
    ends.append(piece.last)
    return tuple(Piece(first=a, last=b, point=piece.point) for a, b in pairwise(ends))


def _left(way: Point, span: Span) -> Point:
    """z × way, of length 1; x where the way is upright."""
    x, y, _ = way
    if _is_level((x, y)):
        return (ONE, ZERO, ZERO)
    length = apply(Operation.HYPOT, x, y, span=span)
    return (negate(divide(y, length, span), span), divide(x, length, span), ZERO)


def _transported(left: Point, before: Point, way: Point, span: Span) -> Point:
    """What is square to ``before``, turned by the least rotation that takes ``before`` to ``way``."""
    share = divide(dot(left, way, span), add(ONE, dot(before, way, span), span), span)
    pairs = zip(left, before, way, strict=True)
    return tuple(subtract(e, multiply(share, add(a, b, span), span), span) for e, a, b in pairs)


def _unit(way: Point, span: Span) -> Point:
    length = norm_of(way, span)
    return tuple(e if _is_level((e,)) else divide(e, length, span) for e in way)


def _sum(at: Point, first: tuple[Expression, Point], second: tuple[Expression, Point], span: Span) -> Point:
    """at + first₀ first₁ + second₀ second₁."""
    (f, a), (g, b) = first, second
    terms = zip(at, a, b, strict=True)
    return tuple(add(add(o, multiply(f, x, span), span), multiply(g, y, span), span) for o, x, y in terms)
