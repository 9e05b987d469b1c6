"""Curves as rows of straight lines: where the nearest place and the stationary ones are looked for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

from mbm.expression.algebra import add, divide, multiply, subtract
from mbm.expression.dimension import NONE
from mbm.expression.nodes import Expression, Number
from mbm.expression.substitution import Formula
from mbm.language.curves import CurveValue, Piece, Point
from mbm.language.piecewise import both, chosen, negative, opposite
from mbm.text.types import Span
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chord:
    """The straight line between two points of a curve, ``start`` and ``end``, where its parameter is ``places``.

    ``first`` and ``last`` bound what is seen of this part of the curve: ``hidden`` says whether its beginning and its
    end are out of sight; None: nothing ever is. Of a part that is seen in part, ``start`` and ``end`` are both the end
    that is seen. ``low`` and ``high`` are how far the place on the curve may be from what the line says: the next
    chords' ends, but not beyond a corner.
    """

    places: tuple[Expression, Expression]
    start: Point
    end: Point
    first: Expression
    last: Expression
    low: Expression
    high: Expression
    hidden: tuple[Expression, Expression] | None = None

    def seen(self, span: Span) -> Expression | None:
        """Whether there is anything of it; None where there always is."""
        return None if self.hidden is None else opposite(both(self.hidden[0], self.hidden[1], span), span)


def places(piece: Piece, count: int, span: Span) -> list[Expression]:
    """The parameters that divide a piece into ``count`` equal parts, both ends among them."""
    way = subtract(piece.last, piece.first, span)
    inner = [add(piece.first, multiply(Number(Fraction(k, count), NONE), way, span), span) for k in range(1, count)]
    return [piece.first, *inner, piece.last]


def chords_of(curve: CurveValue) -> list[Chord]:
    """The chords of a curve in order."""
    found = [chord for piece in curve.pieces for chord in _parts(curve, piece)]
    bounded = []
    for i, chord in enumerate(found):
        before = i > 0 and not (curve.corners and i % curve.chords == 0)
        after = i + 1 < len(found) and not (curve.corners and (i + 1) % curve.chords == 0)
        low, high = found[i - 1].first if before else chord.first, found[i + 1].last if after else chord.last
        if chord.hidden is not None:
            low = chosen(chord.hidden[0], chord.first, low, curve.span)
            high = chosen(chord.hidden[1], chord.last, high, curve.span)
        bounded.append(replace(chord, low=low, high=high))
    return bounded


def _parts(curve: CurveValue, piece: Piece) -> Iterator[Chord]:
    """The chords of a piece, each by itself."""
    formula = Formula.of(piece.point, curve.parameter)
    at = places(piece, curve.chords, curve.span)
    depth = None if piece.seen is None else Formula.of((piece.seen,), curve.parameter)
    depths = None if depth is None else [depth.at(place)[0] for place in at]
    points = (
        [formula.at(place) for place in at]
        if depths is None
        else [_shown(formula, *each) for each in zip(at, depths, strict=True)]
    )
    for i, (a, b) in enumerate(pairwise(at)):
        whole = Chord(places=(a, b), start=points[i], end=points[i + 1], first=a, last=b, low=a, high=b)
        yield whole if depths is None else _cut(whole, (depths[i], depths[i + 1]), curve.span)


def out_of_sight(depth: Expression) -> bool:
    """Whether it is known before any unknown is that nothing is seen at such a depth."""
    return isinstance(depth, Number) and depth.value < 0


def _shown(formula: Formula, place: Expression, depth: Expression) -> Point:
    """The point at a place. What is known to be out of sight may have none (in the plane of the camera): it is never
    looked at, and zeros stand for it.
    """
    return (Number(0),) * len(formula.roots) if out_of_sight(depth) else formula.at(place)


def _cut(chord: Chord, depths: tuple[Expression, Expression], span: Span) -> Chord:
    """What is seen of a chord of whose ends these are the depths; negative ones are out of sight."""
    hidden = negative(depths[0], span), negative(depths[1], span)
    (a, b), between = chord.places, _crossing(chord.places, depths, span)
    first, last = chosen(hidden[0], between, a, span), chosen(hidden[1], between, b, span)
    return Chord(
        places=(chosen(hidden[0], b, a, span), chosen(hidden[1], a, b, span)),
        start=_either(hidden[0], chord.end, chord.start, span),
        end=_either(hidden[1], chord.start, chord.end, span),
        first=first,
        last=last,
        low=first,
        high=last,
        hidden=hidden,
    )


def _either(test: Expression, one: Point, other: Point, span: Span) -> Point:
    return tuple(chosen(test, a, b, span) for a, b in zip(one, other, strict=True))


def _crossing(places: tuple[Expression, Expression], depths: tuple[Expression, Expression], span: Span) -> Expression:
    """The parameter where the depth is zero, as if it ran straight; anything where its sign does not change."""
    (s, t), difference = places, subtract(depths[0], depths[1], span)
    if isinstance(difference, Number) and difference.value == 0:
        return s
    return add(s, multiply(divide(depths[0], difference, span), subtract(t, s, span), span), span)
