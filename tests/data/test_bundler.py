"""Bundler files: what is in the tables, that their poses and cameras project as the format says, and faults."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mbm
from mbm.data.readers import READERS
from mbm.text.types import MbmError

F, K1, K2 = 500.0, -0.05, 0.01
ROTATION = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
T = np.array([0.25, -0.5, -4.0])
POINTS = np.array([[0.5, 0.25, -1.0], [-0.75, 0.5, -2.0], [0.0, -0.5, 0.5], [1.0, 1.0, -1.5]])


def projected(point):
    """P = R X + t; p = −P / P.z; f (1 + k1 |p|² + k2 |p|⁴) p, as the manual of Bundler has it."""
    seen = ROTATION @ point + T
    p = -seen[:2] / seen[2]
    square = p @ p
    return F * (1 + K1 * square + K2 * square**2) * p


def text():
    lines = ["# Bundle file v0.3", f"2 {len(POINTS)}", "0 0 0", "0 0 0", "0 0 0", "0 0 0", "0 0 0"]
    lines += [f"{F} {K1} {K2}", *(" ".join(map(str, row)) for row in ROTATION.tolist()), " ".join(map(str, T))]
    for number, point in enumerate(POINTS):
        u, v = projected(point)
        lines += [" ".join(map(str, point)), "255 0 9", f"1 1 {7 + number} {u:.17g} {v:.17g}"]
    return "\n".join(lines) + "\n"


def read(tmp_path, content):
    path = tmp_path / "bundle.out"
    path.write_text(content)
    return READERS["bundler"].read(path)


def columns(table):
    return {c.name: c.numbers.tolist() for c in table.columns}


def test_the_tables(tmp_path):
    found = read(tmp_path, text())
    assert columns(found["cameras"]) == {"camera": [1], "f": [F], "k1": [K1], "k2": [K2]}  # camera 0 was not registered
    images = columns(found["images"])
    half = np.sqrt(0.5)  # a quarter turn about −z
    pose = [images[name][0] for name in ("image", "camera", "qw", "qx", "qy", "qz", "x", "y", "z")]
    np.testing.assert_allclose(pose, [1, 1, half, 0, 0, -half, *T], atol=1e-15)  # roundings of numbers of size 1
    assert columns(found["points"])["z"] == POINTS[:, 2].tolist()
    seen = columns(found["observations"])
    assert (seen["image"], seen["point"]) == ([1, 1, 1, 1], [0, 1, 2, 3])
    assert [found[part].key for part in found] == ["camera", "image", "point", None]
    assert found["points"].file_rows.tolist() == [13, 16, 19, 22]
    assert found["observations"].file_rows.tolist() == [15, 18, 21, 24]


def test_a_problem_projects_the_points_where_they_are_seen(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("bundle.out").write_text(text())
    problem = """(problem p
      (data cams (bundler "bundle.out" :cameras)) (data images (bundler "bundle.out" :images) :with (cams camera))
      (data points (bundler "bundle.out" :points))
      (data seen (bundler "bundle.out" :observations) :with (images image) :with (points point))
      (unknowns (T (pose 3) :per images :init (pose3 (quaternion qw qx qy qz) [x y z]) :fixed true) (f :init 400))
      (define (P (transform (T image) [points.x points.y points.z])) (p [(/ (P 1) (- (P 3))) (/ (P 2) (- (P 3)))])
        (s (dot p p)) (k1 (first cams k1)) (k2 (first cams k2)))
      (observe seen (= [u v] (* f (+ 1 (* k1 s) (* k2 s s)) p)) :sigma 1))"""
    assert float(mbm.loads(problem, base=Path()).solve()["f"].value) == pytest.approx(F, rel=1e-12)  # one linear step


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("2 4\n", "2 4.5\n", "no whole number"),
        ("2 4\n", "2000000000000 4\n", "it announces 2,000,000,000,000 cameras"),
        ("2 4\n", "2 1e18\n", "points, more than the"),
        ("2 4\n", "3 4\n", "line"),
        ("1 1 7 ", "1 0 7 ", "point 0 is seen by camera 0, which there is not, or whose `f` is 0"),
        ("1 1 7 ", "1 5 7 ", "point 0 is seen by camera 5"),
        ("1 1 7 ", "900 1 7 ", "it announces 900 views"),
        ("1 1 7 ", "-1 1 7 ", "the number of views is missing"),
        ("-1.0 0.0 0.0\n", "-1.0 0.5 0.0\n", "the rotation of the camera is no rotation matrix"),
        ("255 0 9\n", "255 red 9\n", "`red` is no number"),
        ("1 1 10 ", "0 1 1 10 ", "numbers follow the last point"),
    ],
)
def test_faults_have_the_line(tmp_path, old, new, reason):
    assert old in text()
    with pytest.raises(MbmError) as caught:
        read(tmp_path, text().replace(old, new, 1))
    (fault,) = caught.value.diagnostics
    assert fault.code.name == "malformed-record"
    assert reason in fault.message


def test_a_file_that_is_cut_anywhere_is_refused(tmp_path):
    words = text().split("\n", 1)[1].split()
    for count in range(1, len(words)):
        with pytest.raises(MbmError):
            read(tmp_path, " ".join(words[:count]))
    assert len(read(tmp_path, " ".join(words))["observations"].file_rows) == 4
