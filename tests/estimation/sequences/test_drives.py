"""Whole drives with range radios of which nothing is known, without a start; drawn by `drives`."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

import mbm
from tests.estimation.sequences.drives import drive

TEXT = """
(problem drive
  (data poses external :key k) (data steps external)
  (data nodes external :key node) (data ranges external :with (nodes node))
  (unknowns
    (T (pose 2) :per poses :fixed (= k 0) :at (pose2 0 0 0))
    (p (vector 2) :per nodes) (gain :per nodes) (offset :per nodes))
  (observe steps (= (pose2 dx dy da) (between (T from) (T to))) :sigma [0.02 0.01 0.02])
  (observe ranges (= range (+ (* (gain node) (distance (translation (T k)) (p node))) (offset node))) :sigma 0.4))
"""


@pytest.mark.parametrize("seed", range(2))
def test_a_drive_among_nodes_of_unknown_place_scale_and_offset(seed):
    true, places, gains, offsets, tables = drive(seed)
    result = mbm.loads(TEXT).solve(data=tables, covariance_full=True)
    solve = result.result.solves[0]
    assert solve.status == "converged"
    assert solve.chi2_p > 0.001
    covariance = solve.covariance
    # what chance leaves outside is one of a thousand
    names = [f"{name}[{node}]{part}" for node in range(4) for name, part in (("p", "[1]"), ("p", "[2]"))]
    at = [covariance.names.index(name) for name in names]
    error = result["p"].value.ravel() - places.ravel()
    matrix = covariance.matrix[np.ix_(at, at)]
    assert chi2.ppf(5e-4, 8) < error @ np.linalg.solve(matrix, error) < chi2.ppf(1 - 5e-4, 8)
    moved = result["T"].value[1:, 1:] - true[1:, :2]
    assert np.mean(np.square(moved / result["T"].sigma[1:, 1:])) < 6.0
    for name, expected in (("gain", gains), ("offset", offsets)):
        assert np.abs((result[name].value - expected) / result[name].sigma).max() < 4.0
