"""Curves: parametric ones, straight lines through points, cubic splines; and their points.

Splines are natural or periodic, with chord lengths for parameters (de Boor 1978, ch. IV). The second derivatives at the
knots solve a tridiagonal system. Points may hold unknowns, and so may the chord lengths: the elimination is written
out, so that every pivot is one expression that all coordinates share. No pivot is small, for the matrix is diagonally
dominant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from itertools import pairwise

from mbm.expression.algebra import ZERO, add, differences, divide, multiply, negate, subtract, total
from mbm.expression.nodes import Column, Component, Constant, Expression, Number, Parameter
from mbm.expression.units import NONE
from mbm.language import faults
from mbm.language.curves import CurveValue, Piece, Point, check_dimension
from mbm.language.scope import LocalScope, list_items, scalar, vector
from mbm.language.values import Array, Builtin, Call, Macro, Value, describe
from mbm.language.vocabulary.vectors import norm_of
from mbm.text.types import Bracket, Form, Keyword, MbmError, Sequence, Span, Symbol
from mbm.values import dataclass

_TWO, _THREE, _SIX = (Number(n, NONE) for n in (2, 3, 6))


def chords(points: tuple[Point, ...], span: Span) -> tuple[Expression, ...]:
    """The lengths of the straight lines from point to point."""
    return tuple(norm_of(differences(b, a, span), span) for a, b in pairwise(points))


def knots(lengths: tuple[Expression, ...], span: Span) -> tuple[Expression, ...]:
    """The parameter at each point: how long the way to it is."""
    found: list[Expression] = [Number(0)]
    for length in lengths:
        found.append(add(found[-1], length, span))
    return tuple(found)


def straight_pieces(points: tuple[Point, ...], parameter: Parameter, span: Span) -> tuple[Piece, ...]:
    """The straight lines through (n, 2 or 3) points."""
    lengths = chords(points, span)
    places = knots(lengths, span)
    found = []
    for i, length in enumerate(lengths):
        share = divide(subtract(parameter, places[i], span), length, span)
        way = differences(points[i + 1], points[i], span)
        point = tuple(add(a, multiply(share, d, span), span) for a, d in zip(points[i], way, strict=True))
        found.append(Piece(first=places[i], last=places[i + 1], point=point))
    return tuple(found)


def cubic_pieces(points: tuple[Point, ...], parameter: Parameter, span: Span, *, closed: bool) -> tuple[Piece, ...]:
    """The cubic spline through (n, 2 or 3) points: without curvature at its ends, or back to the first point."""
    if closed:
        points = (*points, points[0])
    lengths = chords(points, span)
    bent = _periodic(points, lengths, span) if closed else _natural(points, lengths, span)
    return _pieces(points, lengths, bent, parameter, span)


def _pieces(
    points: tuple[Point, ...], lengths: tuple[Expression, ...], bent: tuple[Point, ...], at: Parameter, span: Span
) -> tuple[Piece, ...]:
    """The cubics with the second derivatives ``bent`` at the knots."""
    places = knots(lengths, span)
    found = []
    for i, length in enumerate(lengths):
        along = subtract(at, places[i], span)
        corners = zip(points[i], points[i + 1], bent[i], bent[i + 1], strict=True)
        point = tuple(_cubic(a, b, (p, q), length, along) for a, b, p, q in corners)
        found.append(Piece(first=places[i], last=places[i + 1], point=point))
    return tuple(found)


def _cubic(
    a: Expression, b: Expression, bent: tuple[Expression, Expression], length: Expression, along: Expression
) -> Expression:
    """a + u (slope + u (p/2 + u (q − p)/(6 h))), where slope = (b − a)/h − h (2 p + q)/6."""
    (p, q), span = bent, None
    slope = divide(subtract(b, a, span), length, span)
    fall = divide(multiply(length, add(multiply(_TWO, p), q)), _SIX)
    third = divide(subtract(q, p), multiply(_SIX, length))
    second = add(divide(p, _TWO), multiply(along, third))
    return add(a, multiply(along, add(subtract(slope, fall), multiply(along, second))))


def _loads(points: tuple[Point, ...], lengths: tuple[Expression, ...], i: int, span: Span) -> Point:
    """Six times the change of slope at the end of chord ``i`` − 1, where chord ``i`` begins."""
    before = [divide(e, lengths[i - 1], span) for e in differences(points[i], points[i - 1], span)]
    j = i % len(lengths)
    after = [divide(e, lengths[j], span) for e in differences(points[j + 1], points[j], span)]
    return tuple(multiply(_SIX, subtract(b, a, span), span) for a, b in zip(before, after, strict=True))


def _natural(points: tuple[Point, ...], lengths: tuple[Expression, ...], span: Span) -> tuple[Point, ...]:
    level = tuple(Number(0) for _ in points[0])
    inner = range(1, len(points) - 1)
    diagonal = [multiply(_TWO, add(lengths[i - 1], lengths[i], span), span) for i in inner]
    solved = _tridiagonal(diagonal, list(lengths[1:-1]), [_loads(points, lengths, i, span) for i in inner], span)
    return (level, *solved, level)


def _periodic(points: tuple[Point, ...], lengths: tuple[Expression, ...], span: Span) -> tuple[Point, ...]:
    """The second derivative at the first knot is taken to the right side, and follows from its own equation."""
    count = len(lengths)
    inner = range(1, count)
    diagonal = [multiply(_TWO, add(lengths[i - 1], lengths[i], span), span) for i in inner]
    loads = [_loads(points, lengths, i, span) for i in inner]
    effect: list[Expression] = [ZERO] * (count - 1)
    effect[0] = negate(lengths[0], span)
    effect[-1] = subtract(effect[-1], lengths[-1], span)
    columns = [(*load, each) for load, each in zip(loads, effect, strict=True)]
    solved = _tridiagonal(diagonal, list(lengths[1:-1]), columns, span)
    own = multiply(_TWO, add(lengths[-1], lengths[0], span), span)
    own = total((own, multiply(lengths[0], solved[0][-1], span), multiply(lengths[-1], solved[-1][-1], span)), span)
    first = []
    for j, load in enumerate(_loads(points, lengths, count, span)):
        ends = add(multiply(lengths[0], solved[0][j], span), multiply(lengths[-1], solved[-1][j], span), span)
        first.append(divide(subtract(load, ends, span), own, span))
    rest = [tuple(add(row[j], multiply(row[-1], f, span), span) for j, f in enumerate(first)) for row in solved]
    return (tuple(first), *rest, tuple(first))


def _tridiagonal(
    diagonal: list[Expression], beside: list[Expression], loads: list[Point], span: Span
) -> list[tuple[Expression, ...]]:
    """The solutions of a symmetric tridiagonal system, one column for each number of a row of ``loads``."""
    pivots, right = list(diagonal), [list(load) for load in loads]
    for i, off in enumerate(beside):
        factor = divide(off, pivots[i], span)
        pivots[i + 1] = subtract(pivots[i + 1], multiply(factor, off, span), span)
        right[i + 1] = [
            subtract(b, multiply(factor, a, span), span) for a, b in zip(right[i], right[i + 1], strict=True)
        ]
    for i in reversed(range(len(pivots))):
        if i + 1 < len(pivots):
            pairs = zip(right[i], right[i + 1], strict=True)
            right[i] = [subtract(b, multiply(beside[i], a, span), span) for b, a in pairs]
        right[i] = [divide(b, pivots[i], span) for b in right[i]]
    return [tuple(row) for row in right]


CURVE_USAGE = "(curve (s first last) [x y z])"
POLYLINE_USAGE = "(polyline (v…))"
SPLINE_USAGE = "(spline (v…) [:closed true])"

CHORDS = 64
SPLINE_CHORDS = 4
"""Straight lines in which the nearest place is looked for: in a parametric curve, in each piece of a spline."""

_NUMBERS_PER_PIECE = 60
"""Numbers that are made for a piece of a spline, about, in all coordinates."""


@dataclass(frozen=True, slots=True, eq=False)
class CurveMaker(Macro):
    """A form that makes a curve; it takes points and names as they are written."""

    name: str
    usage: str
    doc: str
    function: Callable[[Call], CurveValue] = field(repr=False)

    def call(self, call: Call) -> CurveValue:
        """The curve.

        Raises:
            MbmError: with a diagnostic at the innermost form that is wrong.
            StaticColumnNeeded: the value of a data column decides what the curve is.

        """
        return self.function(call)


def _parametric(call: Call) -> CurveValue:
    range_form = call.forms[0] if len(call.forms) == 2 else None
    if not isinstance(range_form, Sequence) or len(range_form.items) != 3:
        raise MbmError(faults.bad_form(call.span, "this `curve` is not complete", CURVE_USAGE))
    name, *ends = range_form.items
    if not isinstance(name, Symbol):
        raise MbmError(faults.bad_form(name.span, "the parameter of a curve is a name", CURVE_USAGE))
    first, last = (scalar(call.evaluator.wanted(end, call.scope), end.span) for end in ends)
    parameter = Parameter(name.name, name.span)
    body = call.forms[1]
    found = call.evaluator.wanted(body, LocalScope({name.name: parameter}, call.scope))
    point = check_dimension(vector(found, body.span), body.span)
    piece = Piece(first=first, last=last, point=point)
    return CurveValue(parameter=parameter, pieces=(piece,), span=call.span, chords=CHORDS)


def _polyline(call: Call) -> CurveValue:
    if len(call.forms) != 1:
        raise MbmError(faults.wrong_arity(call.span, "polyline", POLYLINE_USAGE, len(call.forms)))
    points = _points(call, call.forms[0], 2)
    parameter = Parameter("s", call.span)
    closed = len(points) > 3 and all(map(_same, points[0], points[-1]))
    pieces = straight_pieces(points, parameter, call.span)
    return CurveValue(parameter=parameter, pieces=pieces, span=call.span, closed=closed, corners=True, chords=1)


def _same(a: Expression, b: Expression) -> bool:
    """Whether two coordinates are one: the same number or the same name."""
    if isinstance(a, Number) and isinstance(b, Number):
        return a.value == b.value
    return isinstance(a, Component | Constant | Column) and isinstance(b, type(a)) and _name(a) == _name(b)


def _name(leaf: Component | Constant | Column) -> object:
    return leaf.name if isinstance(leaf, Constant) else leaf.identity


def _spline(call: Call) -> CurveValue:
    closed = False
    if len(call.forms) not in (1, 3):
        raise MbmError(faults.bad_form(call.span, "a spline takes its points", SPLINE_USAGE))
    if len(call.forms) == 3:
        option, answer = call.forms[1:]
        if not isinstance(option, Keyword) or option.name != "closed":
            raise MbmError(faults.bad_form(option.span, "the option of a spline is `:closed`", SPLINE_USAGE))
        value = call.evaluator.wanted(answer, call.scope)
        if not isinstance(value, bool):
            raise MbmError(faults.wrong_kind(answer.span, "true or false", describe(value)))
        closed = value
    points = _points(call, call.forms[0], 3 if closed else 2, closed=closed)
    parameter = Parameter("s", call.span)
    pieces = cubic_pieces(points, parameter, call.span, closed=closed)
    return CurveValue(parameter=parameter, pieces=pieces, span=call.span, closed=closed, chords=SPLINE_CHORDS)


def _points(call: Call, form: Form, fewest: int, *, closed: bool = False) -> tuple[Point, ...]:
    """The points that are written, or that a form gives; neighbours are apart."""
    given = _written(call, form)
    if len(given) < fewest:
        raise MbmError(faults.bad_form(form.span, f"a curve through points takes at least {fewest}", call_usage(call)))
    call.evaluator.budget.make(_NUMBERS_PER_PIECE * len(given), call.form)
    arrays = [(vector(value, span), span) for value, span in given]
    wanted = arrays[0][0].shape[0]
    points = tuple(check_dimension(a, s, wanted if i else None) for i, (a, s) in enumerate(arrays))
    around = (*points, points[0]) if closed else points
    for i, length in enumerate(chords(around, call.span)):
        if isinstance(length, Number) and length.value == 0:
            _, span = arrays[(i + 1) % len(arrays)]
            message = f"the points {i + 1} and {(i + 1) % len(arrays) + 1} of this curve are the same"
            raise MbmError(faults.bad_form(span, message, "leave one out; `:closed true` needs no point twice"))
    return points


def call_usage(call: Call) -> str:
    """How the form at hand is written."""
    return SPLINE_USAGE if call.form.head == "spline" else POLYLINE_USAGE


def _written(call: Call, form: Form) -> list[tuple[Value, Span]]:
    """The values of a row of points with their places: each point is a form, or one form gives all of them.

    A round list is the row itself, unless a function stands at its head.
    """
    words = call.evaluator.vocabulary
    head = form.head if isinstance(form, Sequence) else None
    is_called = head is not None and (head in words.functions or head in words.special_forms)
    if isinstance(form, Sequence) and form.bracket is Bracket.ROUND and not is_called:
        call.evaluator.budget.check_length(len(form.items), form)
        return [(call.evaluator.wanted(item, call.scope), item.span) for item in form.items]
    value = call.evaluator.wanted(form, call.scope)
    return [(item, form.span) for item in list_items(value, form.span)]


def curve_of(value: Value, span: Span) -> CurveValue:
    """A curve.

    Raises:
        MbmError: something else.

    """
    if not isinstance(value, CurveValue):
        raise MbmError(faults.wrong_kind(span, "a curve", describe(value)))
    return value


def _curve_point(call: Call) -> Value:
    curve = curve_of(call.arguments[0], call.forms[0].span)
    at = scalar(call.arguments[1], call.forms[1].span)
    call.evaluator.budget.make(curve.dimension * len(curve.pieces), call.form)
    return Array((curve.dimension,), curve.at(at))


FUNCTIONS: tuple[CurveMaker | Builtin, ...] = (
    CurveMaker("curve", CURVE_USAGE, "The curve that a vector of 2 or 3 numbers runs through while s runs from first to last.", _parametric),
    CurveMaker("polyline", POLYLINE_USAGE, "The straight lines from point to point; the parameter is the length of the way.", _polyline),
    CurveMaker("spline", SPLINE_USAGE, "The natural cubic spline through points, with the lengths of its chords for parameters; closed, it runs back to the first point.", _spline),
    Builtin("curve-point", "(curve-point C s)", "The point of a curve where its parameter is s.", 2, 2, _curve_point),
)  # fmt: skip
