"""Standard variates of laws of distribution, after GUM Supplement 1, clause 6.4: mean 0 and standard deviation 1.

Of laws without a variance the scale is 1 instead.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import expm1, lgamma, log, pi, sqrt
from types import MappingProxyType

import numpy as np

from mbm.equations.types import Floats
from mbm.problem.overrides import ARCSINE, LOGNORMAL, NORMAL, RECTANGULAR, STUDENT, TRAPEZOIDAL, TRIANGULAR, Law

Shape = tuple[int, ...]


def standard_variates(law: Law, rng: np.random.Generator, shape: Shape) -> Floats:
    """Independent variates of a law, in an array of a ``shape``."""
    return _DRAWS[law.name](rng, shape, law.shape)


def _normal(rng: np.random.Generator, shape: Shape, _: float) -> Floats:
    return rng.standard_normal(shape)


def _trapezoidal(rng: np.random.Generator, shape: Shape, ratio: float) -> Floats:
    """The sum of two rectangular variates, of half widths (1 ± ratio)/2 (6.4.4.4)."""
    first, second = (rng.random(shape) - 0.5 for _ in range(2))
    return np.asarray(((1.0 + ratio) * first + (1.0 - ratio) * second) * sqrt(6.0 / (1.0 + ratio**2)))


def _rectangular(rng: np.random.Generator, shape: Shape, _: float) -> Floats:
    return np.asarray((rng.random(shape) - 0.5) * sqrt(12.0))


def _triangular(rng: np.random.Generator, shape: Shape, _: float) -> Floats:
    return _trapezoidal(rng, shape, 0.0)


def _arcsine(rng: np.random.Generator, shape: Shape, _: float) -> Floats:
    return np.asarray(np.sin(2.0 * pi * rng.random(shape)) * sqrt(2.0))


def _student(rng: np.random.Generator, shape: Shape, dof: float) -> Floats:
    found = rng.standard_t(dof, shape)
    return np.asarray(found * sqrt((dof - 2.0) / dof) if dof > 2.0 else found)


def _lognormal(rng: np.random.Generator, shape: Shape, factor: float) -> Floats:
    deviation = log(factor)
    variance = deviation**2
    return np.asarray(np.expm1(deviation * rng.standard_normal(shape) - variance / 2.0) / sqrt(expm1(variance)))


_DRAWS: Mapping[str, Callable[[np.random.Generator, Shape, float], Floats]] = MappingProxyType(
    {
        NORMAL: _normal,
        RECTANGULAR: _rectangular,
        TRIANGULAR: _triangular,
        TRAPEZOIDAL: _trapezoidal,
        ARCSINE: _arcsine,
        STUDENT: _student,
        LOGNORMAL: _lognormal,
    }
)


@np.errstate(all="ignore")
def log_densities(law: Law, variates: Floats) -> Floats:
    """The logarithms of the density of standard variates of a law, in an array of their shape; −∞ where it is none."""
    return np.where(np.isfinite(variates), _DENSITIES[law.name](variates, law.shape), -np.inf)


def _log_normal_density(variates: Floats, _: float) -> Floats:
    return np.asarray(-0.5 * np.square(variates) - HALF_LOG_TURN)


def _log_trapezoidal(variates: Floats, ratio: float) -> Floats:
    """With half a base of √(6/(1 + β²)), β of which is flat."""
    base = sqrt(6.0 / (1.0 + ratio**2))
    height = 1.0 / (base * (1.0 + ratio))
    slope = 1.0 if ratio == 1.0 else (base - np.abs(variates)) / (base * (1.0 - ratio))
    return np.where(np.abs(variates) <= base, np.log(height * np.minimum(1.0, slope)), -np.inf)


def _log_arcsine(variates: Floats, _: float) -> Floats:
    left = 2.0 - np.square(variates)
    return np.where(left > 0.0, -log(pi) - 0.5 * np.log(left), -np.inf)


def _log_student(variates: Floats, dof: float) -> Floats:
    scale = sqrt((dof - 2.0) / dof) if dof > 2.0 else 1.0
    constant = lgamma((dof + 1.0) / 2.0) - lgamma(dof / 2.0) - 0.5 * log(dof * pi) - log(scale)
    return np.asarray(constant - (dof + 1.0) / 2.0 * np.log1p(np.square(variates / scale) / dof))


def _log_lognormal(variates: Floats, factor: float) -> Floats:
    deviation = log(factor)
    spread = sqrt(expm1(deviation**2))
    share = 1.0 + spread * variates  # of the mean
    normal = (np.log(share) + deviation**2 / 2.0) / deviation
    found = -0.5 * np.square(normal) - HALF_LOG_TURN - np.log(deviation * share) + log(spread)
    return np.where(share > 0.0, found, -np.inf)


HALF_LOG_TURN = 0.5 * log(2.0 * pi)

_DENSITIES: Mapping[str, Callable[[Floats, float], Floats]] = MappingProxyType(
    {
        NORMAL: _log_normal_density,
        RECTANGULAR: lambda variates, _: _log_trapezoidal(variates, 1.0),
        TRIANGULAR: lambda variates, _: _log_trapezoidal(variates, 0.0),
        TRAPEZOIDAL: _log_trapezoidal,
        ARCSINE: _log_arcsine,
        STUDENT: _log_student,
        LOGNORMAL: _log_lognormal,
    }
)
