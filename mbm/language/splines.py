"""Natural and periodic cubic splines through points, with chord lengths for parameters (de Boor 1978, ch. IV).

The second derivatives at the knots solve a tridiagonal system. Points may hold unknowns, and so may the chord lengths:
the elimination is written out, so that every pivot is one expression that all coordinates share. No pivot is small, for
the matrix is diagonally dominant.
"""

from __future__ import annotations

from itertools import pairwise

from mbm.expression.algebra import ZERO, add, differences, divide, multiply, negate, subtract, total
from mbm.expression.dimension import NONE
from mbm.expression.nodes import Expression, Number, Parameter
from mbm.language.curves import Piece, Point
from mbm.language.vocabulary.vectors import norm_of
from mbm.text.types import Span

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
