"""Independent answers for sequences: Kalman's filter and the smoother of Rauch, Tung and Striebel, in covariances."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def constant_velocity(dt: float, s: float) -> tuple[Floats, Floats]:
    """F and Q of a coordinate and its rate: white acceleration, constant within a step."""
    g = s * np.array([dt * dt / 2, dt])
    return np.array([[1.0, dt], [0.0, 1.0]]), np.outer(g, g)


def smoothed(
    moves: Sequence[tuple[Floats, Floats]],
    rows: Sequence[Sequence[tuple[Floats, float, float]]],
    mean: Floats,
    covariance: Floats,
) -> tuple[Floats, Floats, float]:
    """Means (T, n), covariances (T, n, n) given all rows, and the sum of the squared normalised innovations.

    ``moves`` are F and Q of the T − 1 transitions, ``rows`` for each step (h, z, sigma) of its measurements z = hᵀx.
    """
    filtered, predicted = [], []
    m, P, cost = mean, covariance, 0.0
    for k, measured in enumerate(rows):
        if k:
            F, Q = moves[k - 1]
            m, P = F @ m, F @ P @ F.T + Q
        predicted.append((m, P))
        for h, z, sigma in measured:
            s = h @ P @ h + sigma**2
            gain = P @ h / s
            cost += (z - h @ m) ** 2 / s
            m = m + gain * (z - h @ m)
            left = np.eye(len(m)) - np.outer(gain, h)
            P = left @ P @ left.T + np.outer(gain, gain) * sigma**2
        filtered.append((m, P))
    means, covariances = [filtered[-1][0]], [filtered[-1][1]]
    for k in range(len(rows) - 2, -1, -1):
        m, P = filtered[k]
        F, _ = moves[k]
        ahead, spread = predicted[k + 1]
        gain = P @ F.T @ np.linalg.pinv(spread, rcond=1e-12)
        means.insert(0, m + gain @ (means[0] - ahead))
        covariances.insert(0, P + gain @ (covariances[0] - spread) @ gain.T)
    return np.array(means), np.array(covariances), cost
