"""The place of a curve that is nearest to a point.

It is looked for among the chords of the curve, of which two are followed: the nearest, and the nearest of those that
are nearer than the next chord on either side. From there Newton's method, kept between the chords beside, finds where
the way to the point is square to the curve; the nearer of both is the answer. All of this is held: the derivative of a
distance does not depend on how its foot moves, for along the curve the distance is stationary (envelope theorem).
"""

from __future__ import annotations

from functools import partial, reduce
from itertools import pairwise

from mbm.expression.algebra import ONE, ZERO, add, apply, differences, divide, dot, multiply, negate, subtract
from mbm.expression.derivative import Formula, derivatives
from mbm.expression.nodes import Apply, Expression, Number, Operation
from mbm.expression.units import NONE
from mbm.language.curves import (
    Chord,
    CurveValue,
    Piece,
    Point,
    both,
    chords_of,
    chosen,
    defined,
    either,
    equal,
    less,
    middle,
    negative,
    opposite,
    out_of_sight,
    positive,
)
from mbm.text.types import Span
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bracket:
    """Between ``low`` and ``high`` lies what is looked for; it began with ``ends``."""

    low: Expression
    high: Expression
    ends: tuple[Expression, Expression]
    span: Span

    @classmethod
    def of(cls, low: Expression, high: Expression, span: Span) -> Bracket:
        """The bracket at the beginning."""
        return cls(low=low, high=high, ends=(low, high), span=span)

    def narrowed(self, at: Expression, right: Expression) -> Bracket:
        """What is left of it where ``right`` says whether what is looked for lies right of ``at``."""
        low, high = chosen(right, at, self.low, self.span), chosen(right, self.high, at, self.span)
        return Bracket(low=low, high=high, ends=self.ends, span=self.span)

    def left(self, number: int) -> Expression:
        """Where a step goes that would leave it on the left: half the way, every other time to the end itself.

        An end may be what is looked for. Steps are counted by ``number`` from 0.
        """
        return self._outside(self.low, self.ends[0], number)

    def right(self, number: int) -> Expression:
        """The same on the right."""
        return self._outside(self.high, self.ends[1], number)

    def kept(self, step: Expression, number: int) -> Expression:
        """Where a step leads."""
        found = chosen(less(self.high, step, self.span), self.right(number), step, self.span)
        return chosen(less(step, self.low, self.span), self.left(number), found, self.span)

    def _outside(self, bound: Expression, end: Expression, number: int) -> Expression:
        half = middle(self.low, self.high, self.span)
        return half if number % 2 else chosen(equal(bound, end, self.span), end, half, self.span)


FIRST_STEPS = 5
"""Newton's method from a chord; its error is squared in each step and begins at some hundredths."""

LAST_STEPS = 4
"""From the nearer of both, by the formula of the piece that the foot is in."""

_FAR = 1e300
"""The squared distance from what is out of sight."""

