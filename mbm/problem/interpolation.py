"""Values between those of two rows: on the line, on a cubic, on the great circle."""

from __future__ import annotations

from collections.abc import Sequence

from mbm.expression import algebra
from mbm.expression.algebra import ONE
from mbm.expression.nodes import Expression, Operation
from mbm.language.coerce import difference, list_items, scalar
from mbm.language.values import SCALARS, Array, ListValue, PoseValue, RotationValue, Value
from mbm.language.vocabulary.rigid import compose_rotations, inverse_rotation, logarithm, plane_rotation
from mbm.language.vocabulary.rotations import exponential
from mbm.text.types import Span


def between(values: Sequence[Value], times: Sequence[Expression], way: Expression, span: Span) -> Value:
    """The value a part ``way`` of the distance from one row to the next.

    ``values`` are those of the two rows, on whose line it lies; or, with the ``times`` of all four, those of a row
    before them and of one after, for a cubic. Rotations take the shorter way round at constant rate; of poses they do,
    and translations as vectors do; scales by their logarithms. Angles take the shorter way.
    """
    first = values[0]
    if isinstance(first, RotationValue):
        return _turned([value for value in values if isinstance(value, RotationValue)], way, span)
    if isinstance(first, PoseValue):
        return _moved([value for value in values if isinstance(value, PoseValue)], times, way, span)
    rows = [_numbers(value, span) for value in values]
    found = tuple(_blended(each, times, way, span) for each in zip(*rows, strict=True))
    if isinstance(first, SCALARS):
        return found[0]
    return Array(first.shape if isinstance(first, Array) else (len(found),), found)


def _numbers(value: Value, span: Span) -> tuple[Expression, ...]:
    if isinstance(value, Array):
        return value.elements
    if isinstance(value, ListValue):
        return tuple(scalar(item, span) for item in list_items(value, span))
    return (scalar(value, span),)


def _moved(poses: list[PoseValue], times: Sequence[Expression], way: Expression, span: Span) -> PoseValue:
    where = zip(*(pose.translation for pose in poses), strict=True)
    scales = [pose.scale for pose in poses if pose.scale is not None]
    scale = None
    if scales:
        logs = tuple(algebra.apply(Operation.LOG, each, span=span) for each in scales)
        scale = algebra.apply(Operation.EXP, _blended(logs, times, way, span), span=span)
    return PoseValue(
        rotation=_turned([pose.rotation for pose in poses], way, span),
        translation=tuple(_blended(each, times, way, span) for each in where),
        scale=scale,
    )


def _turned(rotations: list[RotationValue], way: Expression, span: Span) -> RotationValue:
    """On the great circle between the two in the middle: ``R Exp(w Log(Rᵀ S))``."""
    middle = len(rotations) // 2
    start, end = rotations[middle - 1], rotations[middle]
    turn = logarithm(compose_rotations(inverse_rotation(start, span), end, span), span)
    part = tuple(algebra.multiply(way, each, span) for each in turn)
    step = plane_rotation(part[0], span) if start.dimension == 2 else exponential(part, span)
    return compose_rotations(start, step, span)


def _blended(values: tuple[Expression, ...], times: Sequence[Expression], way: Expression, span: Span) -> Expression:
    """A number on the line between two, or on the cubic between the middle ones of four."""
    if len(values) == 2:
        start, end = values
        return algebra.add(start, algebra.multiply(way, difference(end, start, span), span), span)
    start, rise = values[1], difference(values[2], values[1], span)
    width = algebra.subtract(times[2], times[1], span)
    slopes = (_slope(values[:3], times[:3], span), _slope(values[1:], times[1:], span))
    first, last = (algebra.multiply(width, slope, span) for slope in slopes)
    # Hermite: s + w (d₁ + w (3 r − 2 d₁ − d₂ + w (d₁ + d₂ − 2 r))), with the rise r and the slopes d times the width
    both = algebra.add(first, last, span)
    third = algebra.subtract(both, algebra.add(rise, rise, span), span)
    second = algebra.subtract(
        algebra.add(rise, algebra.add(rise, rise, span), span), algebra.add(both, first, span), span
    )
    inner = algebra.add(second, algebra.multiply(way, third, span), span)
    outer = algebra.add(first, algebra.multiply(way, inner, span), span)
    return algebra.add(start, algebra.multiply(way, outer, span), span)


def _slope(values: Sequence[Expression], times: Sequence[Expression], span: Span) -> Expression:
    """The slope, at the middle one of three points in any order, of the parabola through them."""
    before, after = (algebra.subtract(times[i + 1], times[i], span) for i in (0, 1))
    rises = [
        algebra.divide(difference(values[i + 1], values[i], span), width, span)
        for i, width in enumerate((before, after))
    ]
    share = algebra.divide(before, algebra.add(before, after, span), span)
    first = algebra.multiply(algebra.subtract(ONE, share, span), rises[0], span)
    return algebra.add(first, algebra.multiply(share, rises[1], span), span)
