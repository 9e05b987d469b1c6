"""Chessboards in photographs that were rendered here, with the corners known."""

from __future__ import annotations

import shutil

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.compiler import Inputs
from mbm.data.readers import READERS
from tests.images.rendering import (
    CAMERA,
    SQUARE,
    chessboard,
    corners,
    middle_of,
    noisy,
    projected,
    rendered,
    save,
)

COLUMNS, ROWS = 7, 4


def read(*paths, columns=COLUMNS, rows=ROWS):
    arguments = {"columns": columns, "rows": rows, "size": SQUARE}
    return READERS["chessboard"].read({path.stem: path for path in paths}, "board*.png", arguments)


def numbers(table, *names):
    columns = {column.name: column.numbers for column in table.columns}
    return np.column_stack([columns[name] for name in names])


def poses(count, columns=COLUMNS, rows=ROWS):
    """Seeded poses: the board turned anyhow about the line of sight, tilted by 40° at most."""
    random = np.random.default_rng(11)
    points = corners(columns, rows)
    for _ in range(count):
        tilt = Rotation.from_euler("xy", random.uniform(-0.7, 0.7, 2))
        turn = tilt * Rotation.from_euler("z", random.uniform(-np.pi, np.pi))
        yield turn, middle_of(points, turn, random.uniform(0.36, 0.45))


def test_corners_are_found_in_order_to_a_fraction_of_a_pixel(tmp_path):
    random = np.random.default_rng(1)
    paths, truth = [], []
    for i, (turn, place) in enumerate(poses(12)):
        paths.append(tmp_path / f"board{i:02}.png")
        save(paths[-1], noisy(rendered(chessboard(COLUMNS, ROWS), turn, place), random, 2))
        truth.append(projected(corners(COLUMNS, ROWS), turn, place))
    table = read(*paths)
    photo = next(column.texts for column in table.columns if column.name == "photo")
    assert photo == tuple(path.stem for path in paths for _ in range(COLUMNS * ROWS))
    shot = next(column.texts for column in table.columns if column.name == "shot")
    assert shot == tuple(path.stem.removeprefix("board") for path in paths for _ in range(COLUMNS * ROWS))
    np.testing.assert_array_equal(numbers(table, "corner")[:, 0], np.tile(np.arange(1, COLUMNS * ROWS + 1), 12))
    np.testing.assert_allclose(numbers(table, "x", "y", "z"), np.tile(corners(COLUMNS, ROWS), (12, 1)), atol=1e-15)
    away = np.abs(numbers(table, "u", "v") - np.concatenate(truth))
    # With 2 grey values of noise a corner is good to 0.01 px or so: a tenth of a pixel is far beyond chance.
    assert away.max() < 0.1


def test_errors_are_as_large_as_is_stated(tmp_path):
    """χ² of the errors with the stated covariances, over 24 photographs with other noise of each of six poses."""
    random = np.random.default_rng(2)
    sums, count = [], 0
    for turn, place in poses(6):
        clean = rendered(chessboard(COLUMNS, ROWS), turn, place)
        truth = projected(corners(COLUMNS, ROWS), turn, place)
        for _ in range(24):
            path = tmp_path / "board.png"
            save(path, noisy(clean, random, 2))
            table = read(path)
            error = numbers(table, "u", "v") - truth
            c = numbers(table, "covariance11", "covariance12", "covariance22")
            covariance = np.moveaxis(np.array([[c[:, 0], c[:, 1]], [c[:, 1], c[:, 2]]]), -1, 0)
            sums.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error))
            np.testing.assert_allclose(numbers(table, "sigma")[:, 0] ** 2, (c[:, 0] + c[:, 2]) / 2, rtol=1e-12)
            count += 2 * len(error)
    # Chance gives 1 ± 0.016 (8,064 errors). That s² has some 100 degrees of freedom adds 0.02, for E[1/s²] is larger
    # than 1/σ²; the box of the pixel, which the pattern's normal blur stands for, about as much.
    assert abs(np.concatenate(sums).sum() / count - 1) < 0.07


@pytest.mark.parametrize(("columns", "rows"), [(5, 7), (6, 4), (5, 5), (4, 4)])
def test_boards_that_look_alike_upside_down_are_numbered_by_the_rule(columns, rows, tmp_path):
    """Both sides odd, or both even: x points to the right as far as it can, and turns into y clockwise."""
    for i, (turn, place) in enumerate(poses(4, columns, rows)):
        path = tmp_path / f"board{i}.png"
        save(path, noisy(rendered(chessboard(columns, rows), turn, place), np.random.default_rng(i), 2))
        table = read(path, columns=columns, rows=rows)
        grid = numbers(table, "u", "v").reshape(rows, columns, 2)
        right, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        assert right[0] * down[1] - right[1] * down[0] > 0
        assert right[0] > 0
        truth = projected(corners(columns, rows), turn, place)
        found = np.linalg.norm(truth[:, None] - grid.reshape(1, -1, 2), axis=2).min(axis=1)
        assert found.max() < 0.1  # the same points, whatever their numbers


