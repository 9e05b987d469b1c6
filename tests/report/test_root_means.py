"""Root mean squares of raw residuals: against OpenCV, and against the residuals that are written row by row."""

from __future__ import annotations

import csv
import re
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

import mbm

CALIBRATION = Path(__file__).parents[2] / "problems" / "calibration"


def means(solved, clause, solve=0):
    """The document's numbers of a clause, by what they are over."""
    written = solved.document()["solves"][solve]["residuals"][clause]["rms_unit"]
    return {each["per"]: (each["value"], each["unit"]) for each in listed(written)}


def listed(written):
    """One mean stands by itself, as CONTRACT §2 has it; several are a list."""
    return [written] if isinstance(written, dict) else written


def by_hand(report, clause):
    """Residuals (rows, components) of the rows that count, from those that are written one by one."""
    rows = defaultdict(list)
    for each in report.rows():
        if each.clause == clause and each.used:
            rows[each.row].append(each.value)
    return np.array(list(rows.values()))


def test_a_calibration_has_the_reprojection_error_of_opencv() -> None:
    """OpenCV's is per point, in pixels. It keeps points as 32-bit numbers, to 2e-5 px here, most of which
    cancels in the mean of 0.2 px.
    """
    cv2 = pytest.importorskip("cv2")
    found = means(mbm.load(CALIBRATION / "calibration.mbm").solve(), "corners")
    photos = defaultdict(list)
    with (CALIBRATION / "corners.csv").open() as stream:
        for row in csv.DictReader(stream):
            photos[row["photo"]].append([float(row[name]) for name in ("x", "y", "u", "v")])
    board = [np.float32([[x, y, 0] for x, y, _, _ in each]) for each in photos.values()]
    image = [np.float32([[u, v] for _, _, u, v in each]) for each in photos.values()]
    guess = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])
    ends = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-15)
    theirs = cv2.calibrateCamera(
        board, image, (640, 480), guess, None, flags=cv2.CALIB_USE_INTRINSIC_GUESS, criteria=ends
    )[0]
    assert found["point"] == (pytest.approx(theirs, rel=1e-5), "px")
    assert found["coordinate"] == (pytest.approx(theirs / np.sqrt(2), rel=1e-5), "px")
    squares = [found[f"coordinate {i}"][0] ** 2 for i in (1, 2)]
    assert sum(squares) == pytest.approx(found["point"][0] ** 2, rel=1e-12)


PLACES = """
(problem places {keys}
  (data t external :columns ((k k) (x x :unit mm) (y y :unit mm)))
  (unknowns (p (vector 2) :init [0 0]))
  (observe t (= [x y] p) :sigma {sigma} {loss})
  (solve {solve}))
"""


def scattered(seed=4, keys=6, each=12):
    generator = np.random.default_rng(seed)
    k = np.repeat(np.arange(1.0, keys + 1), each)
    xy = generator.normal(size=(len(k), 2))
    xy[::each] += 200.0
    return {"k": k, "x": xy[:, 0], "y": xy[:, 1]}


@pytest.mark.parametrize("keys", ["", "(for-each k)"], ids=["one", "many"])
@pytest.mark.parametrize("robust", ["none", "(tukey)", "(huber)", "lmeds", "gnc"])
def test_every_path_says_what_its_rows_say(keys: str, robust: str) -> None:
    """Rows that were rejected do not count: with them the mean would be some 50 mm."""
    loss = f":loss {robust}" if robust.startswith("(") else ""
    solve = f":robust {robust}" if robust in ("lmeds", "gnc") else ""
    text = PLACES.format(keys=keys, sigma="1mm", loss=loss, solve=solve)
    solved = mbm.loads(text).solve(data={"t": scattered()})
    assert len(solved.solves) == (6 if keys else 1)
    for number, report in enumerate(solved.solves):
        millimetres = by_hand(report, "t") / 1e-3
        rejects = robust in ("(tukey)", "lmeds", "gnc")
        assert len(millimetres) < report.residual_summaries["t"].rows if rejects else True
        found = means(solved, "t", number)
        squares = np.square(millimetres)
        assert found == {
            # the same rows added in another order
            "point": (pytest.approx(np.sqrt(squares.sum(axis=1).mean()), rel=1e-12), "mm"),
            "coordinate": (pytest.approx(np.sqrt(squares.mean()), rel=1e-12), "mm"),
            "coordinate 1": (pytest.approx(np.sqrt(squares[:, 0].mean()), rel=1e-12), "mm"),
            "coordinate 2": (pytest.approx(np.sqrt(squares[:, 1].mean()), rel=1e-12), "mm"),
        }
        assert (found["point"][0] < 5) == rejects


