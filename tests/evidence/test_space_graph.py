"""What the information of pose graphs in space means: simulated graphs have the χ² of their degrees of freedom."""

from __future__ import annotations

import pytest

import mbm
from tests.evidence.material import shared

GRAPH = """
(problem grid
  (data nodes (g2o "{path}" :vertices))
  (data edges (g2o "{path}" :edges))
  (unknowns (T (pose 3) :per nodes :init (pose3 (quaternion qw qx qy qz) [x y z]) :fixed (= id 0)))
  (observe edges
    (= (pose3 (quaternion dqw dqx dqy dqz) [dx dy dz]) (between (T from) (T to)))
    :information information))
"""


@pytest.mark.parametrize("name", ["tinyGrid3D", "smallGrid3D"])
def test_information_is_that_of_the_rotation_vector(name):
    path = shared("data", "posegraph", f"{name}.g2o").as_posix()
    solved = mbm.loads(GRAPH.format(path=path)).solve()
    assert solved.status == "ok"
    # Taken as that of the quaternion's vector, half as long, half of χ² would count a quarter: p beyond 1 − 1e-9.
    assert 0.05 < solved.first.chi2_p < 0.95
