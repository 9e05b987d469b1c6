"""``mbm simulate``: a folder that can be solved, with files as the problem has them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import mbm
from mbm.cli.main import run

PROBLEM = """(use "lib/models.mbm")
(use "../outside.mbm")
(problem site  ; where a tag is
  (data stations (csv "in/stations.csv") :key name :columns ((x :unit mm) (y :unit mm)))
  (data ranges (json "ranges.json") :columns ((dist range :unit mm)) :with (stations station))
  (data angles (tsv "../angles.tsv"))
  (data heights (table (h other) (1.2m 5) (1.3m 6)))
  (unknowns (p (vector 2) :init [1 2] :unit m) (z :init 1.25m))
  (observe ranges (= dist (shifted (distance p [stations.x stations.y]))) :sigma 2mm)
  (observe angles (= bearing (atan2 (p 2) (p 1))) :sigma (unknown 1mrad) :when (> use 0))
  (observe heights (= h (+ z (far 0m))) :sigma 1mm))
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    place = tmp_path / "site"
    (place / "in").mkdir(parents=True)
    (place / "lib").mkdir()
    (place / "site.mbm").write_text(PROBLEM)
    (place / "lib" / "models.mbm").write_text("(defun shifted (d) (+ d 1mm))\n")
    (tmp_path / "outside.mbm").write_text("(defun far (d) (* 2 d))\n")
    (place / "in" / "stations.csv").write_text('name,x,y,note\n"a, b",0,0,first\nc,4000,0,\nd,0,5000,NA\n')
    rows = [{"station": s, "range": 0} for s in ("a, b", "c", "d") * 3]
    (place / "ranges.json").write_text(json.dumps(rows))
    (tmp_path / "angles.tsv").write_text("bearing\tuse\n0\t1\n0.5\t0\n0\t1\n0\t1\n")
    (place / "values.json").write_text('{"p": [1.5, 2.5], "z": {"value": 1.3, "unit": "m"}}')
    return place


def simulate(folder: Path, *options: str, output: str = "out") -> Path:
    out = folder / output
    command = ["simulate", str(folder / "site.mbm"), "--at", str(folder / "values.json"), "-o", str(out), *options]
    assert run(command) == 0
    return out


def test_the_folder_holds_all_files_in_their_formats_and_units(folder: Path) -> None:
    out = simulate(folder)
    names = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert names == {
        "site.mbm", "lib/models.mbm", "outside.mbm", "in/stations.csv", "ranges.json", "angles.csv", "truth.json",
        ".mbm-simulate",
    }  # fmt: skip
    ranges = json.loads((out / "ranges.json").read_text())["range"]
    true = [1 + 1000 * np.hypot(x - 1.5, y - 2.5) for x, y in ((0, 0), (4, 0), (0, 5))] * 3
    np.testing.assert_allclose(ranges, true, atol=10)  # mm; five deviations
    copy = (out / "site.mbm").read_text()
    assert '(data angles (csv "angles.csv"))' in copy
    assert "; where a tag is" in copy
    assert (out / "angles.csv").read_text().splitlines()[2] == "0.5,0"  # a row that is not used


def test_inline_tables_are_changed_in_the_copy_in_their_units(folder: Path) -> None:
    copy = (simulate(folder) / "site.mbm").read_text()
    line = next(line for line in copy.splitlines() if "(data heights" in line)
    cells = line.replace(")", "").replace("(", "").split()[5:]
    assert [cell[-1] for cell in cells] == ["m", "5", "m", "6"]
    np.testing.assert_allclose([float(cells[0][:-1]), float(cells[2][:-1])], 1.3, atol=0.005)


