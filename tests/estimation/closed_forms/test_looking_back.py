"""Boards before cameras that look along −z, as BAL's do: poses are found before them, not their mirror images."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm

FOCAL = 600.0
BOARD = np.array([(0.05 * i, 0.05 * j, 0.0) for j in range(4) for i in range(5)])
TURNS = ((0.3, -0.2, 0.1), (-0.4, 0.3, 0.5), (0.1, 0.5, -0.3), (-0.2, -0.4, 0.2))
PLACES = ((0.02, -0.1, -0.7), (-0.1, 0.05, -0.8), (0.0, 0.0, -0.9), (0.05, -0.05, -0.75))


def images() -> dict[str, np.ndarray]:
    """By the formula of BAL's page, −f x/z."""
    found: dict[str, list] = {name: [] for name in ("photo", "x", "y", "u", "v")}
    for number, (turn, place) in enumerate(zip(TURNS, PLACES, strict=True)):
        moved = BOARD @ Rotation.from_rotvec(turn).as_matrix().T + place
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
    board = np.array([(0.05 * i - 0.125, 0.05 * j - 0.1, 0.0) for j in range(5) for i in range(6)])
    found: dict[str, list] = {name: [] for name in ("photo", "x", "y", "u", "v")}
    for number in range(5):
        turn = Rotation.from_rotvec(0.4 * generator.normal(size=3)).as_matrix()
        moved = board @ turn.T + [0.0, 0.0, 0.6 + 0.1 * number]
        seen = FOCAL * moved[:, :2] / moved[:, 2:] * [1, -1] + centre  # y up
        seen += 0.1 * generator.normal(size=seen.shape)
        for name, values in zip(found, (np.full(len(board), number), *board[:, :2].T, *seen.T), strict=True):
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
