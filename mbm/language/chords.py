"""Curves as rows of straight lines: where the nearest place and the stationary ones are looked for."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

from mbm.expression.algebra import add, divide, multiply, subtract
from mbm.expression.dimension import NONE
from mbm.expression.nodes import Expression, Number
from mbm.expression.substitution import Formula
from mbm.language.curves import CurveValue, Piece, Point
from mbm.language.piecewise import both, chosen, less, opposite
from mbm.text.types import Span
from mbm.values import dataclass

NOTHING = Number(0)
"""Zero of whatever dimension it is compared with."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chord:
    """The straight line between two points of a curve, where its parameter is ``first`` and ``last``.

    ``low`` and ``high`` are how far the place on the curve may be from what the line says: the next chords' ends, but
    not beyond a corner. ``seen``: whether there is anything of it; None where there always is.
    """

    first: Expression
    last: Expression
    start: Point
    end: Point
    low: Expression
    high: Expression
    seen: Expression | None = None


def places(piece: Piece, count: int, span: Span) -> list[Expression]:
    """The parameters that divide a piece into ``count`` equal parts, both ends among them."""
    way = subtract(piece.last, piece.first, span)
    inner = [add(piece.first, multiply(Number(Fraction(k, count), NONE), way, span), span) for k in range(1, count)]
    return [piece.first, *inner, piece.last]


def chords_of(curve: CurveValue) -> list[Chord]:
    """The chords of a curve in order."""
    ends = [pair for piece in curve.pieces for pair in _ends(curve, piece)]
    found = []
    last_of_piece = curve.chords - 1
    for i, (first, last, start, end, cut) in enumerate(ends):
        before = i > 0 and not (curve.corners and i % curve.chords == 0)
        after = i + 1 < len(ends) and not (curve.corners and i % curve.chords == last_of_piece)
        low, high = ends[i - 1][0] if before else first, ends[i + 1][1] if after else last
        if cut is not None:
            low, high = chosen(cut.start, first, low, curve.span), chosen(cut.end, last, high, curve.span)
        seen = None if cut is None else cut.seen
        found.append(Chord(first=first, last=last, start=start, end=end, low=low, high=high, seen=seen))
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Cut:
    """Of a stretch whether its ``start`` and its ``end`` are out of sight, and whether anything is ``seen``."""

    start: Expression
    end: Expression
    seen: Expression


_Ends = tuple[Expression, Expression, Point, Point, _Cut | None]


def _ends(curve: CurveValue, piece: Piece) -> Iterator[_Ends]:
    """Of each part of a piece: where it begins and ends, these points, and what of it is out of sight."""
    span, formula = curve.span, Formula.of(piece.point, curve.parameter)
    at = places(piece, curve.chords, span)
    if piece.seen is None:
        points = [formula.at(value) for value in at]
        for i in range(curve.chords):
            yield at[i], at[i + 1], points[i], points[i + 1], None
        return
    depth = Formula.of((piece.seen,), curve.parameter)
    depths = [depth.at(value)[0] for value in at]
    for i in range(curve.chords):
        a, b = depths[i : i + 2]
        cut = _Cut(start=_negative(a, span), end=_negative(b, span), seen=_any_seen(a, b, span))
        between = _crossing((at[i], a), (at[i + 1], b), span)
        first, last = chosen(cut.start, between, at[i], span), chosen(cut.end, between, at[i + 1], span)
        yield first, last, formula.at(first), formula.at(last), cut


def _negative(depth: Expression, span: Span) -> Expression:
    return less(depth, NOTHING, span)


def _any_seen(a: Expression, b: Expression, span: Span) -> Expression:
    return opposite(both(_negative(a, span), _negative(b, span), span), span)


def _crossing(one: tuple[Expression, Expression], other: tuple[Expression, Expression], span: Span) -> Expression:
    """The parameter where the depth is zero, as if it ran straight; anything where its sign does not change."""
    (s, a), (t, b) = one, other
    difference = subtract(a, b, span)
    if isinstance(difference, Number) and difference.value == 0:
        return s
    return add(s, multiply(divide(a, difference, span), subtract(t, s, span), span), span)