_ROUNDED = Number(1e-26, NONE)
"""Square of the share of a coordinate by which a point may be off a curve that it lies on, by rounding."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Foot:
    """Where a curve is nearest to a point: its parameter ``at``, held; the point of the curve there and its slope.

    ``fixed``: whether an end or a corner is nearest, where the way to the point need not be square to the curve.
    ``seen``: whether there is anything to be near to; None where there always is.
    """

    at: Expression
    point: Point
    slope: Point
    fixed: Expression
    seen: Expression | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Candidate:
    """A place on a chord: the squared distance, the parameter, and how far from it the foot may be."""

    squared: Expression
    at: Expression
    low: Expression
    high: Expression


def foot_of(curve: CurveValue, p: Point, span: Span) -> Foot:
    """The nearest place to ``p``.

    Raises:
        UndefinedValueError: the curve has no derivative.

    """
    chords = chords_of(curve)
    candidates = [_on_chord(chord, p, span) for chord in chords]
    best = reduce(partial(_nearer, span), candidates)
    if curve.chords > 1:
        second = _second(candidates, best, span) if len(candidates) > 2 else best
        best = _nearer(span, *(_refined(curve, each, p, FIRST_STEPS, span) for each in (best, second)))
        best = _refined(curve, best, p, LAST_STEPS, span)
    at, low, high = (apply(Operation.HELD, each, span=span) for each in (best.at, best.low, best.high))
    point = curve.formula(_within(curve, at, low, high, span))
    slope = derivatives(point, curve.parameter)
    formula = Formula.of((*point, *slope), curve.parameter).at(at_knots(curve, at, span))
    inside = both(less(low, at, span), less(at, high, span), span)
    return Foot(
        at=at,
        point=formula[: len(point)],
        slope=formula[len(point) :],
        fixed=opposite(inside, span),
        seen=_any_seen(chords, span),
    )


def _any_seen(chords: list[Chord], span: Span) -> Expression | None:
    """Whether there is anything of a curve; None where there always is."""
    every = [seen for seen in (chord.seen(span) for chord in chords) if seen is not None]
    return reduce(lambda a, b: either(a, b, span), every) if every else None


def at_knots(curve: CurveValue, at: Expression, span: Span) -> Expression:
    """A parameter that is held, but not where it is that of an end or a corner: there the curve may lead it along."""
    knots = [curve.first, *(piece.last for piece in curve.pieces if curve.corners), curve.last]
    for knot in knots:
        if not isinstance(knot, Number):
            at = chosen(equal(at, knot, span), knot, at, span)
    return at


def _within(curve: CurveValue, at: Expression, low: Expression, high: Expression, span: Span) -> Expression:
    """A parameter in the piece that counts: at a corner, where two meet, that which was followed."""
    return middle(low, high, span) if curve.corners else at


def _on_chord(chord: Chord, p: Point, span: Span) -> _Candidate:
    """The nearest place of a chord."""
    way, r = differences(chord.end, chord.start, span), differences(p, chord.start, span)
    length = dot(way, way, span)
    share: Expression = ZERO
    if not isinstance(length, Number) or length.value != 0:
        share = divide(dot(r, way, span), length, span)
        share = apply(Operation.MINIMUM, apply(Operation.MAXIMUM, share, ZERO, span=span), ONE, span=span)
        if not isinstance(length, Number):
            share = chosen(positive(length, span), share, ZERO, span)
    rest = tuple(subtract(a, multiply(share, b, span), span) for a, b in zip(r, way, strict=True))
    # Exactly the one end or the other where the share is 0 or 1.
    at = dot((subtract(ONE, share, span), share), chord.places, span)
    squared, seen = dot(rest, rest, span), chord.seen(span)
    if seen is not None:
        squared = chosen(seen, squared, Number(_FAR), span)
    return _Candidate(squared=squared, at=at, low=chord.low, high=chord.high)


def _second(candidates: list[_Candidate], best: _Candidate, span: Span) -> _Candidate:
    """The nearest, but for the best one, of those that are nearer than their neighbours; the best if it is alone."""
    farthest = candidates[0].squared
    for candidate in candidates[1:]:
        farthest = apply(Operation.MAXIMUM, farthest, candidate.squared, span=span)
    second = _Candidate(squared=farthest, at=best.at, low=best.low, high=best.high)
    for i, candidate in enumerate(candidates):
        tests: list[Expression] = [opposite(equal(best.at, candidate.at, span), span)]
        tests.append(Apply(Operation.LESS_EQUAL, (candidate.squared, second.squared), span=span))
        if i > 0:
            tests.append(Apply(Operation.LESS_EQUAL, (candidate.squared, candidates[i - 1].squared), span=span))
        if i + 1 < len(candidates):
            tests.append(less(candidate.squared, candidates[i + 1].squared, span))
        test = tests[0]
        for each in tests[1:]:
            test = both(test, each, span)
        second = _either(test, candidate, second, span)
    return second


def _either(test: Expression, one: _Candidate, other: _Candidate, span: Span) -> _Candidate:
    return _Candidate(
        squared=chosen(test, one.squared, other.squared, span),
        at=chosen(test, one.at, other.at, span),
        low=chosen(test, one.low, other.low, span),
        high=chosen(test, one.high, other.high, span),
    )


def _nearer(span: Span, one: _Candidate, other: _Candidate) -> _Candidate:
    return _either(less(other.squared, one.squared, span), other, one, span)


def _refined(curve: CurveValue, start: _Candidate, p: Point, steps: int, span: Span) -> _Candidate:
    """The foot between ``low`` and ``high``, by the formula of the piece that the candidate is in."""
    point = curve.formula(_within(curve, start.at, start.low, start.high, span))
    slope = derivatives(point, curve.parameter)
    bend = derivatives(slope, curve.parameter)
    way = differences(point, p, span)
    rise = dot(way, slope, span)
    curvature = add(dot(slope, slope, span), dot(way, bend, span), span)
    descent = Formula.of((rise, curvature), curve.parameter)
    at, bracket = start.at, Bracket.of(start.low, start.high, span)
    for number in range(steps):
        rise, curvature = descent.at(at)
        falling = negative(rise, span)
        bracket = bracket.narrowed(at, falling)
        newton = bracket.kept(subtract(at, divide(rise, curvature, span), span), number)
        downhill = chosen(falling, bracket.right(number), bracket.left(number), span)
        at = chosen(positive(curvature, span), newton, downhill, span)
    rest = Formula.of(way, curve.parameter).at(at)
    return _Candidate(squared=dot(rest, rest, span), at=at, low=start.low, high=start.high)


def distance(curve: CurveValue, p: Point, span: Span) -> Expression:
    """The distance of ``p`` from a curve: of the plane or an image positive left of its direction, else not negative.

    Its derivative is finite everywhere: zero on a curve of space, where there is none. Without a value (NaN) where
    nothing of an image curve is seen.

    Raises:
        UndefinedValueError: the curve has no derivative.

    """
    foot = foot_of(curve, p, span)
    r = differences(p, foot.point, span)
    squared = dot(r, r, span)
    apart = less(multiply(_ROUNDED, dot(p, p, span), span), squared, span)
    length = apply(Operation.SQRT, chosen(apart, squared, Number(1), span), span=span)
    if curve.dimension == 3:
        return _if_seen(foot, chosen(apart, length, Number(0), span), span)
    across = _across(foot.slope, r, span)
    side = _across(_between(curve, foot, span), r, span) if curve.corners else across
    ended = chosen(negative(side, span), negate(length, span), length, span)
    square = divide(across, apply(Operation.HYPOT, *foot.slope, span=span), span)
    return _if_seen(foot, chosen(both(foot.fixed, apart, span), ended, square, span), span)


def _if_seen(foot: Foot, value: Expression, span: Span) -> Expression:
    """``value``, which is no number (NaN) where nothing of the curve is seen."""
    return value if foot.seen is None else defined(foot.seen, value, span)


def _across(way: Point, r: Point, span: Span) -> Expression:
    """Positive where ``r`` leads to the left of ``way``."""
    (x, y), (u, v) = way, r
    return subtract(multiply(x, v, span), multiply(y, u, span), span)


def _between(curve: CurveValue, foot: Foot, span: Span) -> Point:
    """The direction at the end or the corner that is nearest: at a corner the sum of both of length 1."""
    ways = [_directions(curve, piece, span) for piece in curve.pieces]
    ends = [ways[0][0], ways[-1][1]]
    if curve.closed:
        ends = [_sum(ends[0], ends[1], span)] * 2
    corners = [ends[0], *(_sum(before[1], after[0], span) for before, after in pairwise(ways)), ends[1]]
    found = corners[-1]
    for piece, corner in zip(reversed(curve.pieces), reversed(corners[:-1]), strict=True):
        test = less(foot.at, middle(piece.first, piece.last, span), span)
        found = tuple(chosen(test, a, b, span) for a, b in zip(corner, found, strict=True))
    return found


def _directions(curve: CurveValue, piece: Piece, span: Span) -> tuple[Point, Point]:
    """Where a piece goes, of length 1, at its beginning and at its end.

    An end that is known to be out of sight may have no direction: that of the other end, of one that is straight in
    space the same, stands for it; zeros where neither is seen.
    """
    ends = piece.first, piece.last
    if piece.seen is not None:
        depth = Formula.of((piece.seen,), curve.parameter)
        shown = [end for end in ends if not out_of_sight(depth.at(end)[0])]
        if not shown:
            nowhere = (Number(0, NONE),) * curve.dimension
            return nowhere, nowhere
        ends = shown[0], shown[-1]
    slope = Formula.of(derivatives(piece.point, curve.parameter), curve.parameter)
    first, last = (slope.at(end) for end in ends)
    return _unit(first, span), _unit(last, span)


def _unit(way: Point, span: Span) -> Point:
    length = apply(Operation.HYPOT, *way, span=span)
    return tuple(divide(each, length, span) for each in way)


def _sum(a: Point, b: Point, span: Span) -> Point:
    return tuple(add(x, y, span) for x, y in zip(a, b, strict=True))
