"""Files of several tables: bundles (BAL) and pose graphs (g2o, TORO)."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import mbm
from mbm.data.loader import load_all
from mbm.data.readers import READERS, g2o
from mbm.text.types import MbmError

BUNDLE = """2 1 2
0 0 1.5 -2.5
1 0 3 4
1 2 3 4 5 6 7 8 9
10
11 12 13 14 15 16 17 18
0.5 0.25
-1e-3
"""


def written(folder, name, text):
    path = folder / name
    path.write_text(text)
    return path


def columns(table):
    return {column.name: column.numbers.tolist() for column in table.columns}


def test_a_bundle_holds_cameras_points_and_observations(tmp_path):
    found = READERS["bal"].read(written(tmp_path, "d.txt", BUNDLE))
    assert columns(found["observations"]) == {"camera": [0, 1], "point": [0, 0], "u": [1.5, 3], "v": [-2.5, 4]}
    cameras = columns(found["cameras"])
    assert list(cameras) == ["camera", "r1", "r2", "r3", "t1", "t2", "t3", "f", "k1", "k2"]
    assert (cameras["camera"], cameras["r1"], cameras["k2"]) == ([0, 1], [1, 10], [9, 18])
    assert columns(found["points"]) == {"point": [0], "x": [0.5], "y": [0.25], "z": [-1e-3]}
    assert [found[part].key for part in ("cameras", "points", "observations")] == ["camera", "point", None]
    assert [found[part].file_rows.tolist() for part in ("observations", "cameras", "points")] == [[2, 3], [4, 5], [7]]


def test_the_tables_of_one_file_are_read_together(tmp_path, declare):
    reads = []
    bal = READERS["bal"]

    def counted(path):
        reads.append(path)
        return bal.read(path)

    readers = {"bal": type(bal)(name="bal", extensions=(), parts=bal.parts, read=counted)}
    written(tmp_path, "d.txt", BUNDLE)
    clauses = [declare("bal", "d.txt", name=part, part=part) for part in bal.parts]
    tables = load_all(clauses, base=tmp_path, given={}, paths={}, sandbox=None, readers=readers)
    assert [len(table) for table in tables.values()] == [2, 1, 2]
    assert tables["cameras"].key == "camera"
    assert len(reads) == 1


PLANE = """# a square
VERTEX_SE2 0 0 0 0
VERTEX_SE2 7 1 2 0.5
FIX 7
EDGE_SE2 0 7 1.1 2.1 0.4 11 12 13 22 23 33
"""


def matrix(table, row=0):
    group = table.groups["information"]
    cells = columns(table)
    return np.array([cells[name][row] for name in group.columns]).reshape(group.shape)


def test_information_of_the_plane_has_the_rotation_first(tmp_path):
    found = READERS["g2o"].read(written(tmp_path, "d.g2o", PLANE))
    vertices, edges = found["vertices"], found["edges"]
    assert columns(vertices) == {"id": [0, 7], "x": [0, 1], "y": [0, 2], "theta": [0, 0.5], "fixed": [0, 1]}
    assert vertices.key == "id"
    assert vertices.file_rows.tolist() == [2, 3]
    cells = columns(edges)
    assert [cells[n] for n in ("from", "to", "dx", "dy", "dtheta")] == [[0], [7], [1.1], [2.1], [0.4]]
    np.testing.assert_array_equal(matrix(edges), PLANE_INFORMATION)
    told = READERS["g2o"].told(edges, {"information": "from"})
    np.testing.assert_allclose(matrix(told), turned(PLANE_INFORMATION, plane_turn(0.4)), rtol=1e-14)


def turned(information, rotation):
    """Some weigh t − t_m, mbm R_mᵀ(t − t_m): the same χ² where the information is that along the turned axes."""
    size, first = len(information), len(information) - len(rotation)
    whole = np.eye(size)
    whole[first:, first:] = rotation
    return whole.T @ information @ whole


def plane_turn(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


PLANE_INFORMATION = np.array([[33.0, 13, 23], [13, 11, 12], [23, 12, 22]])
"""That of the file with rows and columns in mbm's order: rotation, x, y."""


