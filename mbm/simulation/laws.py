"""Standard variates of laws of distribution, after GUM Supplement 1, clause 6.4: mean 0 and standard deviation 1.

Of laws without a variance the scale is 1 instead.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import expm1, log, pi, sqrt
from types import MappingProxyType

import numpy as np

from mbm.equations.types import Floats
from mbm.problem.laws import ARCSINE, LOGNORMAL, NORMAL, RECTANGULAR, STUDENT, TRAPEZOIDAL, TRIANGULAR, Law

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
