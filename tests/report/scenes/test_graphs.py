"""Pose graphs, trajectories and points written for g2o, TUM, KITTI and PLY: read by other programs, and by ours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.text.types import MbmError

GRAPH = """
(problem graph
  (data places external :key id)
  (data steps external)
  (unknowns (T (pose {d}) :per places :init {init} :fixed (= id 0)))
  (observe steps (= {measured} {model}) :covariance {covariance})
  {more})
"""
SPACE = {
    "d": 3,
    "init": "(pose3 (quaternion qw qx qy qz) [x y z])",
    "measured": "(pose3 (quaternion qw qx qy qz) [x y z])",
    "covariance": "(@ L (transpose L))",
}
BETWEEN = "(between (T from) (T to))"


def poses(count: int, seed: int = 2) -> tuple[Rotation, np.ndarray]:
    generator = np.random.default_rng(seed)
    return Rotation.from_rotvec(generator.normal(scale=0.6, size=(count, 3))), generator.normal(size=(count, 3))


def columns(turns: Rotation, along: np.ndarray) -> dict[str, np.ndarray]:
    qx, qy, qz, qw = turns.as_quat().T
    return dict(zip(("x", "y", "z", "qw", "qx", "qy", "qz"), (*along.T, qw, qx, qy, qz), strict=True))


EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 2)]
NOISE = np.random.default_rng(8).normal(scale=0.02, size=(6, 6)) + 0.1 * np.eye(6)
"""L of the covariance L Lᵀ of the difference, rotation first."""


def space_graph(model: str = BETWEEN):
    """A solved graph, and its measured edges: those of the truth, moved by 1 cm and 0.01 rad."""
    turns, along = poses(4)
    i, j = np.array(EDGES).T
    generator = np.random.default_rng(4)
    measured = turns[i].inv() * turns[j] * Rotation.from_rotvec(generator.normal(scale=0.01, size=(5, 3)))
    moved = turns[i].inv().apply(along[j] - along[i]) + generator.normal(scale=0.01, size=(5, 3))
    rows = "[" + " ".join("[" + " ".join(repr(float(v)) for v in row) + "]" for row in NOISE) + "]"
    text = GRAPH.format(**{**SPACE, "covariance": f"(@ {rows} (transpose {rows}))"}, model=model, more="")
    tables = {
        "places": {"id": np.arange(4.0), **columns(turns, along)},
        "steps": {"from": i.astype(float), "to": j.astype(float), **columns(measured, moved)},
    }
    return mbm.loads(text).solve(data=tables), measured, moved


def matrices(result) -> np.ndarray:
    """The estimated poses (n, 4, 4)."""
    value = result["T"].value
    found = np.tile(np.eye(4), (len(value), 1, 1))
    found[:, :3, :3] = Rotation.from_quat(np.roll(value[:, :4], -1, axis=1)).as_matrix()
    found[:, :3, 3] = value[:, 4:]
    return found


@pytest.mark.parametrize("model", [BETWEEN, "(compose (inverse (T from)) (T to))"])
def test_gtsam_reads_vertices_and_edges(model: str, tmp_path: Path) -> None:
    """The edges are those that were measured, from each place to the next, whichever way the equation says it."""
    gtsam = pytest.importorskip("gtsam")
    result, measured, moved = space_graph(model)
    result.write("g2o", tmp_path)
    graph, values = gtsam.readG2o(str(tmp_path / "T.g2o"), True)
    for number, pose in enumerate(matrices(result)):
        np.testing.assert_allclose(values.atPose3(number).matrix(), pose, rtol=0, atol=1e-12)
    assert graph.size() == len(EDGES)
    for number, (first, second) in enumerate(EDGES):
        factor = graph.at(number)
        assert list(factor.keys()) == [first, second]
        np.testing.assert_allclose(factor.measured().rotation().matrix(), measured[number].as_matrix(), atol=1e-12)
        np.testing.assert_allclose(factor.measured().translation(), moved[number], atol=1e-12)
        # of the differences along the axes of the measured pose, rotation first, as GTSAM has them
        np.testing.assert_allclose(factor.noiseModel().covariance(), NOISE @ NOISE.T, rtol=1e-8, atol=1e-12)


def test_our_reader_solves_the_written_graph_to_the_same_end(tmp_path: Path) -> None:
    """Cost and estimates are the same: poses, edges and information are what they were."""
    result, _, _ = space_graph()
    result.write("g2o", tmp_path)
    again = mbm.loads(
        """
        (problem again
          (data places (g2o "T.g2o" :vertices)) (data steps (g2o "T.g2o" :edges))
          (unknowns (T (pose 3) :per places :init (pose3 (quaternion qw qx qy qz) [x y z]) :fixed (= fixed 1)))
          (observe steps (= (pose3 (quaternion dqw dqx dqy dqz) [dx dy dz]) (between (T from) (T to)))
            :information information))""",
        base=tmp_path,
    ).solve()
    # both are minima to 1e-10 of the standard deviations, and the files have all digits
    assert again.first.cost == pytest.approx(result.first.cost, rel=1e-8)
    np.testing.assert_allclose(matrices(again), matrices(result), rtol=0, atol=1e-9)
    assert again.first.dof == result.first.dof


def test_graphs_of_the_plane(tmp_path: Path) -> None:
    text = """
    (problem plane
      (data places (table (id x y a) (10 0 0 0) (20 1 0 0.1) (30 1 1 1.6)) :key id)
      (data steps (table (from to x y a) (10 20 1 0.1 0.1) (20 30 0.1 1 1.5) (10 30 1.05 1 1.62)))
      (unknowns (T (pose 2) :per places :init (pose2 x y a) :fixed (= id 10)))
      (observe steps (= (pose2 x y a) (between (T from) (T to))) :sigma [0.01 0.05 0.1]))"""
    result = mbm.loads(text).solve()
    result.write("g2o", tmp_path)
    lines = [line.split() for line in (tmp_path / "T.g2o").read_text().splitlines()]
    assert [line[:2] for line in lines[:4]] == [
        ["VERTEX_SE2", "10"],
        ["VERTEX_SE2", "20"],
        ["VERTEX_SE2", "30"],
        ["FIX", "10"],
    ]
    edge = [float(x) for x in lines[5][1:]]
    assert edge[:2] == [20.0, 30.0]
    np.testing.assert_allclose(edge[2:5], [0.1, 1, 1.5], atol=1e-12)
    np.testing.assert_allclose(edge[5:], [1 / 0.05**2, 0, 0, 1 / 0.1**2, 0, 1 / 0.01**2], rtol=1e-9, atol=1e-9)


TRACK = """
(problem track
  (data fixes external :key t)
  (unknowns (T (pose 3) :per fixes))
  (observe fixes (= (pose3 (quaternion qw qx qy qz) [x y z]) (T t)) :sigma 0.1))
