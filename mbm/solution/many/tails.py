"""The upper tail of the χ² distribution for many values at once: the sums of `mbm.solution.gamma`, side by side."""

from __future__ import annotations

from math import lgamma

import numpy as np

from mbm.solution.gamma import SMALL, TERMS
from mbm.solution.types import Floats, Indices


@np.errstate(all="ignore")
def chi_square_tails(values: Floats, dof: Indices) -> Floats:
    """P(χ² > value) (n,) for finite values that are not negative, with ``dof`` (n,) degrees of freedom, at least one.

    Errors are those of `gamma.chi_square_tail`.
    """
    kinds, kind = np.unique(dof, return_inverse=True)
    factorial = np.array([lgamma(0.5 * k) for k in kinds.tolist()])[kind]
    a, x = 0.5 * dof.astype(np.float64), 0.5 * values
    front = np.exp(a * np.log(x) - x - factorial)
    low = x < a + 1.0
    result = np.empty(len(values))
    result[low] = np.clip(1.0 - front[low] * _series(a[low], x[low]), 0.0, 1.0)
    result[~low] = front[~low] * _fraction(a[~low], x[~low])
    return np.where(x > 0.0, result, 1.0)


def _series(a: Floats, x: Floats) -> Floats:
    term = 1.0 / a
    total = term.copy()
    for n in range(1, TERMS):  # terms that are too small change nothing any more
        term = term * (x / (a + n))
        total += term
        if not bool((term >= total * 1e-17).any()):
            break
    return total


def _fraction(a: Floats, x: Floats) -> Floats:
    b = x + 1.0 - a
    c, d = np.full(len(x), 1.0 / SMALL), 1.0 / b
    product, settled = d, np.zeros(len(x), dtype=bool)
    for n in range(1, TERMS):
        numerator = -n * (n - a)
        b = b + 2.0
        d = numerator * d + b
        d = 1.0 / np.where(np.abs(d) > SMALL, d, SMALL)
        c = b + numerator / c
        c = np.where(np.abs(c) > SMALL, c, SMALL)
        product = np.where(settled, product, product * (d * c))
        settled |= np.abs(d * c - 1.0) < 1e-16
        if bool(settled.all()):
            break
    return product
