"""The examples that pin the language: each parses, and solves with data made for it or says what comes later, where.

The data are made here from the model of each example in NumPy with seeded noise, so that the truth is known.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.files.reading import read_file
from mbm.text.formatter import format_text
from mbm.text.printer import print_form
from mbm.text.reader import read
from mbm.text.types import Source

ROOT = Path(__file__).parents[2]
EXAMPLES = Path(__file__).parent / "examples"
NAMES = (
    "bundle", "calibration", "camera-and-ranges", "decay", "desk", "ellipse", "hand", "office-walk", "pose-graph",
    "skeleton", "tags",
)  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    """The examples with data of the columns that their comments name."""
    for path in EXAMPLES.glob("*.mbm"):
        shutil.copy(path, tmp_path)
    shutil.copy(ROOT / "problems" / "desk" / "furniture.mbm", tmp_path)
    for name in ("skeleton_joints.csv", "skeleton_dofs.csv"):
        shutil.copy(ROOT / "problems" / "skeleton" / name, tmp_path)
    make_decay(tmp_path)
    make_desk(tmp_path)
    make_tags(tmp_path)
    make_ellipse(tmp_path)
    make_office_walk(tmp_path)
    make_hand(tmp_path)
    make_bundle(tmp_path)
    make_pose_graph(tmp_path)
    return tmp_path


def write(path: Path, header: str, rows) -> None:
    lines = [header, *(",".join(c if isinstance(c, str) else f"{c:.10g}" for c in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")


def make_decay(folder: Path) -> None:
    x = np.linspace(50, 800, 25)
    y = 240 * (1 - np.exp(-5.5e-4 * x)) + np.random.default_rng(1).normal(0, 0.1, x.size)
    write(folder / "decay.csv", "x,y", zip(x, y, strict=True))


def make_desk(folder: Path) -> None:
    """The desk of the text at yaw 0.4, position (3, 0.2), seen from 1.5 m; 2 px of noise."""
    random = np.random.default_rng(2)
    places = {f"board/vertex/{i}": (0.6 * a, 0.35 * b, 0.7) for i, (a, b) in enumerate(CORNERS, 1)}
    places |= {f"leg{i}/origin": (0.57 * a, 0.32 * b, 0.0) for i, (a, b) in enumerate(CORNERS, 1)}
    rows = []
    for path, (x, y, z) in places.items():
        forward = 3 + np.cos(0.4) * x - np.sin(0.4) * y
        left = 0.2 + np.sin(0.4) * x + np.cos(0.4) * y
        u, v = random.normal((800 * left / forward, 800 * (z - 1.5) / forward), 2)
        rows.append((path, u, v))
    write(folder / "corners.csv", "path,X,Y", rows)


CORNERS = ((1, 1), (-1, 1), (-1, -1), (1, -1))
TAG = np.array([[1.2, 0.9, 0.8], [2.0, 1.7, 1.1]])


def make_tags(folder: Path) -> None:
    """Two places, twelve receivers, 5 mm of noise."""
    random = np.random.default_rng(3)
    receivers = [(float(k), 0.5 + k % 4, 0.6 + k // 4, 2.7) for k in range(12)]
    write(folder / "receivers.csv", "id,x,y,z", receivers)
    rows = [
        (epoch, r[0], np.linalg.norm(TAG[epoch - 1] - r[1:]) + random.normal(0, 0.005))
        for epoch in (1, 2)
        for r in receivers
    ]
    write(folder / "ranges.csv", "epoch,receiver,range", rows)


SIGHT = (Rotation.from_euler("xyz", [-1.9, 0.3, 0.2]), np.array([0.1, 0.5, 3.2]))
"""The desk's pose in the camera's frame."""


def make_camera_and_ranges(folder: Path) -> None:
    """The desk seen by a camera, 0.6 px of noise and one corner marked wrongly; three distances of 4 mm to its top."""
    random = np.random.default_rng(5)
    turn, place = SIGHT
    places = {f"board/vertex/{i}": (0.6 * a, 0.37 * b, 0.72) for i, (a, b) in enumerate(CORNERS, 1)}
    places |= {f"leg{i}/origin": (0.57 * a, 0.34 * b, 0.0) for i, (a, b) in enumerate(CORNERS, 1)}
    rows = []
    for path, point in places.items():
        x, y, z = turn.apply(point) + place
        u, v = random.normal((820 * x / z + 320, 820 * y / z + 240), 0.6)
        rows.append((path, u + (25 if path == "leg3/origin" else 0), v))
    write(folder / "corners.csv", "path,u,v", rows)
    stations = [(1.0, 0.1, 0.0, 0.0), (2.0, -0.1, 0.0, 0.0), (3.0, 0.0, 0.1, 0.0)]
    write(folder / "stations.csv", "id,x,y,z", stations)
    top = turn.apply((0, 0, 0.72)) + place
    rows = [(s[0], np.linalg.norm(top - s[1:]) + random.normal(0, 0.004)) for s in stations]
    write(folder / "echoes.csv", "station,range", rows)


RIM = np.array([0.3, -0.2, 2.0, 1.1, 0.5])
"""Centre, axes and turn of the ellipse."""


def make_ellipse(folder: Path) -> None:
    around = np.linspace(0, 6, 40)
    u, v = RIM[2] * np.cos(around), RIM[3] * np.sin(around)
    c, s = np.cos(RIM[4]), np.sin(RIM[4])
    points = np.column_stack([RIM[0] + c * u - s * v, RIM[1] + s * u + c * v])
    write(folder / "rim.csv", "x,y", points + np.random.default_rng(6).normal(0, 0.02, points.shape))


def make_bundle(folder: Path) -> None:
    """Four cameras of the BAL kind that see thirty points, half a pixel of noise; starts are a little off."""
    random = np.random.default_rng(7)
    points = random.uniform(-1, 1, (30, 3))
    cameras = []
    for k in range(4):
        turn = Rotation.from_euler("y", 0.3 * (k - 1.5))
        cameras.append(np.concatenate([turn.as_rotvec(), [0.1 * k, -0.05 * k, -5], [500, 1e-3, -1e-4]]))
    lines = [f"4 30 {4 * 30}"]
    for i, point in enumerate(points):
        for k, camera in enumerate(cameras):
            u, v = snavely(camera, point) + random.normal(0, 0.5, 2)
            lines.append(f"{k} {i} {u:.6f} {v:.6f}")
    off = np.array([0.01, 0.01, 0.01, 0.05, 0.05, 0.05, 5, 1e-3, 1e-4])
    numbers = np.concatenate([*(c + off * random.normal(size=9) for c in cameras)])
    lines += [f"{number:.12g}" for number in numbers]
    lines += [f"{number:.12g}" for number in (points + random.normal(0, 0.05, points.shape)).ravel()]
    (folder / "ladybug.txt").write_text("\n".join(lines) + "\n")


def snavely(camera, point):
    x, y, z = Rotation.from_rotvec(camera[:3]).apply(point) + camera[3:6]
    u, v = -x / z, -y / z
    r2 = u * u + v * v
    return camera[6] * (1 + camera[7] * r2 + camera[8] * r2 * r2) * np.array([u, v])


BOARD_CAMERA = np.array([[310.0, 0, 158.0], [0, 312.0, 121.0], [0, 0, 1]])


def make_calibration(folder: Path) -> None:
    """Six photographs of the board without distortion, 3 grey values of noise."""
    pytest.importorskip("cv2")
    from tests.images.rendering import chessboard, corners, middle_of, noisy, rendered, save

    random = np.random.default_rng(9)
    for k in range(6):
        turn = Rotation.from_euler("xyz", [*random.uniform(-0.6, 0.6, 2), random.uniform(-3, 3)])
        place = middle_of(corners(9, 6), turn, 0.36)
        image = rendered(chessboard(9, 6), turn, place, camera=BOARD_CAMERA, samples=4)
        save(folder / f"left{k}.jpg", noisy(image, random, 3))


def make_pose_graph(folder: Path) -> None:
    """A square of twelve places and two ways across; the start is the odometry."""
    random = np.random.default_rng(8)
    headings = np.repeat(np.arange(4) * np.pi / 2, 3)
    places = np.cumsum(np.concatenate([[0], np.exp(1j * headings[:-1])]))
    lines, place, heading = [], 0j, 0.0
    for i, j in [*((i, i + 1) for i in range(11)), (11, 0), (1, 7)]:
        step = (places[j] - places[i]) * np.exp(-1j * headings[i]) + 0.02 * complex(*random.normal(size=2))
        turn = (headings[j] - headings[i] + 0.01 * random.normal() + np.pi) % (2 * np.pi) - np.pi
        lines.append(f"EDGE_SE2 {i} {j} {step.real:.9f} {step.imag:.9f} {turn:.9f} 2500 0 0 2500 0 10000")
        if j == i + 1:
            lines.append(f"VERTEX_SE2 {i} {place.real:.9f} {place.imag:.9f} {heading:.9f}")
            place, heading = place + step * np.exp(1j * heading), heading + turn
    lines.append(f"VERTEX_SE2 11 {place.real:.9f} {place.imag:.9f} {heading:.9f}")
    (folder / "intel.g2o").write_text("\n".join(lines) + "\n")


WALK = (0.8, 1.1, np.array([3.0, -2.0]))
"""Scale, turn and shift of the walk's similarity."""


