"""Random numbers of the simulation: a stream of its own for each equation, so that no order of work changes a draw."""

from __future__ import annotations

import zlib

import numpy as np

from mbm.equations.types import Floats, Mask
from mbm.expression.evaluate import Values, evaluate
from mbm.problem.types import Equation, NoiseKind
from mbm.simulation.places import Rows
from mbm.simulation.types import Outliers


def stream(seed: int, *names: str | int) -> np.random.Generator:
    """The generator of what ``names`` call, independent of all others (PCG64, spawned from the seed by name)."""
    words = [zlib.crc32(name.encode()) if isinstance(name, str) else name for name in names]
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(entropy=seed, spawn_key=tuple(words))))


def root(equation: Equation, rows: Rows, replaced: dict[str, Values]) -> Floats:
    """L (rows, k, k) with L Lᵀ the covariance of the components that the equation states; not the unknown factor."""
    size = len(equation.components)
    noise = np.empty((rows.count, len(equation.noise)))
    for j, column in enumerate(evaluate(equation.noise, rows.lookup(replaced))):
        noise[:, j] = column
    if equation.noise_kind is NoiseKind.SIGMA:
        return np.asarray(noise[:, :, None] * np.eye(size))
    lower = np.linalg.cholesky(noise.reshape(rows.count, size, size))
    if equation.noise_kind is NoiseKind.COVARIANCE:
        return np.asarray(lower)
    return np.asarray(np.linalg.inv(lower).transpose(0, 2, 1))


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
