"""Drives without a start: the tree of poses is laid where ranges or fixes say that it is."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.estimation.search import aligning

DRIVE = """
(problem drive
  (data poses external :key k)
  (data steps external)
  (data nodes external :key node)
  (data ranges external :with (nodes node))
  (unknowns (T (pose 2) :per poses) (gain :per nodes) (offset :per nodes))
  (observe steps (= (pose2 x y a) (between (T from) (T to))) :sigma [0.005 0.01 0.01])
  (observe ranges
    (= range (+ (* (gain node) (distance (translation (T k)) [nodes.x nodes.y])) (offset node))) :sigma 0.1))
"""
COUNT = 120


def drive(seed):
    """A curved drive of 240 m among four nodes, with what a radio on it would read."""
    generator = np.random.default_rng(seed)
    angle = np.cumsum(generator.normal(0.1, 0.15, COUNT)) + generator.uniform(-3, 3)
    places = np.cumsum(2.0 * np.column_stack([np.cos(angle), np.sin(angle)]), axis=0)
    places -= places.mean(axis=0) + generator.uniform(-10, 10, 2)
    back = np.stack([np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) for a in angle])
    moved = np.einsum("nij,nj->ni", back[:-1], np.diff(places, axis=0)) + generator.normal(0, 0.01, (COUNT - 1, 2))
    turned = np.diff(angle) + generator.normal(0, 0.005, COUNT - 1)
    nodes = generator.uniform(-30, 30, (4, 2))
    gain, offset = generator.uniform(0.95, 1.1, 4), generator.normal(0, 0.5, 4)
    k, node = np.repeat(np.arange(COUNT), 2), generator.integers(0, 4, 2 * COUNT)
    range_ = gain[node] * np.linalg.norm(places[k] - nodes[node], axis=1) + offset[node]
    number = np.arange(float(COUNT))
    data = {
        "poses": {"k": number},
        "steps": {"from": number[:-1], "to": number[1:], "x": moved[:, 0], "y": moved[:, 1], "a": turned},
        "nodes": {"node": np.arange(4.0), "x": nodes[:, 0], "y": nodes[:, 1]},
        "ranges": {
            "k": k.astype(float),
            "node": node.astype(float),
            "range": range_ + generator.normal(0, 0.1, len(k)),
        },
    }
    return data, places, gain, offset


@pytest.mark.parametrize("seed", range(6))
def test_a_drive_is_found_by_ranges_of_unknown_scale_and_offset(seed):
    data, places, gain, offset = drive(seed)
    result = mbm.loads(DRIVE).solve(data=data)
    found, sigma = result["T"].value[:, 1:], result["T"].sigma[:, 1:]
    assert result.first.status.trusted
    assert 1e-4 < result.first.chi2_p < 1 - 1e-4
    assert np.linalg.norm(found - places, axis=1).max() < 1.0
    # mean square of errors in standard deviations; they are correlated along the drive
    assert 0.2 < np.mean(np.square((found - places) / sigma)) < 4.0
    assert np.abs((result["gain"].value - gain) / result["gain"].sigma).max() < 5
    assert np.abs((result["offset"].value - offset) / result["offset"].sigma).max() < 5


STATES = """
(problem drive
  (data steps external)
  (data nodes external :key node)
  (data ranges external :with (nodes node))
  (unknowns (gain :per nodes) (offset :per nodes))
  (states :over k (T (pose 2)))
  (dynamics (= (next T) (compose T (pose2 x y a)) :sigma [0.005 0.01 0.01]))
  (observe ranges
    (= range (+ (* (gain node) (distance (translation T) [nodes.x nodes.y])) (offset node))) :sigma 0.1))
"""


@pytest.mark.parametrize("seed", range(3))
def test_transitions_are_motions_that_are_measured(seed):
    """The same drive as states: their transitions make the tree of poses, too."""
    data, places, gain, offset = drive(seed)
    steps = {name: np.concatenate([[0.0], data["steps"][name]]) for name in "xya"}
    given = {"steps": {"k": np.arange(float(COUNT)), **steps}, "nodes": data["nodes"], "ranges": data["ranges"]}
    result = mbm.loads(STATES).solve(data=given)
    assert result.first.status.trusted
    assert result.first.cost == pytest.approx(mbm.loads(DRIVE).solve(data=data).first.cost, rel=1e-6)
    assert np.linalg.norm(result["T"].value[:, 1:] - places, axis=1).max() < 1.0
    assert np.abs((result["gain"].value - gain) / result["gain"].sigma).max() < 5
    assert np.abs((result["offset"].value - offset) / result["offset"].sigma).max() < 5


FLIGHT = """
(problem flight
  (data poses external :key k)
  (data steps external)
  (data fixes external)
  (unknowns (T (pose 3) :per poses))
  (observe steps (= (pose3 (quaternion qw qx qy qz) [x y z]) (between (T from) (T to))) :sigma 0.01)
  (observe fixes (= [x y z] (translation (T k))) :sigma 0.5))
"""


def test_a_flight_is_laid_on_its_fixes():
    generator = np.random.default_rng(3)
    turns = Rotation.random(40, random_state=3)
    places = np.cumsum(generator.normal(0, 3, (40, 3)), axis=0) + np.array([200.0, -50, 30])
    seen = turns[:-1].inv() * turns[1:]
    moved = turns[:-1].inv().apply(np.diff(places, axis=0)) + generator.normal(0, 0.01, (39, 3))
    k = np.arange(40.0)
    fixes = places + generator.normal(0, 0.5, places.shape)
    steps = dict(
        zip(
            ("from", "to", "x", "y", "z", "qx", "qy", "qz", "qw"),
            (k[:-1], k[1:], *moved.T, *seen.as_quat().T),
            strict=True,
        )
    )
    data = {"poses": {"k": k}, "steps": steps, "fixes": dict(zip(("k", "x", "y", "z"), (k, *fixes.T), strict=True))}
    result = mbm.loads(FLIGHT).solve(data=data)
    assert result.first.status.trusted
    assert np.linalg.norm(result["T"].value[:, 4:] - places, axis=1).max() < 1.5


def test_numbers_beside_which_no_pose_stands_are_not_solved_for_with_each_motion(monkeypatch):
    """A thousand of them took minutes: they have nothing to do with where the way lies."""
    asked = []

    class Asked(aligning.Tree):
        def __init__(self, part, entry, numbers, linear):
            asked.append((int(linear.sum()), len(part.groups)))
            super().__init__(part, entry, numbers, linear)

    monkeypatch.setattr(aligning, "Tree", Asked)
    found = (
        mbm.loads("""(problem walk
      (data gps (table (t x a) (0 0.1 0.1) (1 1.2 0.2) (2 1.9 0.2) (3 3.1 0.3)))
      (states :over t (p :init 0 :sigma 10) (T (pose 2) :init (pose2 0 0 0) :sigma 1))
      (dynamics (random-walk p :sigma 1) (random-walk T :sigma 0.1))
      (observe gps (= x p) :sigma 0.3)
      (observe turned gps (= a (heading T)) :sigma 1))""")
        .solve()
        .first.alternatives
    )
    assert found == ()
    assert {linear for linear, _ in asked} == {0}