def make_office_walk(folder: Path) -> None:
    """Three minutes round a room; 10 Hz in a frame of its own, 1 Hz with 1 m of noise."""
    t = np.round(np.arange(0, 180, 0.1), 1)
    own = np.column_stack([6 * np.cos(t / 9), 4 * np.sin(t / 7)])
    write(folder / "vio.csv", "t,x,y", np.column_stack([t, own]))
    scale, turn, shift = WALK
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    seen = scale * own[::10] @ rotation.T + shift
    seen += np.random.default_rng(4).normal(0, 1, seen.shape)
    write(folder / "ble.csv", "t,x,y", np.column_stack([t[::10] + 0.004, seen]))


LENGTHS = np.array([[45.0, 35.0, 28.0], [48.0, 38.0, 30.0]])
"""The links of the hand's two fingers."""


def make_hand(folder: Path) -> None:
    """Twelve frames of two fingers that bend: where the joints are to a pixel, lines along the links to 2 degrees."""
    random, joints, links = np.random.default_rng(5), [], []
    for frame in range(12):
        for finger in (1, 2):
            bend = np.deg2rad(25 + 4 * np.sin(frame / 4 + np.array([0.0, 0.4, 0.4]) + finger))
            along = np.cumsum(bend)
            steps = LENGTHS[finger - 1][:, None] * np.column_stack([np.cos(along), np.sin(along)])
            places = np.array([100 + 0.5 * frame, 100 - 0.3 * frame + 10 * (finger - 1.5)]) + np.cumsum(
                np.vstack([np.zeros(2), steps]), axis=0
            )
            joints.extend((frame, finger, n, *(places[n] + random.normal(0, 1, 2))) for n in range(4))
            for n in range(1, 4):
                alpha = along[n - 1] + random.normal(0, np.deg2rad(2))
                rho = -places[n, 0] * np.sin(alpha) + places[n, 1] * np.cos(alpha)
                turned = alpha > np.pi / 2
                links.append((frame, finger, n, alpha - np.pi * turned, (-rho if turned else rho) + random.normal()))
    write(folder / "joints.csv", "frame,finger,n,u,v", joints)
    write(folder / "links.csv", "frame,finger,n,alpha,rho", links)