def test_toro_orders_the_information_otherwise(tmp_path):
    text = "EDGE2 1 0 1.1 2.1 0.4 11 12 22 33 13 23\n"  # forward, sideward, rotation: ff fs ss rr fr sr
    edges = READERS["g2o"].read(written(tmp_path, "d.graph", text))["edges"]
    np.testing.assert_array_equal(matrix(edges), PLANE_INFORMATION)
    told = READERS["g2o"].told(edges, {"information": "from"})
    np.testing.assert_allclose(matrix(told), turned(PLANE_INFORMATION, plane_turn(0.4)), rtol=1e-14)


def test_information_of_space_has_the_rotation_first(tmp_path):
    upper = [10 * i + j for i in range(1, 7) for j in range(i, 7)]
    text = f"EDGE_SE3:QUAT 0 1 1 2 3 0 0 0.6 0.8 {' '.join(map(str, upper))}\n"
    edges = READERS["g2o"].read(written(tmp_path, "d.g2o", text))["edges"]
    whole = np.array([[10 * min(i, j) + max(i, j) for j in range(1, 7)] for i in range(1, 7)])
    order = [3, 4, 5, 0, 1, 2]
    rotation = Rotation.from_quat([0, 0, 0.6, 0.8]).as_matrix()
    np.testing.assert_array_equal(matrix(edges), whole[np.ix_(order, order)])
    told = READERS["g2o"].told(edges, {"information": "from"})
    np.testing.assert_allclose(matrix(told), turned(whole[np.ix_(order, order)], rotation), rtol=1e-13)
    cells = columns(edges)
    assert [cells[n][0] for n in ("dx", "dy", "dz", "dqx", "dqy", "dqz", "dqw")] == [1, 2, 3, 0, 0, 0.6, 0.8]


def test_eulers_angles_become_quaternions(tmp_path):
    roll, pitch, yaw = 0.3, -0.2, 1.4
    identity = " ".join("1" if i == j else "0" for i in range(6) for j in range(i, 6))
    text = f"VERTEX3 0 1 2 3 {roll} {pitch} {yaw}\nEDGE3 0 1 1 2 3 {roll} {pitch} {yaw} {identity}\n"
    found = READERS["g2o"].read(written(tmp_path, "d.txt", text))
    expected = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat()
    vertices, edges = columns(found["vertices"]), columns(found["edges"])
    np.testing.assert_allclose([vertices[n][0] for n in ("qx", "qy", "qz", "qw")], expected, atol=1e-15)
    np.testing.assert_allclose([edges[n][0] for n in ("dqx", "dqy", "dqz", "dqw")], expected, atol=1e-15)


def test_vertices_of_a_file_of_edges_are_their_ids(tmp_path):
    """In ascending order, with what `FIX` says, and without numbers: no pose is known, and `:init` of these is none."""
    text = "EDGE_SE2 7 3 1 0 0 1 0 0 1 0 1\nEDGE_SE2 3 5 1 0 0 1 0 0 1 0 1\nFIX 5\n"
    vertices = READERS["g2o"].read(written(tmp_path, "d.g2o", text))["vertices"]
    found = columns(vertices)
    assert (found["id"], found["fixed"], vertices.key) == ([3, 5, 7], [0, 1, 0], "id")
    assert np.isnan([found[name] for name in ("x", "y", "theta")]).all()
    init = ":init (pose2 x y theta)"
    for stated, fixed in ((init, "(= fixed 1)"), ("", "(= fixed 1)"), (init, "(= fixed 1) :at (pose2)")):
        change = f"(T (pose 2) :per nodes {stated} :fixed {fixed})"
        text = GRAPH.format(option="").replace("(T (pose 2) :per nodes :fixed (= row 1))", change)
        solve = mbm.loads(text, base=tmp_path).solve()
        np.testing.assert_allclose(solve["T"].value[:, 1:], [[-1, 0], [0, 0], [-2, 0]], atol=1e-12)


