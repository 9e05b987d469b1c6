"""What the value of an operation, known to lie in an interval, leaves of its arguments: the backward half of HC4.

Each function takes the interval of the value and those of the arguments, and gives intervals that hold every argument
in these with which the value lies in that (Benhamou, Goualard, Granvilliers and Puget, Revising hull and box
consistency, 1999). low > high: none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np

from mbm.equations.types import Mask
from mbm.estimation.intervals import arithmetic as of
from mbm.estimation.intervals.arithmetic import PI_HIGH, UNIT, Floats, Interval
from mbm.expression.nodes import Operation

Inverse: TypeAlias = Callable[..., tuple[Interval, ...]]

HALF_PI_HIGH = PI_HIGH / 2
TURN = 2 * np.pi


def quotient(y: Interval, b: Interval, x: Interval) -> Interval:
    """What of ``x`` may be such that x · b lies in ``y``: a quotient by an interval with zeros has two parts."""
    zeros = (b[0] <= 0.0) & (b[1] >= 0.0)
    if not bool(zeros.any()):
        return of.meet(of.divide(y, b), x)
    below = of.meet(of.divide(y, (b[0], np.minimum(b[1], 0.0))), x)
    above = of.meet(of.divide(y, (np.maximum(b[0], 0.0), b[1])), x)
    none, other = b[0] >= 0.0, b[1] <= 0.0  # b has no negative numbers, or no positive ones
    below = np.where(none, np.inf, below[0]), np.where(none, -np.inf, below[1])
    above = np.where(other, np.inf, above[0]), np.where(other, -np.inf, above[1])
    low, high = of.hull(below, above)
    free = zeros & (y[0] <= 0.0) & (y[1] >= 0.0)
    return np.where(free, x[0], low), np.where(free, x[1], high)


def either_sign(size: Interval, x: Interval) -> Interval:
    """What of ``x`` has an absolute value in ``size``."""
    size = np.maximum(size[0], 0.0), size[1]
    return of.hull(of.meet(size, x), of.meet(of.negate(size), x))


def periodic(base: Interval, period: float, x: Interval) -> Interval:
    """What of ``x`` lies in ``base``, or some whole periods away from it."""
    first, last = (
        np.ceil(_doubtful((x[0] - base[1]) / period, -1.0)),
        np.floor(_doubtful((x[1] - base[0]) / period, 1.0)),
    )
    error = 4 * UNIT
    low = base[0] + first * period
    high = base[1] + last * period
    low = low - error * (np.abs(low) + np.abs(first) * period + 1.0)
    high = high + error * (np.abs(high) + np.abs(last) * period + 1.0)
    unsure = ~(np.isfinite(low) & np.isfinite(high)) | (np.abs(first) > of.LARGEST_ANGLE)
    unsure |= np.abs(last) > of.LARGEST_ANGLE
    low, high = np.where(unsure, x[0], np.maximum(low, x[0])), np.where(unsure, x[1], np.minimum(high, x[1]))
    none = ~unsure & (first > last) & (base[0] <= base[1])
    return np.where(none, np.inf, low), np.where(none, -np.inf, high)


def _doubtful(periods: Floats, side: float) -> Floats:
    """A number of periods, moved so that rounding leaves none out."""
    return np.asarray(periods + side * 4 * UNIT * (np.abs(periods) + 1.0))


def _empty(where: Mask, found: Interval) -> Interval:
    return np.where(where, np.inf, found[0]), np.where(where, -np.inf, found[1])


def _sine(y: Interval, x: Interval) -> tuple[Interval, ...]:
    up = of.arc_sine(y)
    down = of.outward(of.PI_LOW - up[1], PI_HIGH - up[0])
    found = of.hull(periodic(up, TURN, x), periodic(down, TURN, x))
    return (_empty((y[0] > 1.0) | (y[1] < -1.0), found),)


def _cosine(y: Interval, x: Interval) -> tuple[Interval, ...]:
    up = of.arc_cosine(y)
    found = of.hull(periodic(up, TURN, x), periodic(of.negate(up), TURN, x))
    return (_empty((y[0] > 1.0) | (y[1] < -1.0), found),)


def _tangent(y: Interval, x: Interval) -> tuple[Interval, ...]:
    return (periodic(of.arc_tangent(y), np.pi, x),)


def _direction(value: Interval, y: Interval, x: Interval) -> tuple[Interval, ...]:
    """y = r sin θ, x = r cos θ with r ≥ 0; and y cos θ = x sin θ."""
    radius = of.square_root(of.add(of.square(x), of.square(y)))
    sine, cosine = of.sine(value), of.cosine(value)
    new_y = of.meet(of.multiply(radius, sine), y)
    new_x = of.meet(of.multiply(radius, cosine), x)
    new_y = quotient(of.multiply(new_x, sine), cosine, new_y)
    new_x = quotient(of.multiply(new_y, cosine), sine, new_x)
    at_origin = (y[0] <= 0.0) & (y[1] >= 0.0) & (x[0] <= 0.0) & (x[1] >= 0.0)  # where atan2 is 0 by convention
    return (
        (np.where(at_origin, y[0], new_y[0]), np.where(at_origin, y[1], new_y[1])),
        (np.where(at_origin, x[0], new_x[0]), np.where(at_origin, x[1], new_x[1])),
    )


def _wrapped(y: Interval, x: Interval) -> tuple[Interval, ...]:
    return (periodic(y, TURN, x),)


def _lesser(y: Interval, a: Interval, b: Interval) -> tuple[Interval, ...]:
    return _lesser_of(y, a, b), _lesser_of(y, b, a)


def _lesser_of(y: Interval, a: Interval, b: Interval) -> Interval:
    """What of ``a`` may stand beside b where the lesser of both lies in ``y``."""
    alone = b[0] > y[1]
    return np.maximum(a[0], y[0]), np.where(alone, np.minimum(a[1], y[1]), a[1])


def _greater(y: Interval, a: Interval, b: Interval) -> tuple[Interval, ...]:
    found = _lesser(of.negate(y), of.negate(a), of.negate(b))
    return tuple(of.negate(each) for each in found)


def _increasing(inverse: Callable[[Interval], Interval], low: float = -np.inf, high: float = np.inf) -> Inverse:
    """That of a function with the ``inverse``; the function's values lie in [low, high]."""

    def applied(y: Interval, x: Interval) -> tuple[Interval, ...]:
        held = of.within(y, low, high)
        return (_empty(held[0] > held[1], of.meet(inverse(held), x)),)

    return applied


