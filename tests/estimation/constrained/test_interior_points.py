"""Interior points end where nothing but rounding changes the cost, instead of searching along it."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.estimation.minimise.constrained.ipopt import interior_point
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.settings import Settings
from mbm.problem.types import Method
from tests.estimation.constrained.toys import toy

WEIGHT = 1e10
"""Of rows that a straight line fits exactly; their gradient at the minimum is rounding times its square."""


@pytest.mark.parametrize("weight", [1.0, WEIGHT])
def test_a_start_at_a_minimum_of_heavy_rows_is_seen_as_one(weight: float) -> None:
    calls = 0

    def rows(x: np.ndarray) -> np.ndarray:
        nonlocal calls
        calls += 1
        heavy = weight * (x[0] + np.array([1.0, 2.0, 3.0]) * np.sin(x[1]) - np.array([1.1, 1.2, 1.3]))
        return np.stack([*heavy, x[2] - 0.7, x[2] - 0.9])

    start = np.array([1.0, np.arcsin(0.1), 0.3])
    problem = toy(rows, start, low=np.array([-100.0, -np.inf, -np.inf]), high=np.array([100.0, np.inf, np.inf]))
    found = minimise(problem, start, Settings(method=Method.IPOPT, max_iterations=100))
    np.testing.assert_allclose(found.point, [1.0, np.arcsin(0.1), 0.8], atol=1e-8)
    assert calls < 1500  # of fifty evaluations in each of 100 iterations


def test_ipopt_itself_gets_to_the_optimum() -> None:
    """Hock and Schittkowski's problem 14, before any steps of our own: Ipopt is given the right derivatives."""
    pytest.importorskip("casadi")
    start = np.array([2.0, 2.0])
    problem = toy(
        lambda x: np.stack([x[0] - 2, x[1] - 1]),
        start,
        equal=lambda x: np.stack([x[0] - 2 * x[1] + 1]),
        below=lambda x: np.stack([0.25 * x[0] ** 2 + x[1] ** 2 - 1]),
    )
    found = interior_point(problem, start, 100)
    # Ipopt relaxes inequalities by 1e-8, which moves the point by as much.
    np.testing.assert_allclose(found, [(np.sqrt(7) - 1) / 2, (np.sqrt(7) + 1) / 4], atol=1e-6)
