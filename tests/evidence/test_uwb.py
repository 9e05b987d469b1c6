"""Ultra-wideband ranges to four anchors on a robot (Hanyang University): positions against RTK, and the authors' own.

The tag's height is in no file. A second of ranges at a time gives place, velocity and height; about one range in a
hundred is wrong by metres.
"""

from __future__ import annotations

import csv
import gzip

import numpy as np
import pytest

import mbm
from tests.evidence.material import measured

TEXT = """
;; Where the tag is at the end of each second.
(problem uwb
  (data anchors external :key id)
  (data ranges external :with (anchors anchor))
  (unknowns
    (p (vector 2) :init [-2.5m -4.3m])
    (v (vector 2) :init [0m/s 0m/s] :sigma 1m/s)
    (h :init 1m :sigma 30cm :doc "height of the tag"))
  (define (dt (- t (last ranges t))))
  (observe ranges
    (= range (distance [(+ (p 1) (* (v 1) dt)) (+ (p 2) (* (v 2) dt)) h] [anchors.x anchors.y anchors.z]))
    :sigma 15cm)
  (window t :length 1s :step 3s :min-rows 8)
  (solve :robust lmeds))
"""
PUBLISHED = {
    ("LOS", 1): 1.0383547322536963,
    ("LOS", 2): 1.9045423280766862,
    ("NLOS", 1): 0.9775441358666646,
    ("NLOS", 2): 1.2340720983590954,
}
"""`LS RMSE_2d` of the authors' RMSD_results.txt, in m."""


def rows_of(path):
    with gzip.open(path, "rt") as stream:
        return list(csv.reader(stream))[1:]


def scene(sight, case):
    """Anchors (4, 3), ranges (t, anchor, range) in time order, truth (t, x, y), and the authors' least squares."""
    folder = measured("hanyang_uwb", sight, "Trajectory_A", f"Case_{case}")
    truth = np.array([[float(c) for c in r[:3]] for r in rows_of(folder / "trajectory.csv.gz")])
    begin = truth[0, 0]
    truth[:, 0] = (truth[:, 0] - begin) / 1e9
    anchors, ranges = [], []
    for number, name in enumerate(("A3", "A5", "A9", "A12")):
        rows = rows_of(folder / f"{name}.csv.gz")
        anchors.append([float(c) for c in rows[0][3:6]])
        ranges += [((int(r[1]) - begin) / 1e9, number, float(r[6])) for r in rows]
    inside = [r for r in sorted(ranges) if 0.0 <= r[0] <= truth[-1, 0]]
    theirs = np.array([[(int(r[0]) - begin) / 1e9, float(r[1]), float(r[2])] for r in rows_of(folder / "LS.csv.gz")])
    return np.array(anchors), np.array(inside), truth, theirs


def distances(times, places, truth):
    at = np.column_stack([np.interp(times, truth[:, 0], truth[:, i]) for i in (1, 2)])
    return np.linalg.norm(places - at, axis=1)


@pytest.mark.parametrize(("sight", "case"), PUBLISHED)
def test_positions_are_better_than_the_authors_least_squares(sight, case):
    anchors, ranges, truth, theirs = scene(sight, case)
    data = {
        "anchors": {"id": np.arange(4.0), **{c: anchors[:, i] for i, c in enumerate("xyz")}},
        "ranges": {"t": ranges[:, 0], "anchor": ranges[:, 1], "range": ranges[:, 2]},
    }
    result = mbm.loads(TEXT).solve(data=data)
    solves = [s for s in result.solves if s.status.trusted and s.estimates]
    assert len(solves) >= 0.9 * len(result.solves)  # there are gaps of seconds in the ranges
    times = np.array([next(iter(s.key.values())) for s in solves])
    errors = distances(times, np.array([s.estimates[0].value for s in solves]), truth)
    ours = float(np.sqrt(np.mean(errors**2)))
    # Their file leads to their published figure, or to a worse one where it holds positions that they left out.
    assert ours < 0.95 * PUBLISHED[sight, case]
    assert ours < 0.95 * np.sqrt(np.mean(distances(theirs[:, 0], theirs[:, 1:], truth) ** 2))
    heights = np.array([s.estimates[2].value for s in solves])
    assert 0.7 < np.median(heights) < 1.4
