"""The upper tail of the χ² distribution, without loading SciPy for one number."""

from __future__ import annotations

from math import exp, inf, lgamma, log

TERMS = 100_000
SMALL = 1e-300


def chi_square_tail(value: float, dof: int) -> float:
    """P(χ² > value) for ``dof`` degrees of freedom: the regularised incomplete gamma function Q(dof/2, value/2).

    Series below the mean, Lentz's continued fraction above (Press et al., Numerical Recipes, 6.2); relative errors of
    1e-12 for some hundred degrees of freedom, 1e-9 for a million.
    """
    a, x = 0.5 * dof, 0.5 * value
    if x <= 0.0:
        return 1.0
    if x == inf:
        return 0.0
    front = exp(a * log(x) - x - lgamma(a))
    if x < a + 1.0:
        return min(max(1.0 - front * _series(a, x), 0.0), 1.0)
    return front * _fraction(a, x)


def _series(a: float, x: float) -> float:
    term = total = 1.0 / a
    for n in range(1, TERMS):
        term *= x / (a + n)
        total += term
        if term < total * 1e-17:
            break
    return total


def _fraction(a: float, x: float) -> float:
    b = x + 1.0 - a
    c, d = 1.0 / SMALL, 1.0 / b
    product = d
    for n in range(1, TERMS):
        numerator = -n * (n - a)
        b += 2.0
        d = numerator * d + b
        d = 1.0 / (d if abs(d) > SMALL else SMALL)
        c = b + numerator / c
        c = c if abs(c) > SMALL else SMALL
        product *= d * c
        if abs(d * c - 1.0) < 1e-16:
            break
    return product