def test_windows_and_errors_in_columns_have_them_too() -> None:
    x = np.arange(40.0)
    y = 2 * x + np.random.default_rng(1).normal(size=40)
    text = """
    (problem drift (window x :length 20 :step 10)
      (data t external :columns ((y y :unit cm) (x x)))
      (unknowns (a :init 0) (b :init 0.02))
      (observe t (= y (+ a (* b x))) :sigma 1cm :errors ((x 0.1))))"""
    solved = mbm.loads(text).solve(data={"t": {"x": x, "y": y}})
    assert len(solved.solves) == 4
    for number, report in enumerate(solved.solves):
        raw = by_hand(report, "t")[:, 0] / 1e-2
        assert means(solved, "t", number) == {"row": (pytest.approx(np.sqrt(np.mean(raw**2)), rel=1e-12), "cm")}


def test_each_kind_of_thing_has_its_unit() -> None:
    text = """
    (problem kinds
      (data sights (table (r b) (5.01 36) (5.02 37.5) (4.98 36.2)) :columns ((r :unit m) (b :unit deg)))
      (data odometry (table (x y q) (1 2 0.1) (1.2 2.1 0.12)) :columns ((x :unit cm) (y :unit cm)))
      (unknowns (p (vector 2) :init [4 3]) (T (pose 2)) (h :init 1) (w :init 0))
      (observe sights (= [r b] [(norm p) (atan2 (p 2) (p 1))]) :sigma [1cm 1deg])
      (observe odometry (= (pose2 x y q) T) :sigma [0.1 0.01 0.01])
      (observe plain (= 3.1 h) (= 2.9 h) :sigma 0.1)
      (observe pixel (= 7 w) :sigma 0.5px)
      (observe length (- (norm p) 4.9m) :sigma 1m))"""
    solved = mbm.loads(text).solve()
    written = solved.document()["solves"][0]["residuals"]
    units = {
        name: [(each["per"], each["unit"]) for each in listed(entry["rms_unit"])] for name, entry in written.items()
    }
    assert units == {
        "sights": [("coordinate 1", "m"), ("coordinate 2", "deg")],
        "odometry": [
            ("coordinate 1", "rad"),
            ("coordinates 2-3", "cm"),
            ("coordinate 2", "cm"),
            ("coordinate 3", "cm"),
        ],
        "plain": [("row", None), ("row", None)],
        "pixel": [("row", "px")],
        "length": [("row", "m")],
    }
    assert [each["equation"] for each in written["plain"]["rms_unit"]] == [1, 2]
    moved = by_hand(solved.first, "odometry")[:, 1:] / 1e-2
    length = np.sqrt(np.square(moved).sum(axis=1).mean())
    assert means(solved, "odometry")["coordinates 2-3"] == (pytest.approx(length, rel=1e-12), "cm")


def test_cases_of_one_clause_may_have_their_own_units() -> None:
    text = """
    (problem mixed
      (data t (table (what r b) ("range" 5.2 0) ("angle" 0 0.6) ("range" 5.0 0)))
      (unknowns (p (vector 2) :init [4 3] :unit m))
      (observe t (cond ((= what "range") (= r (norm p))) (else (= b (atan2 (p 2) (p 1))))) :sigma 0.1))"""
    solved = mbm.loads(text).solve()
    (entries,) = [each["rms_unit"] for each in solved.document()["solves"][0]["residuals"].values()]
    assert [(each["per"], each["unit"]) for each in entries] == [("row", "m"), ("row", "rad")]


def test_the_table_names_what_the_means_are_over() -> None:
    shown = str(mbm.load(CALIBRATION / "calibration.mbm").solve())
    assert re.search(
        r"`corners`: 175 rows, rms 0\.943, raw 0\.194 px per point, 0\.137 px per coordinate$", shown, re.M
    )
    text = "(problem one (unknowns (a :init 1 :unit m)) (observe o (= 2m a) (= 2.2m a) :sigma 0.1m))"
    assert "rms 1, raw 0.1 m, 0.1 m" in str(mbm.loads(text).solve())


def test_where_nothing_counts_nothing_is_said() -> None:
    text = """
    (problem none (data t (table (x ok) (1 0) (2 0))) (unknowns (a :init 1))
      (observe t (= x a) :sigma 1 :when (> ok 0)) (observe b (= 1 a) :sigma 1))"""
    solved = mbm.loads(text).solve()
    assert solved.document()["solves"][0]["residuals"]["t"]["rms_unit"] == []
