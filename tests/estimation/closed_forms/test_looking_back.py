"""Boards before cameras that look along −z, as BAL's do: poses are found before them, not their mirror images."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from tests.estimation.closed_forms.rigs import Camera, board, composed, held, numbers, photographed, turn

FOCAL = 600.0
BOARD = np.array([(0.05 * i, 0.05 * j, 0.0) for j in range(4) for i in range(5)])
TURNS = ((0.3, -0.2, 0.1), (-0.4, 0.3, 0.5), (0.1, 0.5, -0.3), (-0.2, -0.4, 0.2))
PLACES = ((0.02, -0.1, -0.7), (-0.1, 0.05, -0.8), (0.0, 0.0, -0.9), (0.05, -0.05, -0.75))


def images() -> dict[str, np.ndarray]:
    """By the formula of BAL's page, −f x/z."""
    found: dict[str, list] = {name: [] for name in ("photo", "x", "y", "u", "v")}
    for number, (vector, place) in enumerate(zip(TURNS, PLACES, strict=True)):
        moved = BOARD @ Rotation.from_rotvec(vector).as_matrix().T + place
        seen = -FOCAL * moved[:, :2] / moved[:, 2:]
        for name, values in zip(found, (np.full(len(BOARD), number), *BOARD[:, :2].T, *seen.T), strict=True):
            found[name].extend(values.tolist())
    return {name: np.array(values) for name, values in found.items()}


@pytest.mark.parametrize(
    ("camera", "unknown"),
    [
        (":axes opengl :focal (600 600)", ""),
        (":axes opengl :focal (f f)", "(f)"),
        (":focal (-600 -600)", ""),
        (":focal ((- f) (- f))", "(f)"),
        (":focal (f f)", "(f :in (-3000 -100))"),
        (":focal (f f)", "(f :init -500)"),
    ],
)
def test_a_board_before_a_camera_that_looks_along_minus_z(camera, unknown):
    """Known and unknown focal lengths: pose from points, and Zhang's calibration."""
    solved = mbm.loads(f"""(problem p (data d external) (camera cam {camera})
      (unknowns {unknown} (T (pose 3) :per d.photo))
      (observe d (= [u v] (project cam (transform (T photo) [x y 0]))) :sigma 0.1)
      (derive (ends (transform (T 1) [0.2 0.15 0]))))""").solve(data={"d": images()})
    assert solved.status == "ok"
    expected = Rotation.from_rotvec(TURNS[1]).apply([0.2, 0.15, 0.0]) + PLACES[1]
    np.testing.assert_allclose(solved["ends"].value, expected, atol=1e-7)  # without noise


def turned_boards(seed: int, centre: np.ndarray) -> dict[str, np.ndarray]:
    """Five images of a board that is turned by some 0.4 rad about its middle, 0.6 to 1 before the camera."""
    generator = np.random.default_rng(seed)
    points = np.array([(0.05 * i - 0.125, 0.05 * j - 0.1, 0.0) for j in range(5) for i in range(6)])
    found: dict[str, list] = {name: [] for name in ("photo", "x", "y", "u", "v")}
    for number in range(5):
        turned = Rotation.from_rotvec(0.4 * generator.normal(size=3)).as_matrix()
        moved = points @ turned.T + [0.0, 0.0, 0.6 + 0.1 * number]
        seen = FOCAL * moved[:, :2] / moved[:, 2:] * [1, -1] + centre  # y up
        seen += 0.1 * generator.normal(size=seen.shape)
        for name, values in zip(found, (np.full(len(points), number), *points[:, :2].T, *seen.T), strict=True):
            found[name].extend(values.tolist())
    return {name: np.array(values) for name, values in found.items()}


@pytest.mark.parametrize(
    ("camera", "limits", "focal"),
    [
        (":axes opengl :focal (fx fy)", "", FOCAL),
        (":focal ((- fx) (- fy))", "", FOCAL),
        (":focal (fx fy)", ":in (-3000 -100)", -FOCAL),
        (":axes opengl :focal ((- fx) (- fy))", ":in (-3000 -100)", -FOCAL),
    ],
)
@pytest.mark.parametrize("seed", range(4))
def test_the_centre_of_such_a_camera_is_found(camera, limits, focal, seed):
    """Begun at the centre's negative, some of such calibrations ended at another minimum, a thousand times as high."""
    solved = mbm.loads(f"""(problem p (data d external) (camera cam {camera} :center (cx cy))
      (unknowns (fx {limits}) (fy {limits}) (cx) (cy) (T (pose 3) :per d.photo))
      (observe d (= [u v] (project cam (transform (T photo) [x y 0]))) :sigma 0.1)
      (derive (depth (- (dot [0 0 1] (transform (T 0) [0 0 0])))))
      )""").solve(data={"d": turned_boards(seed, np.array([320.0, -240.0]))})
    assert solved.solves[0].cost < 300 - 34 + 5 * np.sqrt(2 * 266)  # χ² of as many degrees of freedom
    assert float(solved["depth"].value) > 0.3  # of 0.6 ± the board's half
    for name, value in (("fx", focal), ("fy", focal), ("cx", 320.0), ("cy", -240.0)):
        assert abs(float(solved[name].value) - value) < 5 * float(solved[name].sigma)