def test_the_copy_solves_to_the_true_values(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = simulate(folder, "--noise", "angles=2", "--seed", "7")
    capsys.readouterr()
    assert run(["solve", str(out / "site.mbm"), "--init", str(out / "truth.json"), "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)["solves"][0]["estimates"]
    for name, true in (("p", [1.5, 2.5]), ("z", 1.3)):
        error = (np.array(found[name]["value"]) - true) / found[name]["sigma"]
        assert np.abs(error).max() < 5


def test_the_same_call_writes_the_same_bytes_and_python_the_same_numbers(folder: Path) -> None:
    first, second = simulate(folder), simulate(folder, output="again")
    for path in first.rglob("*.*"):
        assert path.read_bytes() == (second / path.relative_to(first)).read_bytes()
    at = json.loads((folder / "values.json").read_text())
    made = mbm.load(folder / "site.mbm").simulate(at=at)
    ranges = json.loads((first / "ranges.json").read_text())["range"]
    np.testing.assert_array_equal(made["ranges"]["range"], ranges)


def test_real_measurements_are_never_replaced(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["simulate", str(folder / "site.mbm"), "-o", str(folder)]) == 2
    assert "not-writable" in capsys.readouterr().err
    assert json.loads((folder / "ranges.json").read_text())[0]["range"] == 0


def test_wrong_calls(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, out = str(folder / "site.mbm"), ["-o", str(folder / "out")]
    for options, code in (
        (["--outliers", "2", "5"], "bad-call"),
        (["--noise", "angles=fast"], "bad-initial-value"),
        (["--noise", "zzz=1"], "unknown-observation"),
        (["--measured", "zzz=a,b"], "unknown-observation"),
        (["--at", str(folder / "nothing.json")], "missing-file"),
        (["--set", "zzz=1"], "unknown-override"),
    ):
        assert run(["simulate", file, *out, *options]) == 2
        assert code in capsys.readouterr().err
    assert not (folder / "out").exists()


def test_a_table_given_by_path_is_written_where_the_problem_looks_for_it(folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.csv"
    other.write_text("station,range\nc,1\nd,1\n")
    out = simulate(folder, "--data", f"ranges={other}")
    assert json.loads((out / "ranges.json").read_text())["station"] == ["c", "d"]


def test_pose_graphs_stay_pose_graphs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "square.g2o").write_text(
        "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 1.5\n# a comment\nEDGE_SE2 0 1 0 0 0 100 0 0 100 0 400\nFIX 0\n"
    )
    (tmp_path / "square.mbm").write_text("""(problem square
      (data nodes (g2o "square.g2o" :vertices))
      (data edges (g2o "square.g2o" :edges))
      (unknowns (T (pose 2) :per nodes :init (pose2 x y theta) :fixed (= fixed 1)))
      (observe edges (= (pose2 dx dy dtheta) (between (T from) (T to))) :information information))""")
    assert run(["simulate", str(tmp_path / "square.mbm"), "-o", str(tmp_path / "out"), "-q"]) == 0
    lines = (tmp_path / "out" / "square.g2o").read_text().splitlines()
    assert lines[:3] == (tmp_path / "square.g2o").read_text().splitlines()[:3]
    words = lines[3].split()
    assert words[:3] + words[6:] == ["EDGE_SE2", "0", "1", "100", "0", "0", "100", "0", "400"]
    np.testing.assert_allclose([float(w) for w in words[3:6]], [1, 0, 1.5], atol=0.5)  # five deviations of 0.1
    capsys.readouterr()
    assert run(["solve", str(tmp_path / "out" / "square.mbm"), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["solves"][0]["cost"] < 1e-12  # one edge, one free pose


def test_formats_that_cannot_be_written_become_csv_with_their_keys(tmp_path: Path) -> None:
    camera = "\n".join(["0"] * 6 + ["100", "0", "0"])
    (tmp_path / "scene.txt").write_text(f"1 1 1\n0 0 0.0 0.0\n{camera}\n1\n2\n-10\n")
    (tmp_path / "scene.mbm").write_text("""(problem scene
      (data cameras (bal "scene.txt" :cameras))
      (data points (bal "scene.txt" :points))
      (data seen (bal "scene.txt" :observations) :with (cameras camera))
      (unknowns (p (vector 3) :per points :init [x y z] :fixed [false false true]))
      (observe seen (= [u v] (* (/ cameras.f -10) [((p point) 1) ((p point) 2)])) :sigma 0.1))""")
    assert run(["simulate", str(tmp_path / "scene.mbm"), "-o", str(tmp_path / "out"), "-q"]) == 0
    assert '(data points (csv "points.csv") :key "point")' in (tmp_path / "out" / "scene.mbm").read_text()
    header, row = (tmp_path / "out" / "seen.csv").read_text().splitlines()
    found = dict(zip(header.split(","), map(float, row.split(",")), strict=True))
    np.testing.assert_allclose([found["u"], found["v"]], [-10, -20], atol=0.5)  # five deviations
    assert run(["solve", str(tmp_path / "out" / "scene.mbm"), "-q"]) == 0


def test_a_used_file_of_any_name_is_found_again_by_the_copy(tmp_path: Path) -> None:
    """The name is a text of the language, which has four escapes only: those of JSON mean nothing there."""
    name = 'models \x1b[2J\x7f\u202e "q" \\ \n\t.mbm'
    written = name.replace("\\", "\\\\").replace('"', '\\"')
    (tmp_path / name).write_text("(defun twice (d) (* 2 d))\n", encoding="utf-8")
    place = tmp_path / "site"
    place.mkdir()
    (place / "site.mbm").write_text(
        f'(use "../{written}")\n(problem p (data d (table (x y) (1 2) (2 4))) (unknowns (a :init 1)) '
        "(observe d (= y (twice (* a x))) :sigma 1))\n",
        encoding="utf-8",
    )
    assert run(["simulate", str(place / "site.mbm"), "-o", str(place / "out"), "-q"]) == 0
    (copy,) = set((place / "out").glob("*.mbm")) - {place / "out" / "site.mbm"}
    assert copy.name.isprintable()
    assert "(defun twice" in copy.read_text(encoding="utf-8")
    assert run(["solve", str(place / "out" / "site.mbm"), "-q"]) == 0
