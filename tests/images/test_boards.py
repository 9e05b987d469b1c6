"""Circles, chessboards with markers, grids of markers, in photographs that were rendered here; the points are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.data.images import features
from mbm.data.readers import READERS
from mbm.text.types import MbmError
from tests.images import patterns, rendering
from tests.images.rendering import CAMERA, SQUARE, middle_of, noisy, projected, rendered, save

SMALL = "DICT_4X4_50"
TAGS = "DICT_APRILTAG_36h11"
FLIPPED = Rotation.from_euler("x", np.pi)
TURNS = [Rotation.from_euler("xyz", angles) for angles in ([0.1, 0.15, 0.1], [0.6, 0.1, -0.3], [-0.2, 0.5, 0.9])]


def grid(columns, rows):
    return np.array([(i, j) for j in range(rows) for i in range(columns)], dtype=float)


def shifted(columns, rows):
    return np.array([(2 * i + j % 2, j) for j in range(rows) for i in range(columns)], dtype=float)


def of_markers(columns, rows, gap):
    corners = np.array([(0, 0), (1, 0), (0, 1), (1, 1)])
    return ((1 + gap) * grid(columns, rows)[:, None] + corners).reshape(-1, 2)


SIZES = {"size": SQUARE, "gap": 0.4 * SQUARE, "first": 3, "border": 1, "dictionary": SMALL}
CASES = {
    "circles": (
        "circles",
        patterns.circles(grid(6, 4), 0.27),
        {"columns": 6, "rows": 4, "spacing": SQUARE, "asymmetric": "false"},
        grid(6, 4),
        0.33,
    ),
    "bright circles": (
        "circles",
        patterns.circles(grid(5, 4), 0.3, bright=True),
        {"columns": 5, "rows": 4, "spacing": SQUARE, "asymmetric": "false"},
        grid(5, 4),
        0.33,
    ),
    "asymmetric circles": (
        "circles",
        patterns.circles(shifted(3, 7), 0.45),
        {"columns": 3, "rows": 7, "spacing": SQUARE, "asymmetric": "true"},
        shifted(3, 7),
        0.42,
    ),
    "charuco": (
        "charuco",
        patterns.charuco(5, 4, 0.7, SMALL),
        {
            "columns": 5,
            "rows": 4,
            "square": SQUARE,
            "marker": 0.7 * SQUARE,
            "dictionary": SMALL,
            "legacy": "false",
        },
        grid(4, 3) + 1,
        0.26,
    ),
    "aruco": (
        "aruco",
        patterns.markers(3, 2, 0.4, SMALL, first=3),
        {"columns": 3, "rows": 2, **SIZES},
        of_markers(3, 2, 0.4),
        0.26,
    ),
    "apriltag": (
        "apriltag",
        patterns.markers(3, 2, 0.4, TAGS, border=2, upward=True, joined=True),
        {"columns": 3, "rows": 2, **SIZES, "first": 0, "border": 2, "dictionary": TAGS},
        of_markers(3, 2, 0.4),
        0.26,
    ),
}
"""By what is tested: the format, the board, the arguments, the places in units, the distance of the camera in m."""


def read(name, arguments, *paths):
    return READERS[name].read({path.stem: path for path in paths}, "board*.png", arguments)


def numbers(table, *names):
    columns = {column.name: column.numbers for column in table.columns}
    return np.column_stack([columns[name] for name in names])


def pose_of(case, turn):
    """Where the middle of the board is straight ahead; boards whose y points up are turned towards the camera."""
    _, _, _, places, distance = CASES[case]
    turn = turn * FLIPPED if case == "apriltag" else turn
    flat = np.column_stack([places, np.zeros(len(places))]) * SQUARE
    return turn, middle_of(flat, turn, distance)


@pytest.fixture(scope="module")
def clean():
    """The images without noise, by the board and the number of the pose."""
    return {(case, k): rendered(CASES[case][1], *pose_of(case, turn)) for case in CASES for k, turn in enumerate(TURNS)}


def written(path, image, seed=1, noise=2):
    save(path, noisy(image, np.random.default_rng(seed), noise))
    return path


def chi_squares(table, truth):
    error = numbers(table, "u", "v") - truth
    c = numbers(table, "covariance11", "covariance12", "covariance22")
    covariance = np.moveaxis(np.array([[c[:, 0], c[:, 1]], [c[:, 1], c[:, 2]]]), -1, 0)
    return np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)


@pytest.mark.parametrize("case", CASES)
def test_points_are_found_and_errors_are_as_large_as_is_stated(case, clean, tmp_path):
    name, _, arguments, places, _ = CASES[case]
    sums = []
    for k, turn in enumerate(TURNS):
        for seed in range(8):
            table = read(name, arguments, written(tmp_path / "board.png", clean[case, k], seed))
            where = numbers(table, "x", "y", "z")
            number = numbers(table, "corner")[:, 0].astype(int)
            np.testing.assert_allclose(where[:, :2], places[number - 1] * SQUARE, atol=1e-12)
            sums.append(chi_squares(table, projected(where, *pose_of(case, turn))))
            assert len(where) >= 0.6 * len(places)  # small markers drown in noise
            if case in ("aruco", "apriltag"):
                np.testing.assert_array_equal(numbers(table, "marker")[:, 0], (number - 1) // 4 + arguments["first"])
    count = 2 * sum(len(each) for each in sums)
    # Chance gives 1 ± √(2/n) with n of some 700, twice that is 0.11. The finite s² (see `test_chessboard`) adds 0.03,
    # and as much the box of the pixel, for which the pattern's normal blur stands.
    assert abs(np.concatenate(sums).sum() / count - 1) < 0.17


def test_centres_of_circles_are_not_those_of_ellipses(tmp_path):
    """Large circles near by: the centre of the ellipse is off by a third of a pixel, which is taken off."""
    places, radius = grid(4, 3), 0.36
    turn = Rotation.from_euler("xyz", [0.9, 0.2, 0.3])
    flat = np.column_stack([places, np.zeros(12)]) * SQUARE
    place = middle_of(flat, turn, 0.18)
    homography = CAMERA @ np.column_stack([turn.as_matrix()[:, :2], place])
    truth = projected(flat, turn, place)
    ellipses = []
    for x, y in places * SQUARE:
        r = radius * SQUARE
        dual = np.array([[r * r - x * x, -x * y, -x], [-x * y, r * r - y * y, -y], [-x, -y, -1]])
        seen = homography @ dual @ homography.T  # the dual conic of the image: its last column is the centre
        ellipses.append(seen[:2, 2] / seen[2, 2])
    assert 0.2 < np.abs(np.array(ellipses) - truth).max() < 1
    errors = []
    image = rendered(patterns.circles(places, radius), turn, place)
    for seed in range(8):
        table = read(
            "circles",
            {"columns": 4, "rows": 3, "spacing": SQUARE, "asymmetric": "false"},
            written(tmp_path / "board.png", image, seed),
        )
        errors.append(numbers(table, "u", "v") - truth)
    # Eight photographs leave a third of σ, some 0.005 px.
    assert np.abs(np.mean(errors, axis=0)).max() < 0.012


def test_circles_in_large_photographs_are_measured_where_they_are_small(tmp_path):
    large = CAMERA * [[6.0], [6.0], [1.0]]
    _, pattern, arguments, places, _ = CASES["circles"]
    turn, place = pose_of("circles", TURNS[1])
    image = rendered(pattern, turn, place, camera=large, shape=(1440, 1920), samples=1, blur=1.2)
    table = read("circles", arguments, written(tmp_path / "board.png", image))
    truth = projected(np.column_stack([places, np.zeros(len(places))]) * SQUARE, turn, place, large)
    assert (chi_squares(table, truth) < 25).all()  # of two degrees: 4e-6 a point
    assert np.abs(numbers(table, "u", "v") - truth).max() < 0.05


@pytest.mark.parametrize("case", ["charuco", "aruco"])
def test_what_is_seen_of_a_board_is_enough(case, clean, tmp_path):
    """The left half of the image is covered: the corners that are left have their own numbers."""
    name, _, arguments, places, _ = CASES[case]
    image = clean[case, 0].copy()
    image[:, : image.shape[1] * 2 // 5] = 100
    table = read(name, arguments, written(tmp_path / "board.png", image))
    where = numbers(table, "x", "y", "z")
    assert 4 <= len(where) < len(places)
    assert np.abs(numbers(table, "u", "v") - projected(where, *pose_of(case, TURNS[0]))).max() < 0.2


def said(name, arguments, path):
    with pytest.raises(MbmError) as caught:
        read(name, arguments, path)
    (found,) = caught.value.diagnostics
    return found


@pytest.mark.parametrize("case", CASES)
def test_images_without_the_board_are_named(case, clean, tmp_path):
    name, _, arguments, _, _ = CASES[case]
    save(tmp_path / "board1.png", np.full((240, 320), 128, np.uint8))
    found = said(name, arguments, tmp_path / "board1.png")
    assert found.code.name == "no-board"
    assert found.message.endswith("was found in the image `board*.png`")
    noise = np.random.default_rng(0).integers(0, 256, (240, 320), np.uint8)
    save(tmp_path / "board2.png", noise)
    assert said(name, arguments, tmp_path / "board2.png").code.name == "no-board"
    written(tmp_path / "board3.png", clean[case, 0])
    table = read(name, arguments, *(tmp_path / f"board{k}.png" for k in (1, 2, 3)))
    warning = next(remark for remark in table.remarks if remark.code.name == "board-left-out")
    assert warning.message.endswith("in 2 of 3 images, which give no rows: board1, board2")


@pytest.mark.parametrize("case", CASES)
def test_two_boards_are_not_told_apart(case, clean, tmp_path):
    name, _, arguments, _, _ = CASES[case]
    twice = np.hstack([clean[case, 0], clean[case, 0]])
    found = said(name, arguments, written(tmp_path / "board.png", twice, noise=1))
    assert found.code.name == "no-board"
    assert "two boards" in found.message


def test_two_chessboards_are_not_told_apart(tmp_path):
    turn = TURNS[0]
    image = rendered(rendering.chessboard(7, 4), turn, middle_of(rendering.corners(7, 4), turn, 0.4))
    path = written(tmp_path / "board.png", np.hstack([image, image]))
    found = said("chessboard", {"columns": 7, "rows": 4, "size": SQUARE}, path)
    assert found.message.endswith("was found in the image `board*.png`: it shows two boards")


@pytest.mark.parametrize("case", ["charuco", "aruco", "apriltag"])
def test_a_mirrored_board_is_said_to_be(case, clean, tmp_path):
    name, _, arguments, _, _ = CASES[case]
    path = written(tmp_path / "board.png", clean[case, 0][:, ::-1])
    assert said(name, arguments, path).message.endswith(": it is mirrored, or the board is seen from behind")


def test_mirrored_circles_with_an_even_number_of_shifted_rows_are_said_to_be(tmp_path):
    places = shifted(4, 6)
    turn = TURNS[0]
    flat = np.column_stack([places, np.zeros(len(places))]) * SQUARE
    place = middle_of(flat, turn, 0.5)
    image = rendered(patterns.circles(places, 0.45), turn, place)
    arguments = {"columns": 4, "rows": 6, "spacing": SQUARE, "asymmetric": "true"}
    table = read("circles", arguments, written(tmp_path / "board.png", image))
    assert np.abs(numbers(table, "u", "v") - projected(flat, turn, place)).max() < 0.1
    path = written(tmp_path / "board.png", image[:, ::-1])
    assert said("circles", arguments, path).message.endswith(": its circles are those of the mirrored board")


def test_markers_in_another_order_are_said_to_be(clean, tmp_path):
    _, _, arguments, _, _ = CASES["aruco"]
    path = written(tmp_path / "board.png", clean["aruco", 0])
    for wanted in ({**arguments, "columns": 2, "rows": 3}, {**arguments, "gap": 3 * SQUARE}):
        assert "markers are not where the board has them" in said("aruco", wanted, path).message


@pytest.mark.parametrize(
    ("name", "changed", "words"),
    [
        ("charuco", {"marker": SQUARE}, "its markers are not smaller than its squares"),
        ("charuco", {"columns": 30, "rows": 30}, "`DICT_4X4_50` has those from 0 to 49"),
        ("aruco", {"first": 47}, "it has the markers 47 to 52, `DICT_4X4_50` has those from 0 to 49"),
        ("aruco", {"columns": 1000, "rows": 1000}, "`DICT_4X4_50` has those from 0 to 49"),
    ],
)
def test_boards_that_cannot_be_are_refused(name, changed, words, tmp_path):
    found = said(name, {**CASES[name][2], **changed}, tmp_path / "unread.png")
    assert found.code.name == "bad-board"
    assert words in found.message


@pytest.mark.parametrize("pattern", [features.crossing, features.corner, features.disc])
def test_derivatives_of_patterns(pattern):
    """Against differences of second order; four Gauss points leave 1e-5 in the value of a crossing."""
    shape = np.array([0.02, 0.004, 0.03, 0.2]) if pattern is features.disc else np.array([0.3, 1.6, 0.2])
    random = np.random.default_rng(5)
    for x, y in random.uniform(-8, 8, (20, 2)):
        at = np.array([*shape, x, y])

        def value(p):
            return float(pattern(p[None, :-2], p[None, -2:-1], p[None, -1:])[0][0, 0])

        steps = 1e-6 * np.eye(len(at))
        numeric = [(value(at + step) - value(at - step)) / 2e-6 for step in steps]
        _, by_place, by_shape = pattern(at[None, :-2], at[None, -2:-1], at[None, -1:])
        np.testing.assert_allclose([*by_shape[0, :, 0], *by_place[0, :, 0]], numeric, atol=2e-5)


def test_a_camera_is_calibrated_from_a_board_of_circles(clean, tmp_path):
    random = np.random.default_rng(3)
    _, pattern, _, places, _ = CASES["asymmetric circles"]
    flat = np.column_stack([places, np.zeros(len(places))]) * SQUARE
    for k in range(5):
        turn = Rotation.from_euler("xyz", [*random.uniform(-0.6, 0.6, 2), random.uniform(-3, 3)])
        image = rendered(pattern, turn, middle_of(flat, turn, 0.45))
        written(tmp_path / f"board{k}.png", image, seed=k)
    text = """(problem camera
      (data spots (circles "board*.png" 3 7 25mm :asymmetric true))
      (camera cam :focal (fx fy) :center (cx cy))
      (unknowns (fx) (fy) (cx) (cy) (T (pose 3) :per spots.photo))
      (observe spots (= [u v] (project cam (transform (T photo) [x y z]))) :covariance covariance))"""
    solved = mbm.loads(text, base=tmp_path).solve()
    assert solved.status == "ok"
    truth = {"fx": CAMERA[0, 0], "fy": CAMERA[1, 1], "cx": CAMERA[0, 2], "cy": CAMERA[1, 2]}
    for name, value in truth.items():
        assert abs(solved[name].value - value) < 4 * solved[name].sigma  # 1 in 10,000
