"""Signed roots of deviances: residuals of counts, and of Student's distribution.

Each is smooth where model and measurement meet, so that least squares see what the likelihood sees (Pierce and Schafer
1986). The transforms whose derivative is the root of the expected Fisher information stabilise the variance.
"""

from __future__ import annotations

from mbm.expression.nodes import Operation
from mbm.expression.terms import Term, chosen, function, held, polynomial, square, square_root

SERIES = 0.2
"""Relative differences up to which logarithms are series: beyond, they lose one digit at most."""

LEAST = 1e-11
"""Expected counts whose roots have a finite slope down to zero, so that an estimate comes to rest there if nothing was
counted; of n trials n times that. Rounding of the expectation is less, and no count tells such rates from zero."""

_ATANH = [1.0 / (2 * k + 3) for k in range(9)]
"""``(atanh t - t)/t³`` in powers of t²: the last term is below 1e-17 at t = 1/9."""

_LOGARITHM = [1.0 / (2 * k + 1) for k in range(9)]
"""``atanh(t)/t`` in powers of t²."""


def poisson(counted: Term, mean: Term) -> Term:
    """The signed root of ``2 (μ - y + y log(y/μ))``, of ``2 μ`` for none counted."""
    none = ~(counted > 0.0)
    return chosen(none, _root(2.0 * mean, LEAST), (mean - counted) * square_root(_curvature(counted, mean)))


def binomial(counted: Term, trials: Term, mean: Term) -> Term:
    """The signed root of ``2 y log(y/μ) + 2 (n - y) log((n - y)/(n - μ))``."""
    off, missed = mean - counted, trials - counted
    own = square(off) * _curvature(counted, mean)
    rest = square(off) * _curvature(missed, trials - mean)
    between = off * square_root(_curvature(counted, mean) + _curvature(missed, trials - mean))
    none = _root(2.0 * mean + rest, LEAST * trials)
    every = -_root(own + 2.0 * (trials - mean), LEAST * trials)
    return chosen(~(counted > 0.0), none, chosen(~(missed > 0.0), every, between))


def student(ratio: Term, freedom: Term) -> Term:
    """The signed root of ``(ν + 1) log(1 + t²/ν)`` with t the ``ratio`` of the difference to the scale."""
    part = square(ratio) / freedom
    small = part < SERIES
    inner = part / (2.0 + part)
    near = 2.0 / (2.0 + part) * polynomial(_LOGARITHM, square(inner))
    far = function(Operation.LOG, 1.0 + part) / chosen(small, 1.0, part)
    return ratio * square_root((freedom + 1.0) / freedom * chosen(small, near, far))


def poisson_information(mean: Term) -> Term:
    """2 √μ: its derivative is 1/√μ."""
    return 2.0 * _root(mean, LEAST)


def binomial_information(trials: Term, mean: Term) -> Term:
    """2 √n atan √(μ/(n - μ)): its derivative is 1/√(μ (1 - μ/n))."""
    hit, missed = (_root(each, LEAST * trials) for each in (mean, trials - mean))
    return 2.0 * square_root(trials) * function(Operation.ATAN2, hit, missed)


def student_information(off: Term, scale: Term, freedom: Term) -> Term:
    """The location's: (ν + 1)/(ν + 3) of that of a normal distribution with this scale (Lange et al. 1989)."""
    return square_root((freedom + 1.0) / (freedom + 3.0)) * off / held(scale)


def _root(value: Term, least: Term | float) -> Term:
    """√a of what is above the ``least``; else continuous down to −least."""
    return square_root(chosen(value > least, value, 0.5 * (value + least)))


def _curvature(counted: Term, mean: Term) -> Term:
    """``2 (μ - y + y log(y/μ))/(μ - y)²``, 1/y where the two are equal; anything for y = 0."""
    whole = chosen(counted > 0.0, counted, 1.0)
    apart = (mean - whole) / whole
    small = function(Operation.ABS, apart) < SERIES
    t = apart / (2.0 + apart)
    near = (1.0 - t) - square(1.0 - t) * t * polynomial(_ATANH, square(t))
    far = 2.0 * (apart - function(Operation.LOG, mean / whole)) / chosen(small, 1.0, square(apart))
    return chosen(small, near, far) / whole
