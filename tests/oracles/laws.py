"""The χ² law by mpmath with thirty digits, where mbm is asked for it, and how close it has to be."""

from __future__ import annotations

import functools

import mpmath
import numpy as np

EXACT = mpmath.mp.clone()
EXACT.dps = 30
"""A context of its own: what others compute with mpmath keeps its digits."""

FREEDOM = (1, 2, 3, 4, 7, 10, 31, 100, 301, 1000, 30_001, 1_000_000)
NEAR = (0.9, 0.99, 0.999, 1.0, 1.001, 1.01, 1.1)
SHARES = (1e-300, 1e-30, 1e-8, 1e-3, 0.1, 0.5, *NEAR, 2.0, 5.0, 30.0)
"""Of the degrees of freedom: where the tail is asked for; that of many is 0 or 1 to all digits but near them."""

GRID = [(share * dof, dof) for dof in FREEDOM for share in (SHARES if dof < 10_000 else NEAR[1:-1])]


@functools.cache
def tail(value: float, dof: int) -> mpmath.mpf:
    """P(χ² > value); of many degrees by the series of the lower part, with digits for what cancels."""
    a, x = EXACT.mpf(dof) / 2, EXACT.mpf(value) / 2
    if dof < 10_000:
        return EXACT.gammainc(a, x, EXACT.inf, regularized=True)
    with EXACT.workdps(70):
        term = total = EXACT.exp(a * EXACT.log(x) - x - EXACT.loggamma(a + 1))
        n = 0
        while term > total * EXACT.mpf(10) ** -70:
            n += 1
            term *= x / (a + n)
            total += term
        return 1 - total


def room(value: float, dof: int) -> float:
    """Relative error that is allowed: rounding of the exponent, which is as large as a log x. Below 1e-290 it is 0.

    `mbm.solver.chi_square` states 1e-12 for some hundred degrees of freedom and 1e-9 for a million.
    """
    a, x = 0.5 * dof, 0.5 * value
    return 1e-14 + 4 * 2.3e-16 * (a * abs(np.log(x)) + x + a * abs(np.log(a)))


def close(found: float, point: tuple[float, int]) -> bool:
    """Whether a tail is the one at a point of the grid."""
    wanted = tail(*point)
    if wanted < 1e-290:
        return 0.0 <= found < 1e-280
    return abs(found - wanted) <= room(*point) * wanted
