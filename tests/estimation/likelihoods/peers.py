"""Likelihoods written anew with SciPy: what `:distribution`, limits, rounding and `model` are held against."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import binom, norm, poisson, t

Floats = NDArray[np.float64]
Log = Callable[[Floats, Floats], Floats]
"""log density of each row, from the parameters and the model's values."""


def most_likely(log_of: Callable[[Floats], float], start: Floats) -> Floats:
    """The parameters that maximise a log-likelihood, to some 1e-8 of their deviations."""
    found = np.asarray(start, dtype=np.float64)
    for _ in range(4):
        found = minimize(lambda p: -log_of(p), found, method="Nelder-Mead", options={"xatol": 1e-11, "fatol": 1e-13}).x
    return np.asarray(found)


def curvature(log_of: Callable[[Floats], float], at: Floats, steps: Floats) -> Floats:
    """The negative Hessian of a log-likelihood by differences of fourth order."""
    n = len(at)
    result = np.empty((n, n))
    offsets, weights = np.array([-2, -1, 1, 2]), np.array([1, -8, 8, -1]) / 12.0
    for i in range(n):
        for j in range(n):
            total = 0.0
            for a, wa in zip(offsets, weights, strict=True):
                for b, wb in zip(offsets, weights, strict=True):
                    p = at.copy()
                    p[i] += a * steps[i]
                    p[j] += b * steps[j]
                    total += wa * wb * log_of(p)
            result[i, j] = -total / (steps[i] * steps[j])
    return result


def sigmas(information: Floats) -> Floats:
    """Standard deviations from an information matrix."""
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(information))))


def of_counts(y: Floats, mean: Floats) -> float:
    """Poisson."""
    return float(poisson.logpmf(y, mean).sum()) if (mean > 0).all() else -1e300


def of_trials(y: Floats, trials: Floats, mean: Floats) -> float:
    """Binomial."""
    share = mean / trials
    return float(binom.logpmf(y, trials, share).sum()) if ((share > 0) & (share < 1)).all() else -1e300


def of_student(y: Floats, model: Floats, scale: float, freedom: float) -> float:
    """Student."""
    return float(t.logpdf((y - model) / scale, freedom).sum() - len(y) * np.log(scale))


def of_normal(y: Floats, model: Floats, sigma: Floats) -> float:
    """Normal, σ as it may be."""
    return float(norm.logpdf(y, model, sigma).sum()) if (sigma > 0).all() else -1e300


def of_limits(y: Floats, model: Floats, sigma: float, below: Floats, above: Floats) -> float:
    """Normal readings, some of them limits."""
    plain = norm.logpdf(y, model, sigma)
    low, high = norm.logcdf((y - model) / sigma), norm.logsf((y - model) / sigma)
    return float(np.where(below > 0, low, np.where(above > 0, high, plain)).sum())


def of_rounded(y: Floats, model: Floats, sigma: float, step: float) -> float:
    """Normal values rounded to multiples of a step."""
    upper, lower = (y + step / 2 - model) / sigma, (y - step / 2 - model) / sigma
    lower, upper = np.where(lower > 0, -upper, lower), np.where(lower > 0, -lower, upper)
    high, low = norm.logcdf(upper), norm.logcdf(lower)
    return float((high + np.log(-np.expm1(low - high))).sum())
