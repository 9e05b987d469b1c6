"""Random numbers of the simulation: a stream of its own for each equation, so that no order of work changes a draw.
Standard variates of laws of distribution, after GUM Supplement 1, clause 6.4: mean 0 and standard deviation 1.

Of laws without a variance the scale is 1 instead.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from math import expm1, lgamma, log, pi, sqrt
from types import MappingProxyType

import numpy as np

from mbm.equations.types import Floats, Mask
from mbm.expression.evaluate import Values, evaluate
from mbm.problem.faults.noise import bad_noise
from mbm.problem.overrides import ARCSINE, LOGNORMAL, NORMAL, RECTANGULAR, STUDENT, TRAPEZOIDAL, TRIANGULAR, Law
from mbm.problem.types import Equation, NoiseKind
from mbm.simulation.rows import Rows
from mbm.simulation.types import Outliers
from mbm.text.types import Diagnostic, MbmError

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


def stream(seed: int, *names: str | int) -> np.random.Generator:
    """The generator of what ``names`` call, independent of all others (PCG64, spawned from the seed by name)."""
    words = [zlib.crc32(name.encode()) if isinstance(name, str) else name for name in names]
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(entropy=seed, spawn_key=tuple(words))))


def root(equation: Equation, rows: Rows, replaced: dict[str, Values]) -> Floats:
    """L (rows, k, k) with L Lᵀ the covariance of the components that the equation states; not the unknown factor.

    Raises:
        MbmError: `bad-noise`, a matrix that is not positive definite.

    """
    size = len(equation.components)
    noise = np.empty((rows.count, len(equation.noise)))
    for j, column in enumerate(evaluate(equation.noise, rows.lookup(replaced))):
        noise[:, j] = column
    if equation.noise_kind is NoiseKind.SIGMA:
        return np.asarray(noise[:, :, None] * np.eye(size))
    matrices = noise.reshape(rows.count, size, size)
    try:
        lower = np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        raise MbmError(_no_covariance(equation, rows, matrices)) from None
    if equation.noise_kind is NoiseKind.COVARIANCE:
        return np.asarray(lower)
    return np.asarray(np.linalg.inv(lower).transpose(0, 2, 1))


def _no_covariance(equation: Equation, rows: Rows, matrices: Floats) -> Diagnostic:
    """The first of the ``matrices`` (rows, k, k) that is not positive definite."""
    finite: Mask = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    lowest = np.linalg.eigvalsh(np.where(finite[:, None, None], matrices, 0.0))[:, 0]
    what = f"the {equation.noise_kind.value} matrix is not positive definite"
    place = None
    if rows.table is not None and rows.positions is not None:
        place = rows.table.place(int(rows.positions[np.argmin(lowest)]))
    return bad_noise(equation.noise[0].span or equation.span, what, place)


def outliers(rng: np.random.Generator, rows: int, components: int, wanted: Outliers | None) -> tuple[Floats, Mask]:
    """What gross errors add to the standard normal numbers (rows, components), and the rows that have one."""
    if wanted is None:
        return np.zeros((rows, components)), np.zeros(rows, dtype=bool)
    hit = rng.random(rows) < wanted.fraction
    direction = rng.standard_normal((rows, components))
    if wanted.one_sided:
        direction = np.ones((rows, components))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return np.where(hit[:, None], wanted.size * direction, 0.0), hit