CONVENTIONS = {
    "opencv": (np.eye(3), (1.0, 1.0)),
    "opengl": (np.diag([1.0, -1.0, -1.0]), (1.0, -1.0)),
    "paper": (np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), (-1.0, -1.0)),
}
"""How each turns a camera with z forward and y down, and the signs of its image then."""

PAIR = """(problem pair (data photos external :key photo) (data left external) (data right external)
  (camera l {l} :center {cl}) (camera r {r} :center {cr})
  (unknowns (B (pose 3)) (T (pose 3) :per photos) {more})
  (observe left (= [u v] (project l (transform (T photo) [x y z]))) :sigma 0.2)
  (observe right (= [u v] (project r (transform (compose B (T photo)) [x y z]))) :sigma 0.2))"""


def pair(left: str, right: str, bend: float = 0.0) -> tuple[dict, list, list]:
    """Images by two cameras of two conventions, without noise; the second one's pose, and the centres.

    The board is plane, or with ``bend`` curved.
    """
    generator = np.random.default_rng(4)
    cameras, side = [Camera(), Camera(focal=(700.0, 705.0))], (turn([0.02, 0.15, 0.01]), np.array([-0.12, 0.003, 0.01]))
    points = board() + bend * np.sin(20 * board()[:, [1, 2, 0]])
    boards = held(generator, 5)
    tables = photographed(cameras, [(np.eye(3), np.zeros(3)), side], boards, [range(5)] * 2, 0.0, generator, points)
    data = {"photos": {"photo": np.arange(5.0)}} | {
        name: table.columns() for name, table in zip(("left", "right"), tables, strict=True)
    }
    (first, down), (second, up) = CONVENTIONS[left], CONVENTIONS[right]
    for name, signs in (("left", down), ("right", up)):
        data[name] |= {"u": signs[0] * data[name]["u"], "v": signs[1] * data[name]["v"]}
    expected = composed((second, np.zeros(3)), side, (first.T, np.zeros(3)))
    centres = [f"({320 * s[0]} {240 * s[1]})" for s in (down, up)]
    return data, numbers(expected), centres


@pytest.mark.parametrize("bend", [0.0, 0.03])
@pytest.mark.parametrize(
    ("left", "right"), [("opencv", "opengl"), ("opengl", "opencv"), ("paper", "opengl"), ("opengl", "opengl")]
)
def test_known_cameras_of_two_conventions(left, right, bend):
    """A second camera that looks along −z ended at χ² of a million."""
    data, expected, (cl, cr) = pair(left, right, bend)
    cameras = {"l": f":axes {left} :focal (800 810)", "r": f":axes {right} :focal (700 705)", "cl": cl, "cr": cr}
    solved = mbm.loads(PAIR.format(more="", **cameras)).solve(data=data)
    assert solved.first.cost < 1e-6
    np.testing.assert_allclose(solved["B"].value, expected, atol=1e-6)


def test_focal_lengths_in_a_column_say_where_a_camera_looks():
    data, expected, (cl, cr) = pair("opencv", "opengl")
    data["cams"] = {"cam": np.array([1.0]), "f": np.array([-700.0]), "g": np.array([-705.0])}
    text = PAIR.replace("(camera r", "(data cams external :key cam) (camera r :per cams").replace(
        "project r", "project (r 1)"
    )
    solved = mbm.loads(text.format(more="", l=":focal (800 810)", r=":focal (f g)", cl=cl, cr=cr)).solve(data=data)
    assert solved.first.cost < 1e-6
    np.testing.assert_allclose(solved["B"].value, expected, atol=1e-6)


@pytest.mark.parametrize(("left", "right"), [("opencv", "opengl"), ("paper", "opencv")])
def test_targets_in_space_tell_cameras(left, right):
    """Points that lie in no plane: unknown cameras of both conventions, and where the second one is."""
    data, expected, _ = pair(left, right, 0.03)
    cameras = {
        "l": f":axes {left} :focal (fx fy)",
        "r": f":axes {right} :focal (gx gy)",
        "cl": "(cx cy)",
        "cr": "(dx dy)",
    }
    solved = mbm.loads(PAIR.format(more="(fx) (fy) (cx) (cy) (gx) (gy) (dx) (dy)", **cameras)).solve(data=data)
    got = [solved[name].value for name in ("fx", "fy", "gx", "gy")]
    np.testing.assert_allclose(got, [800.0, 810.0, 700.0, 705.0], rtol=1e-6)  # without noise
    np.testing.assert_allclose(solved["B"].value, expected, atol=1e-6)
