"""The examples that pin the language: each parses, and solves with data made for it or says what comes later, where.

The data are made here from the model of each example in NumPy with seeded noise, so that the truth is known.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

import mbm
from mbm.text.formatter import format_text
from mbm.text.printer import print_form
from mbm.text.reader import read, read_file
from mbm.text.types import Source

ROOT = Path(__file__).parents[2]
EXAMPLES = Path(os.environ.get("MBM_SHARED", ROOT.parent / "shared")) / "examples"
NAMES = (
    "bundle", "calibration", "camera-and-ranges", "decay", "desk", "ellipse", "hand", "office-walk", "pose-graph",
    "skeleton", "tags",
)  # fmt: skip
LATER = {
    "bundle": ["(bal", "(bal", "(bal"],
    "calibration": ["(chessboard"],
    "camera-and-ranges": ["(pose 3)", "(huber"],
    "ellipse": [":errors", ">="],
    "hand": ["states", "dynamics"],
    "pose-graph": ["(g2o", "(g2o"],
    "skeleton": [":starts"],
    "tags": ["<=", "(lmeds"],
}
"""What each example needs that this version lacks: where the diagnostics point, in order."""


@pytest.fixture
def folder(tmp_path):
    """The examples with data of the columns that their comments name."""
    if not EXAMPLES.is_dir():
        pytest.skip("the shared examples are not here (set MBM_SHARED)")
    for path in EXAMPLES.glob("*.mbm"):
        shutil.copy(path, tmp_path)
    shutil.copy(ROOT / "problems" / "desk" / "furniture.mbm", tmp_path)
    for name in ("skeleton_joints.csv", "skeleton_dofs.csv"):
        shutil.copy(ROOT / "problems" / "skeleton" / name, tmp_path)
    make_decay(tmp_path)
    make_desk(tmp_path)
    make_tags(tmp_path)
    make_camera_and_ranges(tmp_path)
    make_ellipse(tmp_path)
    make_office_walk(tmp_path)
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


def make_camera_and_ranges(folder: Path) -> None:
    write(folder / "stations.csv", "id,x,y,z", [(1, 0.1, 0.0, 0.0), (2, -0.1, 0.0, 0.0), (3, 0.0, 0.1, 0.0)])
    write(folder / "echoes.csv", "station,range", [(1, 2.9), (2, 3.0), (3, 2.95)])


def make_ellipse(folder: Path) -> None:
    turn = np.linspace(0, 6, 20)
    write(folder / "rim.csv", "x,y", zip(2 * np.cos(turn), np.sin(turn), strict=True))


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


@pytest.mark.parametrize("name", NAMES)
def test_every_example_parses_and_keeps_its_meaning_when_laid_out(name, folder):
    path = folder / f"{name}.mbm"
    source = read_file(path, path.name)
    laid_out = format_text(source)
    assert format_text(Source(path.name, laid_out)) == laid_out
    # Vectors in problems are printed in brackets; the formatter's own tests say that this is all that changes.
    assert [f.head for f in read(Source(path.name, laid_out))] == [f.head for f in read(source)]
    assert all(print_form(f) for f in read(source))


@pytest.mark.parametrize("name", LATER)
def test_what_comes_later_is_said_at_its_place(name, folder):
    loaded = mbm.load(folder / f"{name}.mbm")
    problem = loaded.named(loaded.names[-1])
    with pytest.raises(mbm.MbmError) as caught:
        problem.solve()
    found = caught.value.diagnostics
    assert {d.code.name for d in found} == {"not-available-yet"}
    text = (folder / f"{name}.mbm").read_text()
    assert [text[d.place.start :].startswith(w) for d, w in zip(found, LATER[name], strict=True)] == [True] * len(found)


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
    assert [s.status.label for s in solved.solves] == ["skipped", *["converged"] * 179]
    scale, turn, shift = WALK
    last = solved.solves[-1]
    away = (last.estimates[0].value - [turn, *shift, scale]) / (last.estimates[0].sigma * [1, 1, 1, scale])
    # Four standard deviations: 1 in 10,000. The scale's is that of its logarithm.
    assert np.abs(away).max() < 4


def test_tags_solve_without_the_clauses_of_later_versions(folder):
    """With a start below the ceiling instead of the robust estimator and the bound."""
    text = (folder / "tags.mbm").read_text()
    for clause, instead in (
        ("(p (vector 3) :unit m)", "(p (vector 3) :unit m :init [2 2 1])"),
        ("(constraints (<= 0m (p 3) 2.7m))", ""),
        ("(solve :robust (lmeds :trials 200))", ""),
    ):
        assert clause in text
        text = text.replace(clause, instead)
    solved = mbm.loads(text, base=folder).solve()
    assert [s.key for s in solved.solves] == [{"epoch": 1}, {"epoch": 2}]
    found = np.array([s.estimates[0].value for s in solved.solves])
    # 5 mm of noise, 12 ranges: the weakest direction is good to some 7 mm.
    np.testing.assert_allclose(found, TAG, atol=0.03)
