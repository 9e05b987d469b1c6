"""What the kinds are made of: problem texts, and tables of many runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from benchmarks.coverage.judging import Floats, Kind, Tables, Truth

LINE = "(= y (+ a (* b x)))"
Noise = Callable[[np.random.Generator, tuple[int, int]], Floats]


def problem(unknowns: str, observe: str, more: str = "") -> str:
    """A problem with one table, `d`."""
    return f"(problem p (data d external) (unknowns {unknowns}) (observe d {observe}) {more})"


def table(runs: int, **columns: Any) -> Mapping[str, Floats]:
    """Columns (rows,) of all runs, or (runs, rows), under one another."""
    rows = max(np.shape(each)[-1] for each in columns.values())
    found = {name: np.broadcast_to(each, (runs, rows)).ravel() for name, each in columns.items()}
    return {"run": np.repeat(np.arange(runs, dtype=np.float64), rows), **found}


def normal(sigma: Any) -> Noise:
    """Normal noise."""
    return lambda rng, shape: rng.normal(size=shape) * sigma


def scatter(
    text: str, x: Floats, true: Floats, noise: Noise, truth: Truth, *, more: Mapping[str, Any] | None = None
) -> Kind:
    """Readings `y` = ``true`` (rows,) + noise at the places `x`."""

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        y = true + noise(rng, (runs, len(true)))
        return {"d": table(runs, x=x, y=y, **(more or {}))}, truth

    return Kind(text, make)


def drawn(text: str, draw: Callable[[np.random.Generator, int], Mapping[str, Any]], truth: Truth) -> Kind:
    """One table, whose columns are drawn for all runs."""

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        return {"d": table(runs, **draw(rng, runs))}, truth

    return Kind(text, make)


def line(text: str, x: Floats, noise: Noise, **more: Any) -> Kind:
    """Readings on the line 2 − x."""
    return scatter(text, x, 2.0 - x, noise, {"a": 2.0, "b": -1.0}, more=more)


def autoregressive(rho: float, sigma: float) -> Noise:
    """Noise of the standard deviation ``sigma`` whose neighbours have the correlation ``rho``."""

    def noise(rng: np.random.Generator, shape: tuple[int, int]) -> Floats:
        white = rng.normal(size=shape)
        found = white.copy()
        for place in range(1, shape[1]):
            found[:, place] = rho * found[:, place - 1] + np.sqrt(1 - rho**2) * white[:, place]
        return sigma * found

    return noise


def with_outliers(share: float, times: float, sigma: float) -> Noise:
    """Normal noise, a ``share`` of it ``times`` as large."""

    def noise(rng: np.random.Generator, shape: tuple[int, int]) -> Floats:
        found = rng.normal(size=shape) * sigma
        return np.where(rng.random(shape) < share, times * found, found)

    return noise
