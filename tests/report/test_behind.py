"""Points behind a camera are rows that say so: against depths that NumPy computes."""

from __future__ import annotations

import json

import numpy as np
import pytest

import mbm

TEXT = """
(problem behind {keys}
  (data d external)
  (camera cam :focal 500 :center (320 240) {options})
  (unknowns (s :init {init}))
  (observe d (= [u v] (project cam {point})) :sigma 1px :loss (huber)))
"""


def scene(axes: str):
    """Points in front, behind, and in front again; s = 0.25 moves all of them along the axis of the camera."""
    points = np.array([[0.1, 0.2, 2], [0.3, -0.1, -1.5], [-0.2, 0.1, 3], [0.2, 0.2, -0.3], [0.4, 0.1, 1.0]])
    x, y, z = points.T
    z = z + 0.25
    ahead = {"x": points[:, 0], "y": points[:, 1], "z": points[:, 2]} if axes == "opencv" else {}
    if axes == "paper":
        # x forward, y left, z up: u = 500 y/x + 320, v = 500 z/x + 240
        ahead = {"x": points[:, 2], "y": points[:, 0], "z": points[:, 1]}
    u, v = 500 * x / z + 320, 500 * y / z + 240
    return {**ahead, "u": u, "v": v, "k": np.array([1.0, 2, 1, 1, 2])}, z


@pytest.mark.parametrize("axes", ["opencv", "paper"])
def test_rows_behind_are_named(axes: str) -> None:
    data, depths = scene(axes)
    point = "[x y (+ z s)]" if axes == "opencv" else "[(+ x s) y z]"
    solved = mbm.loads(TEXT.format(init=0.2, keys="", options=f":axes {axes}", point=point)).solve(data={"d": data})
    assert solved["s"].value == pytest.approx(0.25)
    (written,) = [solve["residuals"]["d"] for solve in solved.document()["solves"]]
    assert written["behind_camera"] == (np.flatnonzero(depths <= 0) + 1).tolist() == [2, 4]
    assert all(each["value"] is not None for each in written["rms_unit"])
    assert "; behind the camera: rows 2, 4" in str(solved)


def test_a_camera_along_minus_z_has_its_back_elsewhere() -> None:
    """With negative focal lengths points with z < 0 are in front, as in BAL's files."""
    data, depths = scene("opencv")
    flipped = {**data, "z": -data["z"]}
    text = TEXT.format(init=0.2, keys="", options="", point="[x y (- z s)]").replace(":focal 500", ":focal -500")
    solved = mbm.loads(text).solve(data={"d": flipped})
    assert solved["s"].value == pytest.approx(0.25)
    (written,) = [solve["residuals"]["d"] for solve in solved.document()["solves"]]
    assert written["behind_camera"] == (np.flatnonzero(depths <= 0) + 1).tolist()


def test_each_of_many_solves_names_its_own() -> None:
    data, depths = scene("opencv")
    text = TEXT.format(init=0.2, keys="(for-each k)", options="", point="[x y (+ z s)]")
    solved = mbm.loads(text).solve(data={"d": data})
    for number, solve in enumerate(solved.document()["solves"]):
        wanted = np.flatnonzero((depths <= 0) & (data["k"] == solve["key"]["k"])) + 1
        assert solve["residuals"]["d"].get("behind_camera", []) == wanted.tolist()
        report = solved.solves[number].record.raw_residuals()["d"]
        assert list(report.behind) == wanted.tolist()


@pytest.mark.parametrize("model", ["fisheye", "orthographic"])
def test_where_depth_does_not_turn_the_image_nothing_is_said(model: str) -> None:
    """A fisheye sees more than half of all directions, and to an orthographic camera depth is nothing."""
    data, _depths = scene("opencv")
    data["u"] = data["v"] = np.zeros(5)
    text = TEXT.format(init=0.2, keys="", options=f":model {model}", point="[x y (+ z s)]")
    solved = mbm.loads(text).solve(data={"d": data})
    assert "behind_camera" not in solved.document()["solves"][0]["residuals"]["d"]


def test_members_of_cameras_and_poses_are_picked_row_by_row() -> None:
    """In each solve of many the families have members of their own."""
    text = """
    (problem rig (for-each k)
      (data d external)
      (camera cam :focal 100)
      (unknowns (T (vector 3) :per d.photo :init [0 0 1]))
      (observe d (= [u v] (project cam (+ [x y z] (T photo)))) :sigma 1)
      (observe close d (= 0 ((T photo) 3)) :sigma 1e-3))"""
    generator = np.random.default_rng(1)
    k, photo = np.repeat([1.0, 2, 3], 12), np.tile(np.repeat([1.0, 2.0], 6), 3) + np.repeat([0.0, 1, 2], 12)
    points = generator.uniform([-1, -1, 2], [1, 1, 4], size=(36, 3))
    points[[3, 20]] *= -1
    uv = 100 * points[:, :2] / points[:, 2:]
    data = {"k": k, "photo": photo, **dict(zip(("x", "y", "z", "u", "v"), (*points.T, *uv.T), strict=True))}
    solved = mbm.loads(text).solve(data={"d": data})
    found = [solve["residuals"]["d"].get("behind_camera", []) for solve in solved.document()["solves"]]
    assert found == [[4], [21], []]


def test_a_point_in_the_plane_of_the_camera_is_no_number_and_said_so() -> None:
    """The start puts row 4 there: nothing is solved, and the row is named."""
    data, _ = scene("opencv")
    solved = mbm.loads(TEXT.format(init=0.3, keys="", options="", point="[x y (+ z s)]")).solve(data={"d": data})
    assert solved.first.status == "not-converged"
    (diagnostic,) = solved.first.diagnostics
    assert diagnostic.code.name == "not-finite-at-start"
    assert [label.place.row for label in diagnostic.labels] == [4]
    assert solved.first.record.raw_residuals()["d"].behind == (2, 4)
    json.dumps(solved.document(), allow_nan=False)


