"""Roots of many polynomials of degree four at once."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats
from mbm.estimation.starts.closed_forms.numerics.finite import finite
from mbm.solver.decisions import NEARLY_REAL


def real_roots(coefficients: Floats) -> Floats:
    """Real roots (…, 4) of ``a₄x⁴ + … + a₀``, coefficients (…, 5) from the highest power; NaN beside them.

    The eigenvalues of the companion matrix, then two steps of Newton; a pair of almost equal roots counts as real.
    """
    leading = coefficients[..., :1]
    with np.errstate(invalid="ignore", divide="ignore"):
        monic = coefficients[..., 1:] / leading
    usable = finite(monic, -1)
    companion = np.zeros((*monic.shape[:-1], 4, 4))
    companion[..., 0, :] = -np.where(usable[..., None], monic, 0.0)
    companion[..., 1, 0] = companion[..., 2, 1] = companion[..., 3, 2] = 1.0
    roots = np.linalg.eigvals(companion)
    x = np.real(roots)
    is_real = (np.abs(np.imag(roots)) <= NEARLY_REAL * (1 + np.abs(x))) & usable[..., None]
    a, b, c, d = (monic[..., i, None] for i in range(4))
    with np.errstate(all="ignore"):
        for _ in range(2):
            value = (((x + a) * x + b) * x + c) * x + d
            slope = ((4 * x + 3 * a) * x + 2 * b) * x + c
            step = value / slope
            x = np.where(np.isfinite(step) & (np.abs(step) < 1e-3 * (1 + np.abs(x))), x - step, x)
    return np.where(is_real, x, np.nan)
