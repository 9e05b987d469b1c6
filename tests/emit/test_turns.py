"""Angles are reported in (−π, π] on every path, and what is derived from them is derived from the reported ones."""

from __future__ import annotations

import csv
import math
import shutil
import sys

import pytest

import mbm
from tests.emit.making import make, of_text, run, written

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) is here")

MEAN = 20.0 / 3
"""Of the three measurements of the turn, which is one turn and a little more."""
TURN = MEAN - 2 * math.pi
SIGMA = 0.1 / math.sqrt(3)
WANTED = {
    "a": (TURN, SIGMA),
    "twice": (2 * TURN, 2 * SIGMA),
    "square": (TURN**2, 2 * TURN * SIGMA),
    "opposite": (TURN - math.pi, SIGMA),  # an angle itself: a + π by whole turns
}

TEXT = """(problem turns
  (data d (table (run y) (1 6.5) (1 6.7) (1 6.8)))
  (unknowns (a angle :init 7))
  (observe d (= y a) :sigma 0.1)
  (derive (twice (* 2 a)) (square (* a a)) (opposite (angle (+ a pi)))){more})
"""
"""The equation has no period: the solver ends at the mean, beyond one turn."""


@pytest.mark.parametrize("more", ["", "\n  (for-each run)"], ids=["single", "for-each"])
def test_in_the_process(more):
    (solve,) = mbm.loads(TEXT.format(more=more)).solve().document()["solves"]
    found = {**solve["estimates"], **solve["derived"]}
    for name, (value, sigma) in WANTED.items():
        assert found[name]["value"] == pytest.approx(value, rel=1e-9), name
        assert found[name]["sigma"] == pytest.approx(sigma, rel=1e-9), name


@pytest.mark.parametrize("target", [pytest.param("c", marks=needs_compiler), "python"])
def test_in_generated_solvers(target, tmp_path):
    folder = written(of_text(TEXT.format(more=""), target), tmp_path)
    if target == "c":
        assert make(folder, "all", "test", watched=False).returncode == 0
        found = run("./turns", "data/d.csv", folder=folder)
    else:
        assert run(sys.executable, "test_turns.py", folder=folder).returncode == 0
        found = run(sys.executable, "turns.py", "data/d.csv", folder=folder)
    rows = {row["name"]: row for row in csv.DictReader(found.stdout.splitlines())}
    for name, (value, sigma) in WANTED.items():
        assert float(rows[name]["value"]) == pytest.approx(value, rel=1e-9), name
        assert float(rows[name]["sigma"]) == pytest.approx(sigma, rel=1e-9), name


POSED = """(problem posed
  (data d (table (k x y u v) {rows}))
  (data e (table (k) (1) (2)))
  (unknowns (R (rotation 2) :init (rot2 3)) (T (pose 2) :per e.k :init (pose2 0 0 3)))
  (observe one d (= [u v] (rotate R [x y])) :sigma 0.01)
  (observe each d (= [u v] (transform (T k) [x y])) :sigma 0.01)
  (derive (h (heading R))))
"""
BEYOND = math.pi + 0.14
"""Turns from 3 to where whole turns begin anew; the measurements are without errors."""
ROTATED = POSED.format(
    rows=" ".join(
        f"({k} {x} {y} {c * x - s * y!r} {s * x + c * y!r})"
        for k, x, y in ((1, 1, 0), (1, 0, 1), (2, 1, 0), (2, 0, 1))
        for c, s in ((math.cos(BEYOND), math.sin(BEYOND)),)
    )
)


@pytest.mark.parametrize("target", [pytest.param("c", marks=needs_compiler), "python"])
def test_rotations_and_poses_of_the_plane(target, tmp_path):
    folder = written(of_text(ROTATED, target), tmp_path)
    if target == "c":
        assert make(folder, "all", "test", watched=False).returncode == 0
        found = run("./posed", "data/d.csv", "data/e.csv", folder=folder)
    else:
        assert run(sys.executable, "test_posed.py", folder=folder).returncode == 0
        found = run(sys.executable, "posed.py", "data/d.csv", "data/e.csv", folder=folder)
    rows = {row["name"]: float(row["value"]) for row in csv.DictReader(found.stdout.splitlines())}
    for name in ("R", "T[1][1]", "T[2][1]", "h"):
        assert rows[name] == pytest.approx(BEYOND - 2 * math.pi, rel=1e-9), name
    for place in (2, 3):
        assert [rows[f"T[{k}][{place}]"] for k in (1, 2)] == pytest.approx([0.0, 0.0], abs=1e-9)