MIRRORED = """
(problem mirrored {keys}
  (data d external)
  (camera cam :focal (500 500) :center (320 240))
  (unknowns (T (pose 3){start}))
  (observe d (= [u v] (project cam (transform T [x y z]))) :sigma 1px))"""


@pytest.mark.parametrize("keys", ["", "(for-each k)"])
def test_an_answer_that_is_mostly_behind_the_camera_says_so(keys: str) -> None:
    """An image whose second coordinate grows upwards: the mirror image behind the camera fits, and is no answer."""
    generator = np.random.default_rng(2)
    points = generator.uniform(-0.5, 0.5, size=(24, 3))
    seen = points + np.array([0.1, 0.0, 3.0])
    uv = 500 * seen[:, :2] / seen[:, 2:] * [1, -1] + [320, 240] + generator.normal(size=(24, 2))
    data = dict(zip(("x", "y", "z", "u", "v"), (*points.T, *uv.T), strict=True)) | {"k": np.repeat([1.0, 2.0], 12)}
    start = " :init (pose3 (rot-y 180deg) [-0.1 0 -3])"
    solved = mbm.loads(MIRRORED.format(keys=keys, start=start)).solve(data={"d": data})
    for solve in solved.solves:
        assert solve.status == "converged"
        count = len(solve.record.raw_residuals()["d"].behind)
        (said,) = [each for each in solve.diagnostics if each.code.name == "behind-camera"]
        assert said.message.startswith(f"the points of {count} of {count} rows of `d` are behind the camera")
        assert count == 24 // len(solved.solves)
    upright = mbm.loads(MIRRORED.format(keys=keys, start="").replace("(500 500)", "(500 -500)")).solve(data={"d": data})
    assert not [each for solve in upright.solves for each in solve.diagnostics if each.code.name == "behind-camera"]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_of_equally_low_minima_the_one_before_the_camera_is_the_answer(seed: int) -> None:
    """A rotation and a place, begun at random: the mirror image behind the camera has the same cost."""
    generator = np.random.default_rng(seed)
    points = generator.uniform(-0.3, 0.3, size=(20, 3))
    seen = points + np.array([0.1, -0.05, 3.0])
    uv = np.array([800, 810]) * seen[:, :2] / seen[:, 2:] + [320, 240] + 0.3 * generator.normal(size=(20, 2))
    text = """(problem p (data d external) (camera cam :focal (fx fy) :center (cx cy))
      (unknowns (fx) (fy) (cx) (cy) (Q (rotation 3)) (t (vector 3)))
      (observe d (= [u v] (project cam (+ (rotate Q [x y z]) t))) :sigma 0.3))"""
    data = dict(zip(("x", "y", "z", "u", "v"), (*points.T, *uv.T), strict=True))
    solved = mbm.loads(text).solve(data={"d": data}, seed=0)
    assert solved.first.record.raw_residuals()["d"].behind == ()
    assert solved.first.cost < 30 + 5 * np.sqrt(2 * 30)  # χ² of as many degrees of freedom
    assert solved["fx"].value * solved["fy"].value > 0.0


CARRIED = """
(problem carried {head}
  (data d external)
  (camera cam :axes {axes} :focal (500 500) :center (0 0))
  {unknowns}
  (observe d (= [u v] (project cam (+ [x y 0] q))) :sigma 0.1))"""

STATES = """(states :over k (q (vector 3) {start} :sigma 1))
  (dynamics (= (next q) (+ q [0.02 0 0]) :sigma 0.01)) (solve :method METHOD)"""

KINDS = {
    "for-each": ("(for-each k)", "(unknowns (q (vector 3) {start}))"),
    "window": ("(window k :length 1 :step 1)", "(unknowns (q (vector 3) {start}))"),
    "states": ("", "(states :over k (q (vector 3) {start})) (dynamics (= (next q) (+ q [0.02 0 0]) :sigma 0.01))"),
    **{method: ("", STATES.replace("METHOD", method)) for method in ("iterated-ekf", "(smoother :lag 2)", "batch")},
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("axes", "ahead"), [("opencv", 1.5), ("opengl", -1.5)])
@pytest.mark.parametrize("front", [True, False])
def test_windows_and_states_say_so_too_and_only_behind(kind: str, axes: str, ahead: float, front: bool) -> None:
    """A square that slides; OpenGL's cameras look along −z, with v upwards. Behind, the same start has the other z."""
    k, square = np.repeat(np.arange(6.0), 4), np.tile([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]], (6, 1))
    depth = ahead if front else -ahead
    seen = 500 * (square + np.stack([0.02 * k, 0 * k], axis=1)) / (depth * np.sign(ahead))
    seen += np.random.default_rng(0).normal(scale=0.1, size=seen.shape)
    head, unknowns = KINDS[kind]
    text = CARRIED.format(head=head, axes=axes, unknowns=unknowns.format(start=f":init [0 0 {depth}]"))
    data = {"k": k, "x": square[:, 0], "y": square[:, 1], "u": seen[:, 0], "v": seen[:, 1]}
    solved = mbm.loads(text).solve(data={"d": data})
    assert len(solved.solves) == (6 if kind in ("for-each", "window") else 1)
    for solve in solved.solves:
        said = [each for each in solve.diagnostics if each.code.name == "behind-camera"]
        assert len(said) == (0 if front else 1)