def _square_root(y: Interval, x: Interval) -> tuple[Interval, ...]:
    held = of.within(y, 0.0, np.inf)
    return (_empty(held[0] > held[1], of.meet(of.square(held), (np.maximum(x[0], 0.0), x[1]))),)


def _exponential(y: Interval, x: Interval) -> tuple[Interval, ...]:
    return (_empty(y[1] <= 0.0, of.meet(of.logarithm(y), x)),)


def _hyperbolic_cosine(y: Interval, x: Interval) -> tuple[Interval, ...]:
    size = of.EXTENSIONS[Operation.ACOSH](y)
    return (_empty(y[1] < 1.0, either_sign(size, x)),)


def _floor(y: Interval, x: Interval) -> tuple[Interval, ...]:
    return (of.meet((np.ceil(y[0]), np.floor(y[1]) + 1.0), x),)


def _arc_tangent(y: Interval, x: Interval) -> tuple[Interval, ...]:
    low = np.where(y[0] <= -HALF_PI_HIGH + UNIT, -np.inf, of.tangent((y[0], y[0]))[0])
    high = np.where(y[1] >= HALF_PI_HIGH - UNIT, np.inf, of.tangent((y[1], y[1]))[1])
    return (_empty((y[0] > HALF_PI_HIGH) | (y[1] < -HALF_PI_HIGH), of.meet((low, high), x)),)


