"""A tag found from its distances to four receivers: the problem of CONTRACT §3, with the answer computed apart."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray

import mbm

RECEIVERS = np.array([[0.0, 0.0, 2.0], [4.0, 0.0, 2.0], [0.0, 4.0, 2.0], [4.0, 4.0, 2.5], [2.0, 0.0, 3.0]])
SIGMA = 0.005
TEXT = """
(problem tag "A tag among five receivers."
  (data receivers (table (id x y z) (1 0 0 2) (2 4 0 2) (3 0 4 2) (4 4 4 2.5) (5 2 0 3)) :key id)
  (data ranges external :with (receivers receiver))
  (constants (offset 0m))
  (unknowns (p (vector 3) :init [1 1 1] :unit m))
  (observe ranges
    (= range (+ offset (distance p [receivers.x receivers.y receivers.z])))
    :sigma 5mm)
  (derive (height (p 3) :unit mm)))
"""


def distances(point: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distances (5,) from a point to the receivers."""
    return np.asarray(np.linalg.norm(RECEIVERS - point, axis=1))


def measured(x: float = 1.2, y: float = 0.8, z: float = 0.74, seed: int = 0) -> dict[str, NDArray[np.float64]]:
    """Ranges from a true position, with noise of 5 mm."""
    noise = np.random.default_rng(seed).normal(0.0, SIGMA, len(RECEIVERS))
    return {"receiver": np.arange(1.0, 6.0), "range": distances(np.array([x, y, z])) + noise}


def gauss_newton(ranges: NDArray[np.float64], offset: float = 0.0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The least-squares position (3,) and its covariance (3, 3), by plain Gauss-Newton steps from (1, 1, 1)."""
    point = np.ones(3)
    for _ in range(50):
        jacobian = (point - RECEIVERS) / distances(point)[:, None]
        point = point - np.linalg.lstsq(jacobian, distances(point) + offset - ranges, rcond=None)[0]
    return point, np.linalg.inv(jacobian.T @ jacobian) * SIGMA**2


@pytest.fixture(scope="module")
def problem() -> mbm.Problem:
    return mbm.loads(TEXT)


@pytest.fixture
def ranges() -> dict[str, NDArray[np.float64]]:
    return measured()


@pytest.fixture
def solved(problem: mbm.Problem, ranges: Mapping[str, NDArray[np.float64]]) -> mbm.Solved:
    return problem.solve(data={"ranges": ranges})
