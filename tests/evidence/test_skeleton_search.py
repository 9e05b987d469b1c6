"""The figure of 25 degrees of freedom within its joint limits, from random starts: the four postures that fit best."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.evidence.skeleton import COSTS, POSE, joints_at, postures, seen, write_example

STARTS = 120


@pytest.fixture(scope="module")
def solve(tmp_path_factory):
    """The example as it stands, with fewer starts."""
    path = write_example(tmp_path_factory.mktemp("skeleton"), STARTS)
    return mbm.load(path).named("skeleton-limits").solve().first


def posture(estimates):
    by_name = {e.name: e for e in estimates}
    angles = dict(zip(by_name["q"].keys, np.asarray(by_name["q"].value).tolist(), strict=True))
    joints = joints_at({**{n: float(by_name[n].value) for n in POSE}, **angles})
    return np.array([joints[name] for name in seen()])


def test_a_fifth_of_the_starts_and_more_reach_the_best_minimum(solve):
    assert solve.status == "converged"
    assert solve.cost == pytest.approx(COSTS[0], rel=1e-8)
    assert solve.starts.tried == STARTS
    assert solve.starts.best_found / STARTS >= 0.2


def test_the_four_postures_within_the_limits_are_found_and_no_other(solve):
    best = [a for a in solve.alternatives if a.cost < solve.cost * (1 + 1e-6)]
    found = [posture(solve.estimates), *(posture(a.estimates) for a in best)]
    listed = [np.array(list(map(joints_at(angles).get, seen()))) for angles in postures()]
    assert len(found) == len(listed) == 4
    for joints in listed:
        # The listed solutions are good to 1e-7 m.
        assert min(np.abs(joints - other).max() for other in found) < 1e-7
    assert "another-solution" in [d.code.name for d in solve.diagnostics]
