"""ODRPACK on the ellipse of `benchmarks/ellipse.py`, with its default tolerances and with tight ones."""

from __future__ import annotations

import numpy as np
from odrpack import odr_fit

from benchmarks.peers import fastest, main

TIGHT = {"sstol": 1e-15, "partol": 1e-15, "maxit": 1000}


def ellipse(x: np.ndarray, beta: np.ndarray) -> np.ndarray:
    """Zero on the ellipse with middle, half axes and turn ``beta``."""
    p, q = x[0] - beta[0], x[1] - beta[1]
    cosine, sine = np.cos(beta[4]), np.sin(beta[4])
    return ((cosine * p + sine * q) / beta[2]) ** 2 + ((cosine * q - sine * p) / beta[3]) ** 2 - 1


def answer(arrays: dict[str, np.ndarray]) -> dict[str, dict[str, dict[str, list[float] | float]]]:
    """Points (k, 2) by name, and ``start`` → for each the five parameters and seconds, by kind of tolerance."""
    found: dict[str, dict[str, dict[str, list[float] | float]]] = {}
    for name, measured in arrays.items():
        if name == "start":
            continue
        points = measured.T
        found[name] = {}
        for kind, options in (("default", {}), ("tight", TIGHT)):

            def solve(points: np.ndarray = points, options: dict = options) -> object:
                zeros = np.zeros(points.shape[1])
                return odr_fit(ellipse, points, zeros, arrays["start"], task="implicit-ODR", **options)

            found[name][kind] = {"x": solve().beta.tolist(), "seconds": fastest(solve, 10)}
    return found


if __name__ == "__main__":
    main(answer)
