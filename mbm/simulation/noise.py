"""Random numbers of the simulation: a stream of its own for each equation, so that no order of work changes a draw."""

from __future__ import annotations

import zlib

import numpy as np

from mbm.equations.types import Floats, Mask
from mbm.expression.evaluate import Values, evaluate
from mbm.problem.faults.noise import bad_noise
from mbm.problem.types import Equation, NoiseKind
from mbm.simulation.places import Rows
from mbm.simulation.types import Outliers
from mbm.text.types import Diagnostic, MbmError


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