GRAPH = """
(problem graph
  (data nodes (g2o "d.g2o" :vertices))
  (data edges (g2o "d.g2o" :edges{option}))
  (unknowns (T (pose 2) :per nodes :fixed (= row 1)))
  (observe edges (= (pose2 dx dy dtheta) (between (T from) (T to))) :information information))
"""
LOOP = """EDGE_SE2 0 1 1.02 0.01 1.57 100 3 0 900 5 400
EDGE_SE2 1 2 0.99 -0.02 1.58 100 3 0 900 5 400
EDGE_SE2 2 0 1.01 1.03 3.0 100 3 0 900 5 400
"""


def test_information_is_that_of_the_measured_frame(tmp_path):
    """χ² as g2o's ``EdgeSE2::computeError`` has it, ``(Z⁻¹ X_i⁻¹ X_j)`` as x, y, θ, minimised by SciPy."""
    written(tmp_path, "d.g2o", LOOP)
    found = mbm.loads(GRAPH.format(option=""), base=tmp_path).solve().first
    assert found.cost == mbm.loads(GRAPH.format(option=" :information measured"), base=tmp_path).solve().first.cost
    root = np.linalg.cholesky(np.array([[100.0, 3, 0], [3, 900, 5], [0, 5, 400]])).T
    edges = [[float(word) for word in line.split()[1:6]] for line in LOOP.splitlines()]

    def placed(x, y, angle):
        return np.block([[plane_turn(angle), np.array([[x], [y]])], [np.zeros((1, 2)), 1]])

    def residuals(numbers):
        poses = [np.eye(3), placed(*numbers[:3]), placed(*numbers[3:])]
        found = []
        for first, second, *measured in edges:
            left = np.linalg.inv(poses[int(first)] @ placed(*measured)) @ poses[int(second)]
            found.append(root @ [left[0, 2], left[1, 2], np.arctan2(left[1, 0], left[0, 0])])
        return np.concatenate(found)

    best = least_squares(residuals, [1, 0, 1.57, 1, 1, 3.1], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert found.cost == pytest.approx(2 * best.cost, rel=1e-9)  # a minimum is flat: derivatives to 1e-8 by SciPy
    turned_one = mbm.loads(GRAPH.format(option=" :information from"), base=tmp_path).solve().first.cost
    assert abs(turned_one - found.cost) > 1e-3 * found.cost


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (":vertices :information from", "`:information` is not an option"),
        (":edges :information to", "this should be `measured` or `from`"),
        (":edges :information", "has no value behind it"),
        (":edges :edges", "`:edges` is not an option"),
        (":edges :information from 1", "takes a path"),
    ],
)
def test_what_a_graph_may_be_told_is_checked(tmp_path, source, said):
    written(tmp_path, "d.g2o", LOOP)
    with pytest.raises(MbmError, match=said):
        mbm.loads(f'(problem p (data d (g2o "d.g2o" {source})))', base=tmp_path).solve()


def test_what_a_graph_does_not_hold_is_said_when_it_is_asked_for(tmp_path):
    path = written(tmp_path, "d.g2o", "VERTEX_SE2 0 0 0 0\n")
    assert len(READERS["g2o"].part("vertices").read(path).file_rows) == 1
    with pytest.raises(Exception, match="holds no edges"):
        READERS["g2o"].part("edges").read(path)


def test_lines_of_other_programs_are_passed_over(tmp_path):
    text = "PARAMS_SE2OFFSET 0 0 0 0\nEQUIV 1 0\n" + PLANE
    assert len(g2o.read(written(tmp_path, "d.g2o", text))["edges"].file_rows) == 1
