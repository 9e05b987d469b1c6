"""Curves as values: points in terms of a parameter, piece by piece.

The coordinates are expressions in the parameter, the unknowns and the columns, so that a curve that was moved or
projected is a curve again, and everything about it is differentiated as any other form is.

The pieces of a spline are one cubic with other coefficients, whatever moved and projected it. To choose the
coefficients is a choice among numbers; what is made of them is then computed once, not once for each piece. Rows of
straight lines say where the nearest place and the stationary ones are looked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import groupby, pairwise

from mbm.expression.algebra import ONE, ZERO, add, apply, divide, multiply, negate, subtract
from mbm.expression.derivative import Formula, depending, substituted
from mbm.expression.nodes import Apply, Expression, Number, Operation, Parameter
from mbm.expression.units import NONE
from mbm.language import faults
from mbm.language.values import Array, Placeable, Transform
from mbm.language.vocabulary.vectors import move_point
from mbm.text.types import MbmError, Span
from mbm.values import dataclass

Formulas = tuple[Expression, ...]

_HALF = Number(Fraction(1, 2), NONE)

LEVELS = 200
"""So deep formulas are compared; below, the whole of each is computed and one chosen."""


def less(a: Expression, b: Expression, span: Span) -> Apply:
    """a < b."""
    return Apply(Operation.LESS, (a, b), span=span)


def both(a: Expression, b: Expression, span: Span) -> Apply:
    """a and b."""
    return Apply(Operation.AND, (a, b), span=span)


def negative(a: Expression, span: Span) -> Apply:
    """a < 0, whatever the dimension."""
    return less(a, Number(0), span)


def positive(a: Expression, span: Span) -> Apply:
    """0 < a, whatever the dimension."""
    return less(Number(0), a, span)


def equal(a: Expression, b: Expression, span: Span) -> Apply:
    """a = b."""
    return Apply(Operation.EQUAL, (a, b), span=span)


def opposite(a: Expression, span: Span) -> Apply:
    """Not a."""
    return Apply(Operation.NOT, (a,), span=span)


def either(a: Expression, b: Expression, span: Span) -> Apply:
    """a or b."""
    return Apply(Operation.OR, (a, b), span=span)


def middle(a: Expression, b: Expression, span: Span) -> Expression:
    """(a + b)/2."""
    return multiply(_HALF, add(a, b, span), span)


def defined(test: Expression, value: Expression, span: Span) -> Expression:
    """``value`` where the test holds; elsewhere the root of a negative number, which is NaN."""
    sign = chosen(test, ONE, negate(ONE, span), span)
    return multiply(apply(Operation.SQRT, sign, span=span), value, span)


def chosen(test: Expression, then: Expression, other: Expression, span: Span) -> Expression:
    """``then`` where the test holds, else ``other``."""
    return then if _same(then, other) else apply(Operation.IF, test, then, other, span=span)


def merged(pieces: tuple[Formulas, ...], before: tuple[Expression, ...], parameter: Parameter, span: Span) -> Formulas:
    """The formulas of the first of ``pieces`` whose test in ``before`` holds, of the last one where none does."""
    every = tuple(formula for piece in pieces for formula in piece)
    merger = _Merger({id(node) for node in depending(every, frozenset((parameter,)))}, parameter, span)
    return tuple(merger.merge(column, before) for column in zip(*pieces, strict=True))


class _Merger:
    """Goes down as long as formulas that hold the parameter do the same; local to one merging."""

    def __init__(self, depending_on_parameter: set[int], parameter: Parameter, span: Span) -> None:
        self._depending = depending_on_parameter
        self._parameter = parameter
        self._span = span
        self._memo: dict[tuple[tuple[int, ...], tuple[int, ...]], Expression] = {}

    def merge(self, nodes: Formulas, before: Formulas, level: int = 0) -> Expression:
        """One formula of those of several pieces in a row; ``before`` has one test less."""
        if all(_same(nodes[0], node) for node in nodes[1:]):
            return nodes[0]
        key = (tuple(map(id, nodes)), tuple(map(id, before)))
        if key not in self._memo:
            self._memo[key] = self._merged(nodes, before, level)
        return self._memo[key]

    def _merged(self, nodes: Formulas, before: Formulas, level: int) -> Expression:
        runs = [list(run) for _, run in groupby(range(len(nodes)), key=lambda i: self._kind(nodes[i]))]
        whole = [self._alike(nodes[r[0] : r[-1] + 1], before[r[0] : r[-1]], level) for r in runs]
        found = whole[-1]
        for run, formula in zip(reversed(runs[:-1]), reversed(whole[:-1]), strict=True):
            found = chosen(before[run[-1]], formula, found, self._span)
        return found

    def _kind(self, node: Expression) -> object:
        if node is self._parameter:
            return self._parameter.name
        if id(node) not in self._depending or not isinstance(node, Apply):
            return None
        return (node.operation, len(node.arguments), node.output)

    def _alike(self, nodes: Formulas, before: Formulas, level: int) -> Expression:
        """One formula of several of one kind."""
        first = nodes[0]
        if len(nodes) > 1 and level < LEVELS and isinstance(first, Apply) and id(first) in self._depending:
            columns = zip(*(node.arguments for node in nodes if isinstance(node, Apply)), strict=True)
            arguments = tuple(self.merge(column, before, level + 1) for column in columns)
            if first.output is not None:
                return Apply(first.operation, arguments, first.angle, first.span, first.output)
            return apply(first.operation, *arguments, span=first.span)
        found = nodes[-1]
        for node, test in zip(reversed(nodes[:-1]), reversed(before), strict=True):
            found = chosen(test, node, found, self._span)
        return found


def _same(a: Expression, b: Expression) -> bool:
    """Whether two nodes are one, or the same number."""
    if isinstance(a, Number) and isinstance(b, Number):
        return (a.value, a.dimension, a.angle) == (b.value, b.dimension, b.angle)
    return a is b


Point = tuple[Expression, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Piece:
    """A stretch of a curve, from ``first`` to ``last`` of its parameter; ``point`` holds the parameter.

    ``seen``, if there is such a limit, holds it too: the curve is seen where this is not negative.
    """

    first: Expression
    last: Expression
    point: Point
    seen: Expression | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CurveValue(Placeable):
    """A curve of the plane or of space; each of its ``pieces`` begins where the one before it ends.

    ``closed``: it is known to end where it begins. ``corners``: pieces may meet at an angle. ``chords``: so many
    straight lines in each piece are a picture of it in which the nearest place can be looked for; with 1 they are
    the curve.
    """

    parameter: Parameter
    pieces: tuple[Piece, ...]
    span: Span
    closed: bool = False
    corners: bool = False
    chords: int = 16

    @property
    def kind(self) -> str:
        """How messages call it."""
        return "a curve of the plane" if self.dimension == 2 else "a curve"

    @property
    def dimension(self) -> int:
        """How many coordinates its points have."""
        return len(self.pieces[0].point)

    @property
    def first(self) -> Expression:
        """The parameter where it begins."""
        return self.pieces[0].first

    @property
    def last(self) -> Expression:
        """The parameter where it ends."""
        return self.pieces[-1].last

    def moved(self, by: Transform) -> CurveValue:
        """The curve after ``by``."""
        return self.mapped(lambda point: move_point(by, Array((len(point),), point), self.span).elements)

    def as_point(self) -> Array | None:
        """A curve is no point."""
        return None

    def mapped(self, function: Callable[[Point], Point]) -> CurveValue:
        """The curve of the points that ``function`` makes of its points."""
        return replace(self, pieces=tuple(replace(piece, point=function(piece.point)) for piece in self.pieces))

    def at(self, value: Expression) -> Point:
        """The point where the parameter is ``value``; beyond an end the formula of the last piece there goes on."""
        return substituted(self.formula(value), {self.parameter: value})

    def formula(self, near: Expression) -> Point:
        """The points in terms of the parameter, by the formula of the piece that ``near``, a parameter, lies in."""
        return self._merged(near, tuple(piece.point for piece in self.pieces))

    def _merged(self, near: Expression, formulas: tuple[Formulas, ...]) -> Formulas:
        """Of formulas of each piece those of the piece that ``near``, a parameter, lies in."""
        knots = [piece.last for piece in self.pieces[:-1]]
        if isinstance(near, Number) and all(isinstance(knot, Number) for knot in knots):
            passed = sum(isinstance(knot, Number) and knot.value <= near.value for knot in knots)
            return formulas[passed]
        before = tuple(less(near, knot, self.span) for knot in knots)
        return merged(formulas, before, self.parameter, self.span)

    def seen_part(self, first: Expression, last: Expression) -> tuple[Expression, Expression]:
        """The ends of what is seen of a part within one piece, at one of whose ends something is."""
        seen = tuple((piece.seen,) for piece in self.pieces if piece.seen is not None)
        if len(seen) < len(self.pieces):
            return first, last
        depth = Formula.of(self._merged(middle(first, last, self.span), seen), self.parameter)
        depths = depth.at(first)[0], depth.at(last)[0]
        between = _crossing((first, last), depths, self.span)
        begins, ends = (negative(each, self.span) for each in depths)
        return chosen(begins, between, first, self.span), chosen(ends, between, last, self.span)


def in_space(curve: CurveValue) -> CurveValue:
    """The curve with three coordinates: one of the plane lies in z = 0."""
    return curve.mapped(lambda point: (*point, ZERO)) if curve.dimension == 2 else curve


def check_dimension(point: Array, span: Span, wanted: int | None = None) -> Point:
    """The coordinates of a point of a curve.

    Raises:
        MbmError: neither 2 nor 3 of them, or not ``wanted``.

    """
    count = point.shape[0]
    if count not in (2, 3) or wanted not in (None, count):
        numbers = "2 or 3" if wanted is None else f"{wanted}, as the first"
        raise MbmError(faults.length_clash(span, f"a point of {count} numbers", f"a curve (points have {numbers})"))
    return point.elements


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chord:
    """The straight line between two points of a curve, ``start`` and ``end``, where its parameter is ``places``.

    ``ends`` are those of its part of the curve, ``first`` and ``last`` bound what is seen of it: ``hidden`` says
    whether its beginning and its end, which have ``depths``, are out of sight, and ``cut`` is where it comes into
    sight or goes out of it; None: all of the curve is always seen. Of a part that is seen in part, ``start`` and
    ``end`` are both the end that is seen. ``low`` and ``high`` are how far the place on the curve may be from what
    the line says: the next chords' ends, but not beyond a corner.
    """

    places: tuple[Expression, Expression]
    ends: tuple[Expression, Expression]
    start: Point
    end: Point
    first: Expression
    last: Expression
    low: Expression
    high: Expression
    hidden: tuple[Expression, Expression] | None = None
    depths: tuple[Expression, Expression] | None = None
    cut: Expression | None = None

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
        ends, (start, end) = (a, b), points[i : i + 2]
        whole = Chord(places=ends, ends=ends, start=start, end=end, first=a, last=b, low=a, high=b)
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
        ends=chord.ends,
        start=_either(hidden[0], chord.end, chord.start, span),
        end=_either(hidden[1], chord.start, chord.end, span),
        first=first,
        last=last,
        low=first,
        high=last,
        hidden=hidden,
        depths=depths,
        cut=between,
    )


def _either(test: Expression, one: Point, other: Point, span: Span) -> Point:
    return tuple(chosen(test, a, b, span) for a, b in zip(one, other, strict=True))


def _crossing(places: tuple[Expression, Expression], depths: tuple[Expression, Expression], span: Span) -> Expression:
    """The parameter where the depth is zero, as if it ran straight; anything where its sign does not change."""
    (s, t), difference = places, subtract(depths[0], depths[1], span)
    if isinstance(difference, Number) and difference.value == 0:
        return s
    return add(s, multiply(divide(depths[0], difference, span), subtract(t, s, span), span), span)