@pytest.mark.parametrize("name", NAMES)
def test_every_example_parses_and_keeps_its_meaning_when_laid_out(name, folder):
    path = folder / f"{name}.mbm"
    source = read_file(path, path.name)
    laid_out = format_text(source)
    assert format_text(Source(path.name, laid_out)) == laid_out
    # Vectors in problems are printed in brackets; the formatter's own tests say that this is all that changes.
    assert [f.head for f in read(Source(path.name, laid_out))] == [f.head for f in read(source)]
    assert all(print_form(f) for f in read(source))


def test_no_example_is_left_out(folder):
    assert {p.stem for p in EXAMPLES.glob("*.mbm")} == set(NAMES)


def away(solved, name, truth):
    """How many standard deviations an estimate lies from the truth."""
    return np.abs((solved[name].value - truth) / solved[name].sigma).max()


def test_decay_solves(folder):
    solved = mbm.load(folder / "decay.mbm").solve()
    assert solved.status == "ok"
    # Four standard deviations: 1 in 10,000.
    assert away(solved, "b1", 240) < 4
    assert away(solved, "b2", 5.5e-4) < 4


def test_desk_solves(folder):
    solved = mbm.load(folder / "desk.mbm").solve()
    assert (solved.status, solved.first.dof) == ("ok", 13)
    for name, truth in (("psi", 0.4), ("xg", 3), ("yg", 0.2), ("distance", np.hypot(3, 0.2))):
        assert away(solved, name, truth) < 4
    assert 1e-4 < solved.first.chi2_p < 1 - 1e-4


def test_skeleton_solves_from_near_the_truth(folder):
    solved = mbm.load(folder / "skeleton.mbm").named("skeleton-near").solve()
    assert (solved.status, solved.observability.rank) == ("ok", 25)
    assert solved["joint-at"].value.shape == (15, 3)


