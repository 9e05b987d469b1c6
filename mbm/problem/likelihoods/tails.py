"""Normal probabilities of half-lines and intervals as signed roots, right in their tails and where they are near 1."""

from __future__ import annotations

from math import log, pi, sqrt

from mbm.expression.nodes import Operation
from mbm.expression.terms import Term, chosen, function, held, polynomial, square, square_root
from mbm.problem.likelihoods.types import SHIFT

_COEFFICIENTS = (
    -1.3026537197817094, 0.64196979235649026, 0.019476473204185836, -0.0095615147868086316, -0.00094659534448203687,
    0.00036683949785276145, 4.2523324806907772e-5, -2.0278578112534243e-5, -1.6242900046470255e-6,
    1.3036558355805232e-6, 1.5626441722066143e-8, -8.5238095914926543e-8, 6.5290544390988515e-9, 5.0593434955514689e-9,
    -9.9136415649303309e-10, -2.2736512229318359e-10, 9.6467911020155268e-11, 2.3940380830391147e-12,
    -6.8860275264975534e-12, 8.9448792730907257e-13, 3.1309213993429581e-13, -1.1270822361367252e-13,
    3.8109052551892321e-16, 7.106097613609237e-15, -1.5230282014571043e-15, -9.457494571291234e-17,
    1.210237189224279e-16, -2.816663087747177e-17,
)  # fmt: skip
"""Chebyshev coefficients of ``log(erfc(z) exp(z²)/t)`` on 0 ≤ t = 2/(2 + z) ≤ 1, made with mpmath to 40 digits."""

SMALL = 1e-3
"""Probabilities below it enter ``log(1 - q)`` by its series."""

EXACT = 1e-3
"""Half steps in standard deviations below which a reading is as good as exact: Sheppard's correction is then right to
d⁴u⁴/180."""

MIDDLE = 0.05
"""Distances from the middle of a step up to which its probability is a series."""

FLAT = 1e-30
"""What stands in for the square of a residual that underflows."""

DENSITY = 1.0 / sqrt(2.0 * pi)


def below(ratio: Term) -> Term:
    """√(−2 log Φ(z)): the value lies below a limit that is z = ``ratio`` deviations above the model."""
    return square_root(_at_least(-2.0 * log_upper(-ratio), FLAT))


def below_information(ratio: Term) -> Term:
    """Its derivative by z is the root of the observed information ``λ (λ + z)`` with λ = φ(z)/Φ(z)."""
    mills = function(Operation.EXP, -0.5 * square(ratio) - log_upper(-ratio)) * DENSITY
    return held(square_root(_at_least(mills * (mills + ratio), 0.0))) * ratio


def within(ratio: Term, half: Term) -> Term:
    """The signed root of ``-2 log`` of P(|value - reading| < d) over its largest value.

    ``ratio`` u is how far the model lies from the reading, ``half`` d half a step, both in standard deviations.
    """
    coarse = ~(half < EXACT)
    d = chosen(coarse, half, 1.0)
    off = function(Operation.ABS, ratio)
    near = off < MIDDLE
    c = chosen(near, 1.0, off)
    fall = 2.0 * (_log_within(Term(d.node) * 0.0, d) - _log_within(c, d))
    far = function(Operation.SIGN, ratio) * square_root(_at_least(fall, FLAT))
    middle = ratio * square_root(_at_least(_series(ratio, d), FLAT))
    return chosen(coarse, chosen(near, middle, far), ratio / square_root(1.0 + square(half) / 3.0))


def within_information(ratio: Term, half: Term) -> Term:
    """Its derivative by u is the root of the observed information, the curvature of −log P."""
    coarse = ~(half < EXACT)
    d = chosen(coarse, half, 1.0)
    off = function(Operation.ABS, ratio)
    whole = _log_within(off, d)
    lower, upper = (_share(off - d, whole), _share(off + d, whole))
    slope = upper - lower
    bend = (off - d) * lower - (off + d) * upper
    curvature = chosen(coarse, _at_least(square(slope) - bend, 0.0), 1.0 / (1.0 + square(half) / 3.0))
    return held(square_root(curvature)) * ratio