def test_a_large_photograph_is_searched_small_and_measured_large(tmp_path):
    large = CAMERA * [[4.5], [4.5], [1.0]]  # longer than `SEARCHED`
    points = corners(COLUMNS, ROWS)
    turn = Rotation.from_euler("xyz", [0.3, -0.2, 0.4])
    place = middle_of(points, turn, 0.4)
    image = rendered(chessboard(COLUMNS, ROWS), turn, place, camera=large, shape=(1080, 1440), samples=2)
    save(tmp_path / "board.png", noisy(image, np.random.default_rng(3), 2))
    away = numbers(read(tmp_path / "board.png"), "u", "v") - projected(points, turn, place, large)
    assert np.abs(away).max() < 0.05


def write_problem(folder, more=""):
    text = f"""(problem camera
      (data corners (chessboard "board*.png" {COLUMNS} {ROWS} 25mm))
      (camera cam :focal (fx fy) :center (cx cy))
      (unknowns (fx) (fy) (cx) (cy) (T (pose 3) :per corners.photo))
      (observe corners (= [u v] (project cam (transform (T photo) [x y z]))) {more}))"""
    path = folder / "camera.mbm"
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def boards(tmp_path_factory):
    """Photographs of eight poses, made once."""
    folder, random = tmp_path_factory.mktemp("boards"), np.random.default_rng(4)
    for i, (turn, place) in enumerate(poses(8)):
        save(folder / f"board{i}.png", noisy(rendered(chessboard(COLUMNS, ROWS), turn, place), random, 4))
    return folder


@pytest.fixture
def photographs(boards, tmp_path):
    shutil.copytree(boards, tmp_path, dirs_exist_ok=True)
    return tmp_path


def test_a_camera_is_calibrated_from_image_files(photographs):
    solved = mbm.load(write_problem(photographs, ":covariance covariance")).solve()
    assert solved.status == "ok"
    truth = {"fx": CAMERA[0, 0], "fy": CAMERA[1, 1], "cx": CAMERA[0, 2], "cy": CAMERA[1, 2]}
    for name, value in truth.items():
        assert abs(solved[name].value - value) < 4 * solved[name].sigma  # 1 in 10,000
    # Chance gives χ²/dof = 1 ± √(2/dof) with dof = 396, four of which are 0.28; the bias of 1/s² and of the pattern
    # (see above) adds 0.04.
    assert solved.first.dof == 8 * (2 * COLUMNS * ROWS - 6) - 4
    assert abs(solved.first.cost / solved.first.dof - 1) < 0.32
    for i, (turn, place) in enumerate(poses(8)):
        pose, sigma = solved["T"].value[i], solved["T"].sigma[i]
        off = (turn.inv() * Rotation.from_quat(np.roll(pose[:4], -1))).as_rotvec()
        assert (np.abs(off) < 5 * sigma[:3]).all()
        assert (np.abs(pose[4:] - place) < 5 * sigma[3:]).all()


def test_every_photograph_is_an_input_with_its_digest(photographs):
    import hashlib

    save(photographs / "board9.png", np.full((240, 320), 128, np.uint8))
    document = mbm.load(write_problem(photographs, ":sigma unknown")).solve().document()
    rows = {entry["path"].rpartition("/")[2]: entry for entry in document["inputs"]}
    assert sorted(rows) == [f"board{i}.png" for i in (*range(8), 9)]
    for name, entry in rows.items():
        assert entry["sha256"] == hashlib.sha256((photographs / name).read_bytes()).hexdigest()
        assert entry["rows"] == (0 if name == "board9.png" else COLUMNS * ROWS)
    (warning,) = document["diagnostics"]
    assert (warning["severity"], warning["code"]) == ("warning", "board-left-out")
    assert warning["message"].endswith("in 1 of 9 images, which give no rows: board9")


def test_sizes_state_the_unit_of_places_on_the_board(photographs):
    checked = mbm.load(write_problem(photographs, ":sigma unknown")).diagnostics(Inputs(), strict_units=True)
    missing = [d.message for d in checked if d.code.name == "missing-unit"]
    assert missing
    assert not [message for message in missing if "column" in message]


def test_files_for_opencv_have_the_size_of_the_photographs(photographs, tmp_path):
    """Also of rows that a condition and a union chose; without photographs the size would be guessed."""
    problem = write_problem(photographs, ":covariance covariance")
    chosen = """(data all (chessboard "board*.png" 7 4 25mm)) (data corners (union all) :where (> corner 1))"""
    text = problem.read_text().replace(f'(data corners (chessboard "board*.png" {COLUMNS} {ROWS} 25mm))', chosen)
    assert chosen in text
    mbm.loads(text, base=photographs).solve().write("opencv-yaml", tmp_path / "cameras")
    storage = cv2.FileStorage(str(tmp_path / "cameras" / "cam.yml"), cv2.FILE_STORAGE_READ)
    size = [int(storage.getNode(name).real()) for name in ("image_width", "image_height")]
    assert size == [320, 240]
