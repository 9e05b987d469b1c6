"""Plaza 1 as a whole: half an hour of odometry and range radios of unknown scale and offset, without a start."""

from __future__ import annotations

import numpy as np
import pytest

from tests.evidence.material import loaded, measured
from tests.evidence.plaza import node_table, true_places

DRIVE = """
;; Where the mower went: odometry from pose to pose, and the ranges that were read at each.
(problem drive
  (data poses (csv "poses.csv") :key k)
  (data steps (csv "steps.csv"))
  (data nodes (csv "nodes.csv") :key node)
  (data ranges (csv "ranges.csv") :with (nodes node))
  (unknowns
    (T (pose 2) :per poses)
    (gain :per nodes)
    (offset :per nodes))
  (observe steps
    (= (pose2 dx dy da) (between (T from) (T to)))
    :sigma [(* 0.01 (sqrt dt)) (* 0.03 (sqrt dt)) (* 0.02 (sqrt dt))])
  (observe ranges
    (= range (+ (* (gain node) (distance (translation (T k)) [nodes.x nodes.y])) (offset node)))
    :sigma 0.6 :loss huber))
"""
APART = 0.45
"""Seconds from pose to pose at least."""


def recorded():
    """The tables, the true places of the poses (n, 2), and where dead reckoning from the true start puts the last."""
    import scipy.io

    found = scipy.io.loadmat(str(measured("plaza", "Plaza1_.mat")))
    truth, odometry, ranges = found["GT"], found["DR"], found["TD"]
    times = np.concatenate([truth[:1, 0], odometry[:, 0]])
    heading = np.concatenate([[0.0], np.cumsum(odometry[:, 2])])
    middle = heading[:-1] + odometry[:, 2] / 2
    ways = odometry[:, 1:2] * np.column_stack([np.cos(middle), np.sin(middle)])
    places = np.vstack([np.zeros((1, 2)), np.cumsum(ways, axis=0)])
    kept = [0]
    for i in range(1, len(times)):
        if times[i] - times[kept[-1]] >= APART or i == len(times) - 1:
            kept.append(i)
    k = np.array(kept)
    c, s = np.cos(heading[k[:-1]]), np.sin(heading[k[:-1]])
    dx, dy = np.diff(places[k], axis=0).T
    steps = {
        "from": k[:-1], "to": k[1:], "dx": c * dx + s * dy, "dy": c * dy - s * dx,
        "da": np.diff(heading[k]), "dt": np.diff(times[k]),
    }  # fmt: skip
    near = k[np.abs(ranges[:, :1] - times[k]).argmin(axis=1)]
    tables = {
        "poses": {"k": k.tolist()},
        "steps": {name: values.tolist() for name, values in steps.items()},
        "nodes": node_table(found["TL"]),
        "ranges": {"k": near.tolist(), "node": ranges[:, 2].astype(int).tolist(), "range": ranges[:, 3].tolist()},
    }
    return tables, true_places(truth, times[k]), found["DRp"][-1, 1:3]


@pytest.mark.slow
def test_the_whole_drive_without_a_start(tmp_path):
    tables, truth, reckoned = recorded()
    result = loaded(tmp_path, DRIVE, **tables).solve()
    assert result.first.status.trusted
    error = result["T"].value[:, 1:] - truth
    distance = np.linalg.norm(error, axis=1)
    assert np.sqrt(np.mean(distance**2)) < 0.3  # ranges scatter by 0.34 to 0.41 m at their best
    # dead reckoning has its start from GPS, and is 37 m off at the end
    assert distance[-1] < np.linalg.norm(reckoned - truth[-1]) / 10
    # scale and offset as the true places say: 6.8 to 7.1 % too long
    assert np.all(np.abs(result["gain"].value - 1.069) < 0.01)
    # mean square in standard deviations: the noise of odometry is a guess, and errors are correlated
    assert 0.3 < np.mean(np.square(error / result["T"].sigma[:, 1:])) < 3.0


@pytest.mark.slow
def test_the_whole_drive_with_nodes_of_unknown_places(tmp_path):
    """The first pose is known, the places of the nodes, their scales and offsets are not; no start."""
    tables, truth, _ = recorded()
    text = DRIVE.replace(
        "(T (pose 2) :per poses)",
        "(T (pose 2) :per poses :fixed (= k 0) :at (pose2 0 0 4.222432)) (p (vector 2) :per nodes)",
    ).replace("[nodes.x nodes.y]", "(p node)")
    result = loaded(tmp_path, text, **tables).solve()
    assert result.first.status.trusted
    error = result["T"].value[1:, 1:] - truth[1:]
    # mean square in standard deviations, which hold what the heading of the first pose is off, too
    assert np.mean(np.square(error / result["T"].sigma[1:, 1:])) < 3.0
    nodes = np.array([tables["nodes"]["x"], tables["nodes"]["y"]]).T
    assert np.abs((result["p"].value - nodes) / result["p"].sigma).max() < 3.0
    # the shape alone, after a rigid motion: as with places that are known
    inner, outer = result["T"].value[:, 1:], truth
    inner, outer = inner - inner.mean(axis=0), outer - outer.mean(axis=0)
    U, _, Vt = np.linalg.svd(inner.T @ outer)
    assert np.linalg.det(U @ Vt) > 0
    assert np.sqrt(np.mean(np.square(inner @ U @ Vt - outer).sum(axis=1))) < 0.3
