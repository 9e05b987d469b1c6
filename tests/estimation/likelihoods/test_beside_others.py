"""Clauses with a likelihood beside clauses with losses, errors in columns and common errors, against SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import norm

import mbm

X = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
Y = np.array([1.1, 2.3, 2.9, 4.2, 4.8])
N = np.array([1.0, 2.0, 3.0, 5.0, 4.0])
HUBER = 1.345

CLAUSES = {
    "model": "(= y (* a x)) :sigma (* 5% model)",
    "rounded": "(= n (* a x)) :sigma 0.5 :resolution 1",
    "loss": "(= x (+ b (* a y))) :sigma 0.1 :loss (huber 1.345)",
    "errors": "(= y (+ b (* a x))) :sigma 0.1 :errors ((x 0.1))",
    "common": "(= y (+ b (* a x))) :sigma 0.1 :common ((0.1 :per g))",
}
GROUPS = np.array([1, 1, 2, 2, 2])


def surprise(name, a, b):
    """-2 log L of a clause, up to a constant; the sum of the losses where there is one."""
    if name == "model":
        return np.sum(((Y - a * X) / (0.05 * a * X)) ** 2 + 2 * np.log(0.05 * a * X))
    if name == "rounded":
        ends = [norm.cdf((N + half - a * X) / 0.5) for half in (-0.5, 0.5)]
        return -2 * np.sum(np.log(ends[1] - ends[0]))
    if name == "loss":
        size = np.abs((X - b - a * Y) / 0.1)
        return np.sum(np.where(size <= HUBER, size**2, 2 * HUBER * size - HUBER**2))
    variance = 0.01 * np.eye(5)
    variance += 0.01 * a**2 * np.eye(5) if name == "errors" else 0.01 * (GROUPS[:, None] == GROUPS)
    residual = Y - b - a * X
    return residual @ np.linalg.solve(variance, residual)


@pytest.mark.parametrize("beside", ["loss", "errors", "common"])
@pytest.mark.parametrize("likely", ["model", "rounded"])
@pytest.mark.parametrize("keys", [1, 2])
def test_estimates(likely, beside, keys):
    rows = " ".join(f"({k} {x} {y} {n} {g})" for k in range(keys) for x, y, n, g in zip(X, Y, N, GROUPS, strict=True))
    text = f"""(problem p (data d (table (k x y n g) {rows})) (data e (table (k x y n g) {rows}))
      (unknowns (a :init 1) (b :init 0 :sigma 1))
      (observe f d {CLAUSES[likely]}) (observe h e {CLAUSES[beside]}) {"(for-each k)" if keys > 1 else ""})"""
    result = mbm.loads(text).solve()
    found = minimize(
        lambda p: surprise(likely, *p) + surprise(beside, *p) + p[1] ** 2,
        [1.0, 0.0],
        method="Nelder-Mead",
        options={"xatol": 1e-9, "fatol": 1e-12, "maxiter": 5000},
    )
    for solve in result.solves:
        assert solve.status == "converged"
        # SciPy compares values, which are flat to rounding within some 1e-7 of the minimum
        np.testing.assert_allclose([solve["a"].value, solve["b"].value], found.x, atol=2e-6)
        assert str(solve)
        if beside == "loss" and likely == "model":
            a, b = found.x
            deviance = np.sum(((Y - a * X) / (0.05 * a * X)) ** 2)
            expected = deviance + surprise("loss", a, b) + b**2  # CONTRACT §2: the log-determinant is not in the cost
            assert solve.record.robust_cost == pytest.approx(expected, rel=1e-5)
