"""Curves as values: points in terms of a parameter, piece by piece.

The coordinates are expressions in the parameter, the unknowns and the columns, so that a curve that was moved or
projected is a curve again, and everything about it is differentiated as any other form is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from mbm.expression.algebra import ZERO
from mbm.expression.nodes import Expression, Number, Parameter
from mbm.expression.substitution import substituted
from mbm.language import faults
from mbm.language.piecewise import less, merged
from mbm.language.values import Array, Placeable, Transform
from mbm.language.vocabulary.frames import move_point
from mbm.text.types import MbmError, Span
from mbm.values import dataclass

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
        knots = [piece.last for piece in self.pieces[:-1]]
        if isinstance(near, Number) and all(isinstance(knot, Number) for knot in knots):
            passed = sum(isinstance(knot, Number) and knot.value <= near.value for knot in knots)
            return self.pieces[passed].point
        before = tuple(less(near, knot, self.span) for knot in knots)
        return merged(tuple(piece.point for piece in self.pieces), before, self.parameter, self.span)


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
