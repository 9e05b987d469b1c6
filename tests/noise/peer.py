"""Least squares written out with NumPy, and problems from text: what the solutions of these tests are compared with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import mbm


@dataclass(frozen=True)
class Fit:
    """Estimates (n,), covariance (n, n) for the stated noise, cost r'r and residuals in standard deviations."""

    x: np.ndarray
    covariance: np.ndarray
    residuals: np.ndarray

    @property
    def cost(self):
        return float(self.residuals @ self.residuals)

    @property
    def sigma(self):
        return np.sqrt(np.diag(self.covariance))


def linear(matrix, right, covariance) -> Fit:
    """Gauss-Markov: rows with a full covariance (m, m), or standard deviations (m,)."""
    covariance = np.asarray(covariance, dtype=float)
    if covariance.ndim == 1:
        covariance = np.diag(covariance**2)
    root = np.linalg.inv(np.linalg.cholesky(covariance))
    a, b = root @ np.asarray(matrix, dtype=float), root @ np.asarray(right, dtype=float)
    inverse = np.linalg.inv(a.T @ a)
    x = inverse @ a.T @ b
    return Fit(x, inverse, a @ x - b)


def helmert(matrix, right, sigma, groups):
    """Factors of the groups of unknown noise by Helmert's rigorous equations, iterated; others stay as stated.

    E(v_i' v_i) = Σ_j s_j² tr(R_ij R_ij'), with the redundancy matrix of the whitened rows R = I − A (A'A)⁻¹ A'
    (Koch, Parameter Estimation and Hypothesis Testing in Linear Models, 3.6): another way to the same fixed point.
    """
    matrix, right = np.asarray(matrix, dtype=float), np.asarray(right, dtype=float)
    factors = np.ones(len(groups))
    for _ in range(400):
        scale = np.array(sigma, dtype=float)
        for factor, rows in zip(factors, groups, strict=True):
            scale[rows] *= factor
        a, b = matrix / scale[:, None], right / scale
        r = np.eye(len(b)) - a @ np.linalg.solve(a.T @ a, a.T)
        v = r @ b
        stated = np.setdiff1d(np.arange(len(b)), np.concatenate(groups))
        known = [float(np.square(r[np.ix_(rows, stated)]).sum()) for rows in groups]
        table = np.array([[np.square(r[np.ix_(i, j)]).sum() for j in groups] for i in groups])
        squares = np.linalg.solve(table, np.array([v[rows] @ v[rows] for rows in groups]) - known)
        factors = factors * np.sqrt(squares)
        if np.abs(squares - 1).max() < 1e-13:
            break
    return factors


def solved(text, **options):
    """The one solve of a problem text."""
    return mbm.loads(text).solve(**options)


def table(name, **columns):
    """An inline table with all digits."""
    rows = zip(*columns.values(), strict=True)
    body = " ".join("(" + " ".join(repr(float(c)) for c in row) + ")" for row in rows)
    return f"(data {name} (table ({' '.join(columns)}) {body}))"


def matrix_text(matrix):
    """A literal matrix with all digits."""
    return "[" + " ".join("[" + " ".join(repr(float(e)) for e in row) + "]" for row in np.asarray(matrix)) + "]"


def values(result, *names):
    """Estimates one after another."""
    return np.concatenate([np.asarray(result[n].value, dtype=float).ravel() for n in names])


def sigmas(result, *names):
    """Standard deviations one after another."""
    return np.concatenate([np.asarray(result[n].sigma, dtype=float).ravel() for n in names])


def check(result, fit, *names, scale=1.0, rtol=1e-10):
    """Estimates, covariance (times scale²) and cost. Both solve the same well-conditioned equations in doubles."""
    np.testing.assert_allclose(values(result, *names), fit.x, rtol=rtol, atol=1e-12)
    np.testing.assert_allclose(sigmas(result, *names), scale * fit.sigma, rtol=rtol)
    np.testing.assert_allclose(result.covariance.matrix, scale**2 * fit.covariance, rtol=rtol, atol=1e-15)