def highest(half: Term, reference: Term) -> Term:
    """√(SHIFT + 2 log(P₀(d_ref)/P₀(d))), P₀ being the largest probability of a step of half width d: by it readings
    tell the deviation that d is measured in.
    """
    return square_root(SHIFT + 2.0 * (_log_middle(reference) - _log_middle(half)))


def scaled_information(ratio: Term, half: Term) -> tuple[Term, Term]:
    """Two numbers whose derivatives' products are the observed information of −log P by u and d, both of which vary.

    As P is log-concave in both, it is L Lᵀ with L triangular (Pratt 1981).
    """
    coarse = ~(half < EXACT)
    d = chosen(coarse, half, 1.0)
    off = function(Operation.ABS, ratio)
    whole = _log_within(off, d)
    lower, upper = _share(off - d, whole), _share(off + d, whole)
    inner, outer = square(lower) - (off - d) * lower, square(upper) + (off + d) * upper  # by u - d and u + d
    both = -lower * upper
    across = _at_least(inner + outer + 2.0 * both, FLAT)
    along = _at_least(inner + outer - 2.0 * both - square(outer - inner) / across, 0.0)
    first = chosen(coarse, square_root(across), 1.0 / square_root(1.0 + square(half) / 3.0))
    mixed = chosen(coarse, function(Operation.SIGN, ratio) * (outer - inner) / square_root(across), 0.0)
    second = chosen(coarse, square_root(along), 1.0 / half)
    return held(first) * ratio + held(mixed) * half, held(second) * half


def _log_middle(half: Term) -> Term:
    """``log P₀(d)``."""
    coarse = ~(half < EXACT)
    d = chosen(coarse, half, 1.0)
    fine = function(Operation.LOG, 2.0 * DENSITY * half) - square(half) / 6.0
    return chosen(coarse, _log_within(d * 0.0, d), fine)


def log_upper(x: Term) -> Term:
    """Log of the normal probability above x, to rounding for any x."""
    size = chosen(x < 0.0, -x, x)  # whose slope at 0 is that of one side, not 0
    t = 2.0 / (2.0 + size / sqrt(2.0))
    tail = function(Operation.LOG, t) - 0.5 * square(size) + _chebyshev(4.0 * t - 2.0) - log(2.0)
    return chosen(x < 0.0, _log_rest(function(Operation.EXP, tail)), tail)


def _log_rest(share: Term) -> Term:
    """``log(1 - q)``."""
    series = -share * polynomial([1.0 / k for k in range(1, 7)], share)
    return chosen(share < SMALL, series, function(Operation.LOG, 1.0 - share))


def _log_within(off: Term, half: Term) -> Term:
    """``log(Q(c - d) - Q(c + d))`` for c ≥ 0 and d > 0."""
    lower, upper = log_upper(off - half), log_upper(off + half)
    gap = upper - lower
    wide = gap < -30.0
    narrow = chosen(wide, -1.0, gap)
    close = 0.5 * narrow + function(Operation.LOG, 2.0 * function(Operation.SINH, -0.5 * narrow))
    return lower + chosen(wide, -function(Operation.EXP, gap), close)


def _series(ratio: Term, half: Term) -> Term:
    """``-2 log(P(u)/P(0))/u²`` in powers of u²."""
    whole = _log_within(half * 0.0, half)
    share = 2.0 * _share(half, whole)
    d2 = square(half)
    second = -half * share
    fourth = half * (3.0 - d2) * share
    sixth = -half * (square(d2) - 10.0 * d2 + 15.0) * share
    third_cumulant = fourth - 3.0 * square(second)
    fifth = sixth - 15.0 * fourth * second + 30.0 * second * square(second)
    u2 = square(ratio)
    return -(second + u2 * (third_cumulant / 12.0 + u2 * fifth / 360.0))


def _share(x: Term, whole: Term) -> Term:
    """φ(x) divided by a probability, of which the log is given."""
    return function(Operation.EXP, -0.5 * square(x) - whole) * DENSITY


def _at_least(value: Term, least: float) -> Term:
    return chosen(value < least, least, value)


def _chebyshev(y: Term) -> Term:
    """Clenshaw's sum, y being twice the place."""
    last, before = Term(y.node) * 0.0, Term(y.node) * 0.0
    for each in reversed(_COEFFICIENTS[1:]):
        last, before = y * last - before + each, last
    return 0.5 * (y * last + _COEFFICIENTS[0]) - before