"""


@pytest.mark.parametrize("form", ["tum", "kitti"])
def test_evo_reads_trajectories(form: str, tmp_path: Path) -> None:
    """Times in order, real part last: evo reads the poses that were observed."""
    tools = pytest.importorskip("evo.tools.file_interface")
    turns, along = poses(5)
    times = np.array([1.5, 0.5, 2.25, 3.0, 4.0])
    order = np.argsort(times)
    result = mbm.loads(TRACK).solve(data={"fixes": {"t": times, **columns(turns, along)}})
    result.write(form, tmp_path)
    if form == "tum":
        read = tools.read_tum_trajectory_file(str(tmp_path / "T.tum"))
        np.testing.assert_array_equal(read.timestamps, times[order])
        reader = '(tum "T.tum")'
    else:
        read = tools.read_kitti_poses_file(str(tmp_path / "T.txt"))
        reader = '(kitti "T.txt")'
    wanted = np.tile(np.eye(4), (5, 1, 1))
    wanted[:, :3, :3], wanted[:, :3, 3] = turns.as_matrix()[order], along[order]
    np.testing.assert_allclose(np.array(read.poses_se3), wanted, rtol=0, atol=1e-9)
    ours = mbm.loads(
        f"(problem p (data d {reader}) (unknowns (m (vector 3))) (observe d (= [x y z] m) :sigma 1))", base=tmp_path
    ).solve()
    np.testing.assert_allclose(ours["m"].value, along.mean(axis=0), rtol=0, atol=1e-9)


def test_a_pose_from_the_world_to_the_camera_is_turned_round(tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    from tests.report.scenes.simulated import rotation, solved, world

    made = world()
    for said in ("inward", "outward"):
        solved(said, made).write("kitti", tmp_path / said)
        found = np.loadtxt(tmp_path / said / "T.txt").reshape(-1, 3, 4)
        for row, (rvec, tvec) in zip(found, made.poses.values(), strict=True):
            np.testing.assert_allclose(row[:, :3], rotation(rvec).T, rtol=0, atol=1e-8)
            np.testing.assert_allclose(row[:, 3], -rotation(rvec).T @ tvec, rtol=0, atol=1e-8)


def test_times_are_wanted_as_keys(tmp_path: Path) -> None:
    turns, along = poses(2)
    tables = {"fixes": {"t": ["a", "b"], **columns(turns, along)}}
    result = mbm.loads(TRACK).solve(data=tables)
    with pytest.raises(MbmError, match="the format `tum` needs times as keys of `T`: its keys are texts"):
        result.write("tum", tmp_path / "out")
    result.write("kitti", tmp_path / "out")


def test_points_are_read_by_plyfile(tmp_path: Path) -> None:
    plyfile = pytest.importorskip("plyfile")
    points = np.random.default_rng(1).normal(size=(7, 3))
    text = (
        "(problem p (data d external :key k) (unknowns (X (vector 3) :per d)) (observe d (= [x y z] (X k)) :sigma 1mm))"
    )
    tables = {"d": {"k": np.arange(7.0), **dict(zip("xyz", points.T, strict=True))}}
    mbm.loads(text).solve(data=tables).write("ply", tmp_path)
    vertices = plyfile.PlyData.read(str(tmp_path / "X.ply"))["vertex"]
    np.testing.assert_allclose(np.column_stack([vertices[axis] for axis in "xyz"]), points, rtol=0, atol=1e-12)


def test_keys_never_lead_out_of_the_folder(tmp_path: Path) -> None:
    """Keys are data: what they hold becomes part of a name, or of a field, and nothing else."""
    hostile = ["../../evil", "a b\nc", "x" * 400, ".", "Ä/ß", "ä/ß"]
    text = """
    (problem p (data d external :key k) (data seen external :with (d k))
      (camera cam :per d :focal (f k) :center (1 2))
      (unknowns (f :per d :init 90) (T (pose 3) :per d :init (pose3 (identity 3) [0 0 0])))
      (observe seen (= [u v] (project (cam k) (transform (T k) [x y z]))) :sigma 1px))"""
    points = np.random.default_rng(3).uniform([-1, -1, 2], [1, 1, 4], size=(8, 3))
    rows = [(key, *point, *(100 * point[:2] / point[2] + [1, 2])) for key in hostile for point in points]
    seen = {name: [row[i] for row in rows] for i, name in enumerate(("k", "x", "y", "z", "u", "v"))}
    result = mbm.loads(text).solve(data={"d": {"k": hostile}, "seen": seen})
    for form in ("opencv-yaml", "colmap", "bundler"):
        result.write(form, tmp_path / "out" / form)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    files = [path.name for path in (tmp_path / "out" / "opencv-yaml").iterdir() if path.suffix == ".yml"]
    assert len({name.casefold() for name in files}) == len(hostile)
    assert all(len(name.encode()) < 255 and "/" not in name for name in files)
    images = (tmp_path / "out" / "colmap" / "images.txt").read_text(encoding="utf-8").splitlines()[2::2]
    assert len(images) == len(hostile)
    assert all(len(line.split(" ")) == 10 for line in images)
