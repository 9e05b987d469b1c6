"""Curves: parametric ones, straight lines through points, cubic splines; and their points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field

from mbm.expression.nodes import Column, Component, Constant, Expression, Number, Parameter
from mbm.language import faults
from mbm.language.coerce import list_items, scalar, vector
from mbm.language.curves import CurveValue, Piece, Point, check_dimension
from mbm.language.scope import LocalScope
from mbm.language.splines import chords, cubic_pieces, straight_pieces
from mbm.language.values import Array, Builtin, Call, Macro, Value, describe
from mbm.text.types import Bracket, Form, Keyword, MbmError, Sequence, Span, Symbol
from mbm.values import dataclass

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
