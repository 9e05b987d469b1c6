"""What is measured of curves: distances from them, and where a coordinate is stationary.

A coordinate's derivative is looked at where the chords of the curve meet. Between two places where the signs differ
lies a root, found by Newton's method kept between both; a coordinate that turns back at a corner is stationary there.
The root is held, and one more step of Newton's method has its derivative (implicit function theorem).
"""

from __future__ import annotations

from fractions import Fraction

from mbm.expression.algebra import ONE, ZERO, add, apply, divide, multiply, negate, subtract
from mbm.expression.derivative import Formula, depending, derivatives
from mbm.expression.nodes import Expression, Number, Operation
from mbm.expression.units import NONE
from mbm.language import faults
from mbm.language.curves import (
    Chord,
    CurveValue,
    Point,
    both,
    chords_of,
    chosen,
    defined,
    equal,
    middle,
    negative,
    opposite,
    out_of_sight,
    positive,
)
from mbm.language.nearest import Bracket, at_knots, distance
from mbm.language.scope import integer, scalar, vector
from mbm.language.values import Array, Builtin, Call, Value, describe
from mbm.language.vocabulary.curves import curve_of
from mbm.text.types import MbmError, Span
from mbm.values import dataclass

STEPS = 7
"""Newton's method from the middle between two places."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Stretch:
    """A part of a curve from ``first`` on; 1 or 0 as the coordinate falls or rises where what is seen begins and ends."""

    first: Expression
    width: Expression
    falls: tuple[Expression, Expression]
    seen: Expression | None = None


def stationary(curve: CurveValue, coordinate: int, number: Expression, span: Span) -> Point:
    """The ``number``-th place (from 1, in the order of the parameter) where a coordinate (from 0) is stationary.

    Without a value (NaN) where there are fewer.

    Raises:
        UndefinedValueError: the curve has no derivative.

    """
    count: Expression = ZERO
    falls: Expression = negate(ONE, span)
    stretches = _stretches(curve, coordinate, span)
    first, width = stretches[0].first, stretches[0].width
    for stretch in stretches:
        change = subtract(*stretch.falls, span)
        turns = multiply(change, change, span)
        if stretch.seen is not None:
            turns = chosen(stretch.seen, turns, ZERO, span)
        count = add(count, turns, span)
        hit = equal(multiply(turns, count, span), number, span)
        first, width = chosen(hit, stretch.first, first, span), chosen(hit, stretch.width, width, span)
        falls = chosen(hit, stretch.falls[0], falls, span)
    last = add(first, width, span)
    point = curve.formula(middle(first, last, span))
    at = _root(curve, point[coordinate], curve.seen_part(first, last), falls, span)
    found = opposite(negative(falls, span), span)
    return tuple(defined(found, each, span) for each in Formula.of(point, curve.parameter).at(at))


def _falling(slope: Formula, place: Expression, span: Span) -> Expression:
    """1 where a slope is negative, else 0."""
    return chosen(negative(slope.at(place)[0], span), ONE, ZERO, span)


def _stretches(curve: CurveValue, coordinate: int, span: Span) -> list[_Stretch]:
    """The chords, and the corners as parts without length."""
    chords = chords_of(curve)
    every = _falls(curve, chords, coordinate, span)
    share = Number(Fraction(1, curve.chords), NONE)
    widths = [multiply(share, subtract(piece.last, piece.first, span), span) for piece in curve.pieces]
    found = []
    for i, (chord, falls) in enumerate(zip(chords, every, strict=True)):
        found.append(_Stretch(first=chord.ends[0], width=widths[i // curve.chords], falls=falls))
        if _is_corner(curve, i) and i + 1 < len(chords):
            found.append(_joint(chord, chords[i + 1], (falls[1], every[i + 1][0]), span))
    if curve.closed:
        found.append(_joint(chords[-1], chords[0], (every[-1][1], every[0][0]), span))
    return found


def _is_corner(curve: CurveValue, i: int) -> bool:
    """Whether chord i ends at a corner."""
    return curve.corners and i % curve.chords == curve.chords - 1


def _falls(curve: CurveValue, chords: list[Chord], coordinate: int, span: Span) -> list[tuple[Expression, Expression]]:
    """Where each chord begins and ends, or is cut: 1 where the coordinate falls there, else 0.

    Where a smooth curve goes on this is one number for both chords: rounding makes and loses no root.
    """
    slopes = [
        Formula.of(derivatives((piece.point[coordinate],), curve.parameter), curve.parameter) for piece in curve.pieces
    ]

    def at_end(i: int, end: int) -> Expression:
        chord = chords[i]
        hidden = chord.depths is not None and out_of_sight(chord.depths[end])
        return ZERO if hidden else _falling(slopes[i // curve.chords], chord.ends[end], span)

    begins = [at_end(i, 0) for i in range(len(chords))]
    found = []
    for i, chord in enumerate(chords):
        goes_on = i + 1 < len(chords) and not _is_corner(curve, i)
        falls = begins[i], begins[i + 1] if goes_on else at_end(i, 1)
        if chord.hidden is not None and chord.cut is not None:
            cut = _falling(slopes[i // curve.chords], chord.cut, span)
            falls = chosen(chord.hidden[0], cut, falls[0], span), chosen(chord.hidden[1], cut, falls[1], span)
        found.append(falls)
    return found


def _joint(before: Chord, after: Chord, falls: tuple[Expression, Expression], span: Span) -> _Stretch:
    """The corner where one chord ends and the next begins."""
    one, other = before.seen(span), after.seen(span)
    seen = None if one is None or other is None else both(one, other, span)
    return _Stretch(first=before.ends[1], width=Number(0), falls=falls, seen=seen)


def _root(
    curve: CurveValue, coordinate: Expression, ends: tuple[Expression, Expression], falls: Expression, span: Span
) -> Expression:
    """The parameter between ``ends`` where the slope of the coordinate, which ``falls`` at the first one, is zero."""
    slope = derivatives((coordinate,), curve.parameter)
    slopes = Formula.of((*slope, *derivatives(slope, curve.parameter)), curve.parameter)
    bracket = Bracket.of(*ends, span)
    at = middle(*ends, span)
    for number in range(STEPS):
        rise, bend = slopes.at(at)
        right = equal(chosen(negative(rise, span), ONE, ZERO, span), falls, span)
        bracket = bracket.narrowed(at, right)
        at = bracket.kept(subtract(at, divide(rise, bend, span), span), number)
    at = apply(Operation.HELD, at, span=span)
    rise, bend = slopes.at(at)
    moved = subtract(at, multiply(rise, apply(Operation.HELD, divide(ONE, bend, span), span=span), span), span)
    length = apply(Operation.HELD, subtract(ends[1], ends[0], span), span=span)
    return chosen(positive(length, span), moved, at_knots(curve, at, span), span)


_NUMBERS_PER_CHORD = 60
"""Numbers that are made for a chord beside those of its ends, about."""


def _curve_distance(call: Call) -> Value:
    curve = curve_of(call.arguments[0], call.forms[0].span)
    p = vector(call.arguments[1], call.forms[1].span, curve.dimension).elements
    spend(call, curve)
    return distance(curve, p, call.span)


def _extrema(call: Call) -> Value:
    curve = curve_of(call.arguments[0], call.forms[0].span)
    if curve.dimension != 2:
        raise MbmError(faults.wrong_kind(call.forms[0].span, "a curve of the plane or of an image", describe(curve)))
    coordinate = integer(call.arguments[1], call.forms[1].span, "the number of a coordinate")
    if coordinate not in (1, 2):
        raise MbmError(faults.bad_index(call.forms[1].span, f"coordinate {coordinate} is neither 1 nor 2"))
    spend(call, curve)

    def place(inner: Call) -> Value:
        number = scalar(inner.arguments[0], inner.forms[0].span, "the number of an extremum")
        if isinstance(number, Number) and (number.value < 1 or number.value != int(number.value)):
            raise MbmError(faults.bad_index(inner.forms[0].span, "extrema are counted from 1"))
        return Array((2,), stationary(curve, coordinate - 1, number, inner.span))

    return Builtin("extrema", "((extrema C 1) n)", "One of the places where a coordinate is stationary.", 1, 1, place)


def spend(call: Call, curve: CurveValue) -> None:
    """Count what is made where a curve is searched.

    Raises:
        MbmError: it is too much.

    """
    formulas = tuple(e for piece in curve.pieces for e in piece.point)
    size = len(depending(formulas, frozenset((curve.parameter,)))) // len(curve.pieces)
    chords = curve.chords * len(curve.pieces)
    call.evaluator.budget.make((size + _NUMBERS_PER_CHORD) * chords, call.form)


FUNCTIONS: tuple[Builtin, ...] = (
    Builtin("extrema", "(extrema C k)", "The points where coordinate k (1 or 2) of a curve of the plane or an image is stationary, in the order of the parameter: `((extrema C k) n)` is one of them.", 2, 2, _extrema),
    Builtin("curve-distance", "(curve-distance C p)", "Distance of a point from the nearest place of a curve; of the plane and of images positive left of its direction.", 2, 2, _curve_distance),
)  # fmt: skip
