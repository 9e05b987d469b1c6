"""Ultrasonic tags: 150 epochs of 48 ranges in one file by ``for-each``, against least squares computed without mbm."""

from __future__ import annotations

import csv
import json
import shutil

import numpy as np
import pytest

from mbm.cli.main import run
from tests.evidence.material import shared, shared_json

TEXT = """
(problem tags
  (data receivers (csv "receivers.csv") :key receiver)
  (data ranges (csv "ranges.csv") :with (receivers receiver) :columns ((range range_m)))
  (unknowns (p (vector 3) :init [1.75m 1.75m 1m]))
  (observe ranges
    (= range (distance p [receivers.x receivers.y receivers.z]))
    :sigma 10mm)
  (for-each position epoch))
"""


@pytest.fixture(scope="module")
def document(tmp_path_factory):
    """The document that the command line writes for all epochs."""
    folder = tmp_path_factory.mktemp("ultrasonic")
    for name in ("ranges.csv", "receivers.csv"):
        shutil.copy(shared("reference", "ultrasonic", name), folder / name)
    (folder / "tags.mbm").write_text(TEXT)
    assert run(["solve", str(folder / "tags.mbm"), "--json", str(folder / "out.json"), "--quiet"]) == 0
    return json.loads((folder / "out.json").read_text())


def test_all_epochs_agree_with_the_reference(document):
    with shared("reference", "ultrasonic", "estimates_clean.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    expected = {(float(r["position"]), float(r["epoch"])): [float(r[c]) for c in "xyz"] for r in rows}
    solves = {(s["key"]["position"], s["key"]["epoch"]): s for s in document["solves"]}
    assert solves.keys() == expected.keys()
    assert len(solves) == 150
    assert {s["status"] for s in solves.values()} == {"converged"}
    found = np.array([solves[k]["estimates"]["p"]["value"] for k in expected])
    # The reference is rounded at 1e-10 m and computed to 1e-8 m.
    np.testing.assert_allclose(found, np.array(list(expected.values())), rtol=0, atol=1e-8)


def test_covariance_and_cost_of_the_first_epoch(document):
    expected = shared_json("reference", "ultrasonic", "expected.json")["covariance of position 0, epoch 0, no outlier"]
    solve = document["solves"][0]
    # The reference's covariance holds with the stated 10 mm, as :sigma says; its sum of squares is in m².
    np.testing.assert_allclose(solve["covariance"]["matrix"], expected["cov"], rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(solve["estimates"]["p"]["sigma"], expected["stderr"], rtol=1e-6)
    assert solve["cost"] == pytest.approx(expected["sum_sq"] / 0.01**2, rel=1e-8)
    assert solve["dof"] == 45


def test_costs_of_all_epochs_follow_their_distribution(document):
    """150 epochs with 45 degrees of freedom each: the sum of the costs is 6750 ± 116."""
    total = sum(s["cost"] for s in document["solves"])
    assert abs(total - 6750) < 4 * np.sqrt(2 * 6750)
