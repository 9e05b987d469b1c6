"""The pose of a desk by SciPy's Marquardt: the model by hand in NumPy, with and without its derivatives."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from benchmarks.peers import fastest, main


def answer(arrays: dict[str, np.ndarray]) -> dict[str, dict[str, float | list[float]]]:
    """``points`` (k, 3) of the desk, ``image`` (k, 2), ``start`` (yaw, ahead, left) → estimates, cost, seconds."""
    points, image, start = arrays["points"], arrays["image"], arrays["start"]
    scale, eye, sigma = 800.0, 1.5, 2.0
    a, b, c = points.T
    z = c - eye
    target = image.T / sigma

    def residuals(p: np.ndarray) -> np.ndarray:
        cosine, sine = np.cos(p[0]), np.sin(p[0])
        away = a * cosine - b * sine + p[1]
        left = a * sine + b * cosine + p[2]
        return (np.stack([left / away, z / away]) * (scale / sigma) - target).ravel()

    def jacobian(p: np.ndarray) -> np.ndarray:
        cosine, sine = np.cos(p[0]), np.sin(p[0])
        x, y = a * cosine - b * sine, a * sine + b * cosine
        away, left = x + p[1], y + p[2]
        k = scale / sigma / away
        zero = np.zeros_like(k)
        u = np.stack([k * (x + left * y / away), -k * left / away, k], axis=1)
        v = np.stack([k * z * y / away, -k * z / away, zero], axis=1)
        return np.concatenate([u, v])

    found = {}
    for name, options in (("finite differences", {}), ("exact Jacobian", {"jac": jacobian})):

        def solve(options: dict = options) -> object:
            return least_squares(residuals, start, method="lm", **options)

        fit = solve()
        found[name] = {"x": fit.x.tolist(), "cost": 2 * float(fit.cost), "seconds": fastest(solve, 200)}
    return found


if __name__ == "__main__":
    main(answer)
