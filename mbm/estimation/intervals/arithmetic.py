"""Interval extensions of the operations of expressions, rounded outwards; intervals by the thousand, with NumPy.

An interval is a pair of arrays (low, high) of any shapes that broadcast; low > high stands for the empty one. Each
function gives an interval that holds every value of the operation on numbers of its arguments within its domain, as in
Moore, Kearfott and Cloud, Introduction to Interval Analysis (2009), ch. 5. Sums, products, quotients and square roots
are correctly rounded (IEEE 754), so that one step to the next number outside is enough. Elementary functions of NumPy
are documented to four units in the last place; `MARGIN` is twice that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.expression.nodes import Operation

Floats: TypeAlias = NDArray[np.float64]
Interval: TypeAlias = tuple[Floats, Floats]

MARGIN = 8.0
"""Units in the last place by which values of elementary functions are widened."""

UNIT = 2.0**-52
LEAST = 5e-323
"""Ten of the least doubles: what a value that underflows may be off by."""
MOST = float(np.finfo(np.float64).max)

LARGEST_ANGLE = 1e8
"""Angles beyond have sines and cosines of which nothing is said: counting their periods would lose digits."""

PI_LOW, PI_HIGH = np.pi, float(np.nextafter(np.pi, 4.0))
"""The doubles around π: `numpy.pi` lies below it."""


def interval(low: float, high: float) -> Interval:
    """The same interval for all."""
    return np.array([[low]]), np.array([[high]])


def outward(low: Floats, high: Floats) -> Interval:
    """Bounds that were correctly rounded, one number further out."""
    return np.nextafter(low, -np.inf), np.nextafter(high, np.inf)


def widened(low: Floats, high: Floats, units: Floats | float = MARGIN, more: float = 0.0) -> Interval:
    """Bounds by some units in the last place, and ``more`` absolutely, further out; infinite ones stay infinite."""
    below, above = np.minimum(low, MOST), np.maximum(high, -MOST)
    return (
        below - (units * UNIT * np.abs(below) + (LEAST + more)),
        above + (units * UNIT * np.abs(above) + (LEAST + more)),
    )


def hull(a: Interval, b: Interval) -> Interval:
    """The least interval that holds both; empty ones hold nothing."""
    (al, ah), (bl, bh) = a, b
    none, other = al > ah, bl > bh
    low = np.minimum(np.where(none, np.inf, al), np.where(other, np.inf, bl))
    high = np.maximum(np.where(none, -np.inf, ah), np.where(other, -np.inf, bh))
    return low, high


def meet(a: Interval, b: Interval) -> Interval:
    """What both hold."""
    return np.maximum(a[0], b[0]), np.minimum(a[1], b[1])


def within(a: Interval, low: float, high: float) -> Interval:
    """What of ``a`` lies in a domain."""
    return np.maximum(a[0], low), np.minimum(a[1], high)


def everything(a: Interval) -> Interval:
    """The whole line, in the shape of ``a``."""
    return np.full_like(a[0], -np.inf), np.full_like(a[1], np.inf)


def add(a: Interval, b: Interval) -> Interval:
    """a + b."""
    return outward(a[0] + b[0], a[1] + b[1])


def subtract(a: Interval, b: Interval) -> Interval:
    """a − b."""
    return outward(a[0] - b[1], a[1] - b[0])


def negate(a: Interval) -> Interval:
    """−a, exactly."""
    return -a[1], -a[0]


def _extremes(corners: tuple[Floats, Floats, Floats, Floats]) -> Interval:
    """Least and greatest of four; an undefined one is 0 · ∞ or 0 / 0, where 0 is the limit that counts."""
    p, q, r, s = (np.where(np.isnan(corner), 0.0, corner) for corner in corners)
    return np.minimum(np.minimum(p, q), np.minimum(r, s)), np.maximum(np.maximum(p, q), np.maximum(r, s))


def multiply(a: Interval, b: Interval) -> Interval:
    """a · b."""
    return outward(*_extremes((a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1])))


def divide(a: Interval, b: Interval) -> Interval:
    """a / b; the whole line where b holds zeros on both sides."""
    if not bool(((b[0] <= 0.0) & (b[1] >= 0.0)).any()):
        return outward(*_extremes((a[0] / b[0], a[0] / b[1], a[1] / b[0], a[1] / b[1])))
    low, high = b[0] + 0.0, np.where(b[1] == 0.0, -0.0, b[1])
    found = outward(*_extremes((a[0] / low, a[0] / high, a[1] / low, a[1] / high)))
    across = (b[0] <= 0.0) & (b[1] >= 0.0) & ~((b[0] == 0.0) ^ (b[1] == 0.0))
    across = across & ~((a[0] == 0.0) & (a[1] == 0.0) & (b[0] < b[1]))
    return np.where(across, -np.inf, found[0]), np.where(across, np.inf, found[1])


def square(a: Interval) -> Interval:
    """a², of one and the same number."""
    small, large = magnitudes(a)
    low, high = outward(small * small, large * large)
    return np.maximum(low, 0.0), high


def magnitudes(a: Interval) -> Interval:
    """|a|, exactly."""
    low, high = np.abs(a[0]), np.abs(a[1])
    across = (a[0] <= 0.0) & (a[1] >= 0.0)
    return np.where(across, 0.0, np.minimum(low, high)), np.maximum(low, high)


def whole_power(a: Interval, exponent: int) -> Interval:
    """a to a whole power."""
    if exponent < 0:
        return divide(interval(1.0, 1.0), whole_power(a, -exponent))
    if exponent == 2:
        return square(a)
    if exponent % 2 == 0:
        small, large = magnitudes(a)
        low, high = widened(np.power(small, exponent), np.power(large, exponent))
        return np.maximum(low, 0.0), high
    return widened(np.power(a[0], exponent), np.power(a[1], exponent))


def real_power(a: Interval, b: Interval) -> Interval:
    """a to a power that is no known whole number, where a ≥ 0: monotone in either, so that corners decide."""
    base = within(a, 0.0, np.inf)
    power = np.power
    corners = (power(base[0], b[0]), power(base[0], b[1]), power(base[1], b[0]), power(base[1], b[1]))
    found = [np.where(np.isnan(corner), 1.0, corner) for corner in corners]  # 1^∞
    low, high = widened(np.minimum.reduce(np.broadcast_arrays(*found)), np.maximum.reduce(np.broadcast_arrays(*found)))
    unsure = ~(np.isfinite(b[0]) & np.isfinite(b[1]))
    low, high = np.where(unsure, 0.0, np.maximum(low, 0.0)), np.where(unsure, np.inf, high)
    empty = base[0] > base[1]
    return np.where(empty, np.inf, low), np.where(empty, -np.inf, high)


def square_root(a: Interval) -> Interval:
    """The square root of what of a is not negative."""
    low, high = outward(np.sqrt(np.maximum(a[0], 0.0)), np.sqrt(np.maximum(a[1], 0.0)))
    return np.where(a[1] < 0.0, np.inf, np.maximum(low, 0.0)), np.where(a[1] < 0.0, -np.inf, high)


def exponential(a: Interval) -> Interval:
    """e^a."""
    low, high = widened(np.exp(a[0]), np.exp(a[1]))
    return np.maximum(low, 0.0), high


def logarithm(a: Interval) -> Interval:
    """The natural logarithm of what of a is positive."""
    low, high = widened(np.log(np.maximum(a[0], 0.0)), np.log(np.maximum(a[1], 0.0)))
    return np.where(a[1] <= 0.0, np.inf, low), np.where(a[1] <= 0.0, -np.inf, high)


def sign(a: Interval) -> Interval:
    """−1, 0 or 1."""
    return np.sign(a[0]), np.sign(a[1])


def floor(a: Interval) -> Interval:
    """The whole numbers not above."""
    return np.floor(a[0]), np.floor(a[1])


def minimum(a: Interval, b: Interval) -> Interval:
    """The lesser of two."""
    return np.minimum(a[0], b[0]), np.minimum(a[1], b[1])


def maximum(a: Interval, b: Interval) -> Interval:
    """The greater of two."""
    return np.maximum(a[0], b[0]), np.maximum(a[1], b[1])


def crosses(a: Interval, first: float, period: float) -> NDArray[np.bool_]:
    """Whether an interval may hold one of the numbers first + k · period; true in doubt."""
    begin, end = (a[0] - first) / period, (a[1] - first) / period
    doubt = 4 * UNIT * (np.maximum(np.abs(begin), np.abs(end)) + 1)
    return np.asarray(np.ceil(begin - doubt) <= end + doubt)


def _wave(a: Interval, low: Floats, high: Floats, top: float, bottom: float) -> Interval:
    """A sine or cosine, given at the ends; the turning points are at ``top`` and ``bottom``, and whole turns away."""
    far = ~((np.abs(a[0]) <= LARGEST_ANGLE) & (np.abs(a[1]) <= LARGEST_ANGLE))
    least, greatest = widened(np.fmin(low, high), np.fmax(low, high), more=UNIT)
    least = np.where(far | crosses(a, bottom, 2 * np.pi), -1.0, np.maximum(least, -1.0))
    greatest = np.where(far | crosses(a, top, 2 * np.pi), 1.0, np.minimum(greatest, 1.0))
    return least, greatest


def sine(a: Interval) -> Interval:
    """sin a."""
    return _wave(a, np.sin(a[0]), np.sin(a[1]), np.pi / 2, -np.pi / 2)


def cosine(a: Interval) -> Interval:
    """cos a."""
    return _wave(a, np.cos(a[0]), np.cos(a[1]), 0.0, np.pi)


def tangent(a: Interval) -> Interval:
    """tan a; the whole line across a pole."""
    low, high = widened(np.tan(a[0]), np.tan(a[1]), more=UNIT)
    far = ~((np.abs(a[0]) <= LARGEST_ANGLE) & (np.abs(a[1]) <= LARGEST_ANGLE))
    pole = far | crosses(a, np.pi / 2, np.pi)
    return np.where(pole, -np.inf, low), np.where(pole, np.inf, high)


def arc_sine(a: Interval) -> Interval:
    """asin of what of a lies in [−1, 1]."""
    low, high = widened(np.arcsin(np.clip(a[0], -1.0, 1.0)), np.arcsin(np.clip(a[1], -1.0, 1.0)))
    empty = (a[0] > 1.0) | (a[1] < -1.0)
    return np.where(empty, np.inf, low), np.where(empty, -np.inf, high)


def arc_cosine(a: Interval) -> Interval:
    """acos of what of a lies in [−1, 1]."""
    low, high = widened(np.arccos(np.clip(a[1], -1.0, 1.0)), np.arccos(np.clip(a[0], -1.0, 1.0)))
    empty = (a[0] > 1.0) | (a[1] < -1.0)
    return np.where(empty, np.inf, np.maximum(low, 0.0)), np.where(empty, -np.inf, high)


def arc_tangent(a: Interval) -> Interval:
    """atan a."""
    return widened(np.arctan(a[0]), np.arctan(a[1]))


def _increasing(function: np.ufunc, low: float = -np.inf, high: float = np.inf) -> Callable[[Interval], Interval]:
    """An increasing function on its domain [low, high]."""

    def applied(a: Interval) -> Interval:
        begin, end = widened(function(np.clip(a[0], low, high)), function(np.clip(a[1], low, high)))
        empty = (a[0] > high) | (a[1] < low)
        return np.where(empty, np.inf, begin), np.where(empty, -np.inf, end)

    return applied


def hyperbolic_cosine(a: Interval) -> Interval:
    """cosh a."""
    small, large = magnitudes(a)
    low, high = widened(np.cosh(small), np.cosh(large))
    return np.maximum(low, 1.0), high


def direction(y: Interval, x: Interval) -> Interval:
    """atan2(y, x), in [−π, π]."""
    low, high = turning_direction(y, x)
    upper = y[0] >= 0.0
    cut = ~upper & ((high > PI_HIGH) | (low < -PI_HIGH))
    low = np.where(cut, -PI_HIGH, np.where(upper, np.maximum(low, 0.0), low))
    return low, np.where(cut, PI_HIGH, np.minimum(high, PI_HIGH))


def turning_direction(y: Interval, x: Interval) -> Interval:
    """atan2(y, x) by whole turns: where a box reaches over the negative axis the interval goes on beyond π.

    A box that holds the origin has all directions, as an interval of length 2π.
    """
    across = (y[0] <= 0.0) & (y[1] >= 0.0) & (x[0] < 0.0)
    corners = [
        np.arctan2(np.where(across, -v, v) + 0.0, np.where(across, -u, u) + 0.0) for v in y for u in x
    ]  # seen from the other side, a box across the negative axis lies across the positive one
    low, high = widened(np.minimum.reduce(corners), np.maximum.reduce(corners), more=UNIT)
    turned = np.where(across, np.pi, 0.0)
    low, high = widened(low + turned, high + turned, 2.0, more=2 * UNIT)
    origin = (y[0] <= 0.0) & (y[1] >= 0.0) & (x[0] <= 0.0) & (x[1] >= 0.0)
    return np.where(origin, -PI_HIGH, low), np.where(origin, PI_HIGH, high)


def wrapped(a: Interval) -> Interval:
    """The representative in [−π, π] of an angle; all of them where the interval reaches over the cut."""
    turns = np.floor((a[0] + np.pi) / (2 * np.pi))
    whole = crosses(a, np.pi, 2 * np.pi) | ~(np.abs(a[0]) <= LARGEST_ANGLE) | ~(np.abs(a[1]) <= LARGEST_ANGLE)
    shift = turns * (2 * np.pi)
    error = 2 * UNIT * (np.abs(shift) + 4.0)
    low, high = a[0] - shift - error, a[1] - shift + error
    return np.where(whole, -PI_HIGH, low), np.where(whole, PI_HIGH, high)


def truth(certain: NDArray[np.bool_], impossible: NDArray[np.bool_]) -> Interval:
    """A condition: [1, 1], [0, 0], or [0, 1] in doubt."""
    return np.where(certain, 1.0, 0.0), np.where(impossible, 0.0, 1.0)


def choose(test: Interval, then: Interval, other: Interval) -> Interval:
    """The branch that holds; the hull of both in doubt."""
    low, high = hull(then, other)
    yes, no = test[0] >= 1.0, test[1] <= 0.0
    return (
        np.where(yes, then[0], np.where(no, other[0], low)),
        np.where(yes, then[1], np.where(no, other[1], high)),
    )


def identity(a: Interval) -> Interval:
    """The interval itself."""
    return a


EXTENSIONS: Mapping[Operation, Callable[..., Interval]] = {
    Operation.ADD: add,
    Operation.SUBTRACT: subtract,
    Operation.NEGATE: negate,
    Operation.MULTIPLY: multiply,
    Operation.DIVIDE: divide,
    Operation.SQRT: square_root,
    Operation.EXP: exponential,
    Operation.LOG: logarithm,
    Operation.ABS: magnitudes,
    Operation.SIGN: sign,
    Operation.FLOOR: floor,
    Operation.MINIMUM: minimum,
    Operation.MAXIMUM: maximum,
    Operation.SIN: sine,
    Operation.COS: cosine,
    Operation.TAN: tangent,
    Operation.ASIN: arc_sine,
    Operation.ACOS: arc_cosine,
    Operation.ATAN: arc_tangent,
    Operation.ATAN2: direction,
    Operation.SINH: _increasing(np.sinh),
    Operation.COSH: hyperbolic_cosine,
    Operation.TANH: _increasing(np.tanh),
    Operation.ASINH: _increasing(np.arcsinh),
    Operation.ACOSH: _increasing(np.arccosh, 1.0),
    Operation.ATANH: _increasing(np.arctanh, -1.0, 1.0),
    Operation.WRAP: wrapped,
    Operation.AS_ANGLE: identity,
    Operation.HELD: identity,
    Operation.IF: choose,
    Operation.LESS: lambda a, b: truth(a[1] < b[0], a[0] >= b[1]),
    Operation.LESS_EQUAL: lambda a, b: truth(a[1] <= b[0], a[0] > b[1]),
    Operation.EQUAL: lambda a, b: truth(
        (a[0] == a[1]) & (b[0] == b[1]) & (a[0] == b[0]), (a[1] < b[0]) | (b[1] < a[0])
    ),
    Operation.NOT: lambda a: (1.0 - a[1], 1.0 - a[0]),
    Operation.AND: lambda a, b: (np.minimum(a[0], b[0]), np.minimum(a[1], b[1])),
    Operation.OR: lambda a, b: (np.maximum(a[0], b[0]), np.maximum(a[1], b[1])),
}
"""The operations that have an interval extension, powers aside; HYPOT is written out with squares and a root."""
