"""Files of several tables: bundles (BAL) and pose graphs (g2o, TORO)."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbm.data.loader import load_all
from mbm.data.readers import READERS, g2o
from mbm.data.readers.spanning import placed

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
    np.testing.assert_allclose(matrix(edges), turned(PLANE_INFORMATION, plane_turn(0.4)), rtol=1e-14)


def turned(information, rotation):
    """Files weigh t − t_m, mbm R_mᵀ(t − t_m): the same χ² where the information is that along the turned axes."""
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
    np.testing.assert_allclose(matrix(edges), turned(PLANE_INFORMATION, plane_turn(0.4)), rtol=1e-14)


def test_information_of_space_has_the_rotation_first(tmp_path):
    upper = [10 * i + j for i in range(1, 7) for j in range(i, 7)]
    text = f"EDGE_SE3:QUAT 0 1 1 2 3 0 0 0.6 0.8 {' '.join(map(str, upper))}\n"
    edges = READERS["g2o"].read(written(tmp_path, "d.g2o", text))["edges"]
    whole = np.array([[10 * min(i, j) + max(i, j) for j in range(1, 7)] for i in range(1, 7)])
    order = [3, 4, 5, 0, 1, 2]
    rotation = Rotation.from_quat([0, 0, 0.6, 0.8]).as_matrix()
    np.testing.assert_allclose(matrix(edges), turned(whole[np.ix_(order, order)], rotation), rtol=1e-13)
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


def composed(poses, edges):
    """Relative poses of edges in the plane, from the poses."""
    result = []
    for a, b in edges:
        (x, y, t), (u, v, s) = poses[a], poses[b]
        cos, sin = np.cos(t), np.sin(t)
        result.append((cos * (u - x) + sin * (v - y), -sin * (u - x) + cos * (v - y), s - t))
    return np.array(result)


def test_vertices_are_placed_along_the_edges_of_a_plane_graph():
    random = np.random.default_rng(5)
    poses = np.column_stack([random.normal(0, 5, (12, 2)), random.uniform(-3, 3, 12)])
    poses[0] = 0
    ends = [(0, 1), (2, 1), (2, 3), (1, 4), *((i, i + 1) for i in range(4, 11))]
    ids, found = placed(np.array(ends, dtype=float), composed(poses, ends))
    wanted = poses[ids.astype(int)]
    np.testing.assert_allclose(found[:, :2], wanted[:, :2], atol=1e-12)  # a dozen products of numbers near 10
    np.testing.assert_allclose(np.exp(1j * found[:, 2]), np.exp(1j * wanted[:, 2]), atol=1e-13)


def test_vertices_are_placed_along_the_edges_of_a_graph_in_space():
    turns = Rotation.random(8, random_state=1)
    places = np.random.default_rng(2).normal(0, 5, (8, 3))
    ends = [(0, 1), (2, 1), (1, 3), (4, 3), (4, 5), (6, 5), (6, 7)]
    measured = []
    for a, b in ends:
        back = turns[a].inv()
        measured.append([*back.apply(places[b] - places[a]), *(back * turns[b]).as_quat()])
    ids, found = placed(np.array(ends, dtype=float), np.array(measured))
    order = ids.astype(int)
    back = turns[0].inv()
    np.testing.assert_allclose(found[:, :3], back.apply(places[order] - places[0]), atol=1e-12)
    differences = (back * turns[order]).inv() * Rotation.from_quat(found[:, 3:])
    assert differences.magnitude().max() < 1e-12  # a few products of quaternions


def test_parts_without_an_edge_between_them_have_an_origin_each():
    ends = np.array([[0, 1], [5, 6]], dtype=float)
    ids, found = placed(ends, np.array([[1.0, 0, 0], [0, 2.0, 0]]))
    assert ids.tolist() == [0, 1, 5, 6]
    np.testing.assert_array_equal(found, [[0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 2, 0]])


def test_what_a_graph_does_not_hold_is_said_when_it_is_asked_for(tmp_path):
    path = written(tmp_path, "d.g2o", "VERTEX_SE2 0 0 0 0\n")
    assert len(READERS["g2o"].part("vertices").read(path).file_rows) == 1
    with pytest.raises(Exception, match="holds no edges"):
        READERS["g2o"].part("edges").read(path)


def test_lines_of_other_programs_are_passed_over(tmp_path):
    text = "PARAMS_SE2OFFSET 0 0 0 0\nEQUIV 1 0\n" + PLANE
    assert len(g2o.read(written(tmp_path, "d.g2o", text))["edges"].file_rows) == 1
