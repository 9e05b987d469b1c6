"""Ultrasonic tags: 150 epochs of 48 ranges in one file by ``for-each``; problems/tags says the estimates of all."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mbm.cli.main import run
from tests.evidence.material import PROBLEMS

COVARIANCE = [
    [3.563327979937394e-05, 7.168929140793172e-11, 9.655316221553682e-08],
    [7.168929140793172e-11, 2.0566216196881215e-05, -7.977269834885016e-08],
    [9.655316221553682e-08, -7.977269834885016e-08, 2.4800909173755924e-06],
]
"""Of the first epoch at the first place, in m², for ranges of 10 mm: computed apart from mbm, in NumPy."""


@pytest.fixture(scope="module")
def document(tmp_path_factory):
    """The document that the command line writes for all epochs."""
    path = tmp_path_factory.mktemp("ultrasonic") / "out.json"
    assert run(["solve", str(PROBLEMS / "tags" / "tags.mbm"), "--json", str(path), "--quiet"]) == 0
    return json.loads(path.read_text())


def test_covariance_and_cost_of_the_first_epoch(document):
    solve = document["solves"][0]
    np.testing.assert_allclose(solve["covariance"]["matrix"], COVARIANCE, rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(solve["estimates"]["p"]["sigma"], np.sqrt(np.diag(COVARIANCE)), rtol=1e-6)
    # The reference's sum of squares is in m².
    assert solve["cost"] == pytest.approx(0.0051464962004527685 / 0.01**2, rel=1e-8)
    assert solve["dof"] == 45


def test_costs_of_all_epochs_follow_their_distribution(document):
    """150 epochs with 45 degrees of freedom each: the sum of the costs is 6750 ± 116."""
    assert len(document["solves"]) == 150
    total = sum(s["cost"] for s in document["solves"])
    assert abs(total - 6750) < 4 * np.sqrt(2 * 6750)
