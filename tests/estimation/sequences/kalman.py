"""Kalman's filter and the smoother of Rauch, Tung and Striebel as textbooks have them, in NumPy, with inverses."""

from __future__ import annotations

import numpy as np


def filtered(mean, covariance, moves, rows):
    """Means, covariances and ``Σ vᵀS⁻¹v``; ``moves`` are (F, Q), ``rows`` (H, z, R) of each step."""
    means, covariances, cost = [], [], 0.0
    for k, (H, z, R) in enumerate(rows):
        if k:
            F, Q = moves[k - 1]
            mean, covariance = F @ mean, F @ covariance @ F.T + Q
        if len(z):
            v, S = z - H @ mean, H @ covariance @ H.T + R
            gain = covariance @ H.T @ np.linalg.inv(S)
            cost += v @ np.linalg.solve(S, v)
            mean, covariance = mean + gain @ v, covariance - gain @ S @ gain.T
        means.append(mean)
        covariances.append(covariance)
    return np.array(means), np.array(covariances), cost


def jointly(mean, covariance, moves, rows):
    """Means and covariances of all steps by one dense weighted least-squares problem, and its cost.

    Over what the first step (in the axes of its covariance that have a variance) and the noises (likewise) were: the
    covariances may be singular.
    """
    values, vectors = np.linalg.eigh(covariance)
    first = vectors[:, values > 1e-12] * np.sqrt(values[values > 1e-12])
    n = len(mean)
    roots = []
    for _, Q in moves:
        values, vectors = np.linalg.eigh(Q)
        roots.append(vectors[:, values > 1e-14] * np.sqrt(values[values > 1e-14]))
    size = first.shape[1] + sum(root.shape[1] for root in roots)
    at, place = np.zeros((n, size)), first.shape[1]
    at[:, :place] = first
    steps, means = [at], [mean]
    for (F, _), root in zip(moves, roots, strict=True):
        at = F @ steps[-1]
        at[:, place : place + root.shape[1]] += root
        place += root.shape[1]
        steps.append(at)
        means.append(F @ means[-1])
    lines, right = [np.eye(size)], [np.zeros(size)]
    for step, middle, (H, z, R) in zip(steps, means, rows, strict=True):
        if len(z):
            whiten = np.linalg.inv(np.linalg.cholesky(R))
            lines.append(whiten @ H @ step)
            right.append(whiten @ (z - H @ middle))
    A, b = np.vstack(lines), np.concatenate(right)
    solution = np.linalg.lstsq(A, b, rcond=None)[0]
    spread = np.linalg.inv(A.T @ A)
    found = np.array([middle + step @ solution for step, middle in zip(steps, means, strict=True)])
    return found, np.array([step @ spread @ step.T for step in steps]), float(np.sum((A @ solution - b) ** 2))
