"""Bundle adjustment and pose graphs of others, read as they are: the costs that are known, and what stays free."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.report.types import SolveStatus
from tests.evidence.material import measured

GRAPH = """
(problem pose-graph
  (data nodes (g2o "{file}" :vertices))
  (data edges (g2o "{file}" :edges :information {information}))
  (unknowns (T (pose 2) :per nodes :init (pose2 x y theta)))
  (observe edges
    (= (pose2 dx dy dtheta) (between (T from) (T to)))
    :information information)
  (solve :gauge {gauge}))
"""
COSTS = {
    "from": {"CSAIL.g2o": 61.143, "intel.g2o": 44.418, "manhattan.g2o.gz": 3533.458, "kitti_00.g2o.gz": 98.263},
    "measured": {"CSAIL.g2o": 40.55, "intel.g2o": 45.00, "manhattan.g2o.gz": 3549.04, "kitti_00.g2o.gz": 98.32},
}
"""Best sums of squares found by the collectors of the files, to the digits given, and those of GTSAM."""

BUNDLE = """
(defun snavely (cam p)
  (let* ((P  (+ (rotate (axis-angle [(cam 1) (cam 2) (cam 3)]) p) [(cam 4) (cam 5) (cam 6)]))
         (x  (- (/ (P 1) (P 3))))
         (y  (- (/ (P 2) (P 3))))
         (r2 (+ (* x x) (* y y)))
         (d  (* (cam 7) (+ 1 (* r2 (+ (cam 8) (* (cam 9) r2)))))))
    [(* d x) (* d y)]))
(problem bundle
  (data cameras (bal "{file}" :cameras))
  (data points  (bal "{file}" :points))
  (data seen    (bal "{file}" :observations))
  (unknowns
    (cam (vector 9) :per cameras :init [r1 r2 r3 t1 t2 t3 f k1 k2])
    (pt  (vector 3) :per points  :init [x y z]))
  (observe seen (= [u v] (snavely (cam camera) (pt point))) :sigma 1)
  (solve :gauge free))
"""


def solve_graph(name, gauge="free", information="measured"):
    file = measured("posegraph", name)
    return mbm.loads(GRAPH.format(file=file, gauge=gauge, information=information)).solve()


@pytest.mark.parametrize(("information", "name"), [(way, name) for way, costs in COSTS.items() for name in costs])
def test_pose_graphs_reach_the_best_known_cost(information, name):
    found = solve_graph(name, information=information)
    assert found.first.status is SolveStatus.CONVERGED
    digits = 6e-4 if information == "from" else 6e-3
    assert found.first.cost == pytest.approx(COSTS[information][name], abs=digits)  # the digits given
    assert (found["T"].sigma > 0).all()


def test_a_pose_graph_may_move_as_a_whole():
    found = solve_graph("intel.g2o", gauge="report")
    assert found.first.status is SolveStatus.UNOBSERVABLE
    seen = found.observability
    assert seen.dimension - seen.rank == 3
    assert [(g.motion, g.dimensions) for g in seen.gauge] == [("translation", 2), ("rotation", 1)]
    assert "fix one position" in seen.gauge[0].sentence
    assert np.isnan(found["T"].sigma).all()


@pytest.mark.slow
def test_ladybug():
    found = mbm.loads(BUNDLE.format(file=measured("bundle", "problem-16-22106-pre.txt.bz2"))).solve()
    assert found.first.status is SolveStatus.CONVERGED
    assert found.first.cost / 2 == pytest.approx(18033.90, abs=0.01)  # as the Ceres solver has it
    assert found.observability.dimension == 16 * 9 + 22106 * 3
    assert [(g.motion, g.dimensions) for g in found.observability.gauge] == [
        ("translation", 3), ("rotation", 3), ("scale", 1),
    ]  # fmt: skip
    assert (found["pt"].sigma > 0).all()
    assert found.first.dof == 2 * 83718 - (16 * 9 + 22106 * 3 - 7)
    assert found.covariance.matrix is None  # left out for its size


@pytest.mark.slow
def test_a_known_distance_settles_the_scale_of_ladybug():
    """A constraint on what the data leave free costs nothing."""
    distance = "(constraints (= (distance (pt 3) (pt 77)) 1.5))"
    text = BUNDLE.format(file=measured("bundle", "problem-16-22106-pre.txt.bz2"))
    found = mbm.loads(text.rstrip()[:-1] + f" {distance})").solve()
    assert found.first.method == "penalty-sparse"
    assert found.first.cost / 2 == pytest.approx(18033.90, abs=0.01)
    assert [(g.motion, g.dimensions) for g in found.observability.gauge] == [("translation", 3), ("rotation", 3)]
    assert found.first.dof == 2 * 83718 - (16 * 9 + 22106 * 3 - 7)
    ends = found["pt"].value[[list(found["pt"].keys).index(k) for k in (3.0, 77.0)]]
    assert np.linalg.norm(ends[0] - ends[1]) == pytest.approx(1.5, abs=1e-9)