def test_office_walk_solves_window_by_window(folder):
    solved = mbm.load(folder / "office-walk.mbm").solve()
    assert solved.status == "ok"
    assert [s.status for s in solved.solves] == ["skipped", *["converged"] * 179]
    scale, turn, shift = WALK
    last = solved.solves[-1]
    away = (last.estimates[0].value - [turn, *shift, scale]) / (last.estimates[0].sigma * [1, 1, 1, scale])
    # Four standard deviations: 1 in 10,000. The scale's is that of its logarithm.
    assert np.abs(away).max() < 4


def test_tags_solve_with_echoes_among_them(folder):
    """Two of the twelve ranges of each epoch came by way of a wall."""
    path = folder / "ranges.csv"
    lines = path.read_text().splitlines()
    wrong = (4, 9, 15, 22)
    for row in wrong:
        epoch, receiver, distance = lines[row].split(",")
        lines[row] = f"{epoch},{receiver},{float(distance) + 0.7:.6f}"
    path.write_text("\n".join(lines) + "\n")
    solved = mbm.load(folder / "tags.mbm").solve()
    assert [s.key for s in solved.solves] == [{"epoch": 1}, {"epoch": 2}]
    found = np.array([s.estimates[0].value for s in solved.solves])
    # 5 mm of noise, 10 good ranges: the weakest direction is good to some 8 mm.
    np.testing.assert_allclose(found, TAG, atol=0.035)
    outliers = [row for s in solved.solves for row in s.residual_summaries["ranges"].outliers]
    assert set(wrong) <= set(outliers)
    assert len(outliers) <= len(wrong) + 2


def test_a_camera_and_ranges_find_the_desk(folder):
    make_camera_and_ranges(folder)  # its table of corners has the name of the desk's
    solved = mbm.load(folder / "camera-and-ranges.mbm").solve()
    assert solved.status == "ok"
    turn, place = SIGHT
    found = solved["T"].value
    off = turn.inv() * Rotation.from_quat(np.roll(found[:4], -1))
    # Four standard deviations, and a little for the corner marked wrongly, which `huber` bounds but does not remove.
    assert (np.abs(off.as_rotvec()) < 6 * solved["T"].sigma[:3]).all()
    assert (np.abs(found[4:] - place) < 6 * solved["T"].sigma[3:]).all()


def test_a_camera_is_calibrated_from_photographs(folder):
    make_calibration(folder)
    solved = mbm.load(folder / "calibration.mbm").solve()
    assert (solved.status, solved.first.dof) == ("ok", 2 * 6 * 54 - 9 - 6 * 6)
    # Four standard deviations: 1 in 10,000.
    for name, truth in (("fx", 310), ("fy", 312), ("cx", 158), ("cy", 121), ("k1", 0), ("k2", 0), ("p1", 0), ("k3", 0)):
        assert away(solved, name, truth) < 4, name


def test_an_ellipse_with_errors_in_both_coordinates(folder):
    solved = mbm.load(folder / "ellipse.mbm").solve()
    assert solved.status == "ok"
    for name, truth in (("c", RIM[:2]), ("a", RIM[2]), ("b", RIM[3])):
        assert away(solved, name, truth) < 4
    turned = solved["phi"].value - RIM[4]  # half a turn more is the same ellipse
    assert abs(np.sin(turned)) < 4 * solved["phi"].sigma


def test_a_bundle_in_the_minimum_norm_datum(folder):
    solved = mbm.load(folder / "bundle.mbm").solve()
    assert solved.status == "ok"
    # 240 residuals of half a pixel (stated as 1); 126 unknowns less the seven of the datum.
    assert solved.first.dof == 240 - (126 - 7)
    assert 0.25 * 121 * 0.6 < solved.first.cost < 0.25 * 121 * 1.5


def test_a_pose_graph_in_the_minimum_norm_datum(folder):
    solved = mbm.load(folder / "pose-graph.mbm").solve()
    assert (solved.status, solved.first.dof) == ("ok", 3 * 13 - (36 - 3))
    assert 1e-4 < solved.first.chi2_p < 1 - 1e-4


@pytest.mark.slow
def test_hand_solves_by_batch(folder):
    """Constant link lengths, moving angles within limits: all frames at once."""
    solved = mbm.load(folder / "hand.mbm").solve(method="batch")
    assert solved.status == "ok"
    assert away(solved, "r", LENGTHS) < 4
    assert solved["theta"].value.shape == (12, 2, 3)
    assert (np.rad2deg(np.abs(solved["theta"].value[:, :, 1] - solved["theta"].value[:, :, 2])) < 10.001).all()
