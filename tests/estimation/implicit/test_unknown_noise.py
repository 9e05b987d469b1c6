"""Stated errors of x beside unknown noise of y, with the true values among the unknowns: restricted likelihood."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

import mbm

TEXT = """(problem p (data d external :key i) (unknowns (a) (b) (t :per d :init x :sigma u))
  (observe d (= y (+ a (* b (t i)))) :sigma unknown))"""


def test_unknown_noise_is_told_from_stated_errors() -> None:
    rng, count = np.random.default_rng(3), 12
    true, u = np.linspace(0.0, 10.0, count), np.linspace(0.1, 0.5, count)
    x, y = true + u * rng.normal(size=count), 2.0 - true + 0.5 * rng.normal(size=count)
    found = mbm.loads(TEXT).solve(data={"d": {"i": np.arange(count), "x": x, "u": u, "y": y}})
    s = found.noise["d"]
    a, b = minimize(lambda p: np.sum((y - p[0] - p[1] * x) ** 2 / (s**2 + (p[1] * u) ** 2)), [2.0, -1.0], tol=1e-12).x
    # as far as BFGS settles a minimum without derivatives
    assert [float(found["a"].value), float(found["b"].value)] == pytest.approx([a, b], rel=1e-6)
    whole = s**2 + (b * u) ** 2
    misfit = y - a - b * x
    rows = np.column_stack([np.ones(count), x + b * u**2 * misfit / whole]) / np.sqrt(whole)[:, None]
    covariance = np.linalg.inv(rows.T @ rows)
    leverage = np.einsum("ij,jk,ik->i", rows, covariance, rows)
    score = (s**2 / whole * (misfit**2 / whole - 1.0 + leverage)).sum()  # of log s², Patterson and Thompson 1971
    assert abs(score) < 1e-5
    assert [float(found["a"].sigma), float(found["b"].sigma)] == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-6)
