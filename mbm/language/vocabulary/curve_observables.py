"""What is measured of curves: distances from them, and where a coordinate is stationary."""

from __future__ import annotations

from mbm.expression.nodes import Number
from mbm.expression.substitution import depending
from mbm.language import faults
from mbm.language.coerce import integer, scalar, vector
from mbm.language.curves import CurveValue
from mbm.language.nearest import distance
from mbm.language.stationary import stationary
from mbm.language.values import Array, Builtin, Call, Value, describe
from mbm.language.vocabulary.curves import curve_of
from mbm.text.types import MbmError

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
