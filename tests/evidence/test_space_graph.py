"""What the information of pose graphs in space means: simulated graphs have the χ² of their degrees of freedom."""

from __future__ import annotations

import mbm
from tests.evidence.material import measured

NODES = (
    (0, 0, 0, 0, 0, 0, 0, 1),
    (1, 1.033099, 0.093536, -0.037961, 0.3171845, -0.2366641, 0.1427899, 0.9071908),
    (2, 1.864103, -0.068827, -0.22442, 0.399036, -0.1862907, -0.896765, 0.0433426),
    (3, 2.778843, 0.04302, -0.654026, -0.0946935, 0.8516455, -0.5040938, 0.1078076),
    (4, 3.740591, 0.018251, -1.258278, -0.2025126, 0.0306155, -0.5368945, 0.8184104),
    (5, 4.03322, 0.677269, -0.953695, 0.2648076, 0.3972635, 0.8786534, 0.0051805),
    (6, 3.213011, 0.899245, -0.372356, 0.6065701, -0.6659431, 0.4047869, 0.1572895),
    (7, 2.367769, 0.848256, -0.024307, 0.561184, -0.2302828, 0.722667, 0.3313529),
    (8, 1.754363, 0.73294, 0.550029, 0.7067708, -0.42748, 0.3028011, 0.4754444),
)
"""Number, place and quaternion (x y z w) of the nodes of tinyGrid3D, a simulated graph (SE-Sync, Rosen et al. 2019)."""
EDGES = (
    (0, 1, 1.033099, 0.093536, -0.037961, 0.3171845, -0.2366641, 0.1427899, 0.9071908),
    (1, 2, 0.589385, -0.55783, -0.305201, 0.1094217, -0.5001618, -0.8550748, 0.0819273),
    (2, 3, -0.344795, -0.326952, -0.898909, -0.9047572, -0.2290733, -0.2473674, 0.2602866),
    (3, 4, -0.862188, 0.468834, 0.572294, 0.4974765, -0.7449399, 0.1851044, 0.4041262),
    (4, 5, -0.41297, 0.367591, 0.554111, 0.0224185, -0.2892013, -0.8104386, 0.5089689),
    (5, 6, 1.02199, 0.090432, 0.085613, -0.7844494, -0.4917095, 0.281209, 0.2525518),
    (6, 7, 0.459972, 0.672496, -0.417547, 0.2753192, 0.3956294, -0.2544933, 0.8383972),
    (7, 8, 0.620421, 0.552512, -0.17098, -0.271817, -0.3729929, -0.1661162, 0.871434),
    (1, 8, -0.062404, 0.790626, -0.703394, 0.4615956, 0.1481179, 0.6142114, 0.6226836),
    (3, 6, -0.586019, 0.114638, -0.9829, -0.0650692, 0.0574151, -0.7311567, 0.6766678),
    (7, 2, -0.693071, 0.663893, -0.264779, -0.0751329, 0.7634717, 0.236516, 0.5962602),
)
"""From, to, place and quaternion of its relative poses; the standard deviations are 0.1 m and 0.2 rad."""
GRAPH = """
(problem grid
  (data nodes (g2o "{path}" :vertices))
  (data edges (g2o "{path}" :edges))
  (unknowns (T (pose 3) :per nodes :init (pose3 (quaternion qw qx qy qz) [x y z]) :fixed (= id 0)))
  (observe edges
    (= (pose3 (quaternion dqw dqx dqy dqz) [dx dy dz]) (between (T from) (T to)))
    :information information))
"""


def solved(path):
    found = mbm.loads(GRAPH.format(path=path.as_posix())).solve()
    assert found.status == "ok"
    return found.first


def test_information_is_that_of_the_rotation_vector(tmp_path):
    information = "100 0 0 0 0 0 100 0 0 0 0 100 0 0 0 25 0 0 25 0 25"
    lines = [f"VERTEX_SE3:QUAT {' '.join(map(str, node))}" for node in NODES]
    lines += [f"EDGE_SE3:QUAT {' '.join(map(str, edge))} {information}" for edge in EDGES]
    (tmp_path / "graph.g2o").write_text("\n".join(lines) + "\n")
    solve = solved(tmp_path / "graph.g2o")
    assert solve.dof == 6 * (len(EDGES) - len(NODES) + 1)
    # Taken as that of the quaternion's vector, half as long, half of χ² would count a quarter.
    assert 0.05 < solve.chi2_p < 0.95


def test_information_of_a_larger_graph():
    """Here the other reading would have p beyond 1 - 1e-9."""
    assert 0.05 < solved(measured("posegraph", "smallGrid3D.g2o")).chi2_p < 0.95