def whole_root(y: Interval, exponent: int, x: Interval) -> Interval:
    """What of ``x`` has its whole power in ``y``."""
    if exponent == 0:
        return x
    if exponent < 0:
        return whole_root(quotient(of.interval(1.0, 1.0), y, of.everything(y)), -exponent, x)
    if exponent % 2 == 0:
        root = of.square_root(y) if exponent == 2 else _root(of.within(y, 0.0, np.inf), exponent)
        return _empty(y[1] < 0.0, either_sign(root, x))
    above = _root((np.maximum(y[0], 0.0), np.maximum(y[1], 0.0)), exponent)
    below = _root((np.maximum(-y[1], 0.0), np.maximum(-y[0], 0.0)), exponent)
    return of.meet((np.where(y[0] >= 0.0, above[0], -below[1]), np.where(y[1] >= 0.0, above[1], -below[0])), x)


def _root(y: Interval, exponent: int) -> Interval:
    """A root of what is not negative; that 1/n is rounded counts as the logarithm of y does."""
    low, high = np.power(y[0], 1.0 / exponent), np.power(y[1], 1.0 / exponent)
    low, high = of.widened(low, high, of.MARGIN + _logarithm_size(y))
    return np.maximum(low, 0.0), high


def _logarithm_size(y: Interval) -> Floats:
    sizes = [np.abs(np.log(np.clip(end, of.LEAST, of.MOST))) for end in y]
    return np.maximum(sizes[0], sizes[1])


def real_root(y: Interval, exponent: float, x: Interval) -> Interval:
    """What of ``x`` ≥ 0 has its power with an exponent that is no whole number in ``y``."""
    held = of.within(y, 0.0, np.inf)
    low, high = np.power(held[0], 1.0 / exponent), np.power(held[1], 1.0 / exponent)
    low, high = of.widened(
        np.minimum(low, high), np.maximum(low, high), of.MARGIN + 4 / abs(exponent) * _logarithm_size(held)
    )
    return _empty(y[1] < 0.0, of.meet((np.maximum(low, 0.0), high), (np.maximum(x[0], 0.0), x[1])))


INVERSES: Mapping[Operation, Inverse] = {
    Operation.ADD: lambda y, a, b: (of.meet(of.subtract(y, b), a), of.meet(of.subtract(y, a), b)),
    Operation.SUBTRACT: lambda y, a, b: (of.meet(of.add(y, b), a), of.meet(of.subtract(a, y), b)),
    Operation.NEGATE: lambda y, a: (of.meet(of.negate(y), a),),
    Operation.MULTIPLY: lambda y, a, b: (quotient(y, b, a), quotient(y, a, b)),
    Operation.DIVIDE: lambda y, a, b: (of.meet(of.multiply(y, b), a), quotient(a, y, b)),
    Operation.SQRT: _square_root,
    Operation.EXP: _exponential,
    Operation.LOG: _increasing(of.exponential),
    Operation.ABS: lambda y, a: (_empty(y[1] < 0.0, either_sign(y, a)),),
    Operation.FLOOR: _floor,
    Operation.MINIMUM: _lesser,
    Operation.MAXIMUM: _greater,
    Operation.SIN: _sine,
    Operation.COS: _cosine,
    Operation.TAN: _tangent,
    Operation.ASIN: _increasing(
        lambda y: (of.sine((y[0], y[0]))[0], of.sine((y[1], y[1]))[1]), -PI_HIGH / 2, PI_HIGH / 2
    ),
    Operation.ACOS: _increasing(lambda y: (of.cosine((y[1], y[1]))[0], of.cosine((y[0], y[0]))[1]), 0.0, PI_HIGH),
    Operation.ATAN: _arc_tangent,
    Operation.ATAN2: _direction,
    Operation.SINH: _increasing(of.EXTENSIONS[Operation.ASINH]),
    Operation.COSH: _hyperbolic_cosine,
    Operation.TANH: _increasing(of.EXTENSIONS[Operation.ATANH], -1.0, 1.0),
    Operation.ASINH: _increasing(of.EXTENSIONS[Operation.SINH]),
    Operation.ACOSH: _increasing(of.hyperbolic_cosine, 0.0),
    Operation.ATANH: _increasing(of.EXTENSIONS[Operation.TANH]),
    Operation.WRAP: _wrapped,
    Operation.AS_ANGLE: lambda y, a: (of.meet(y, a),),
    Operation.HELD: lambda y, a: (of.meet(y, a),),
}
"""Operations that are not here (conditions, SIGN) leave their arguments as they are."""
