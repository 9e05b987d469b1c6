"""``mbm solve --write`` and ``--estimates``: which files are written, and what is left alone."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import pytest

import mbm
from mbm.cli.main import run
from mbm.report.exports import write_estimates

PROBLEM = """(problem walk
  (data fixes (table (t x y a) (0 0 0 0) (1 1 0 0.1) (2 2 0.1 0.2)) :key t)
  (unknowns (T (pose 2) :per fixes))
  (observe fixes (= (pose2 x y a) (T t)) :sigma 0.1))
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "walk.mbm").write_text(PROBLEM, encoding="utf-8")
    return tmp_path


def test_the_table_and_the_files_are_written(folder, capsys):
    assert run(["solve", "walk.mbm", "--write", "tum", "out"]) == 0
    assert "3 rows" in capsys.readouterr().out
    assert {path.name for path in (folder / "out").iterdir()} == {"T.tum", ".mbm-write"}
    first = (folder / "out" / "T.tum").read_text(encoding="utf-8").splitlines()[0].split()
    assert [float(cell) for cell in first] == pytest.approx([0, 0, 0, 0, 0, 0, 0, 1], abs=1e-12)
    assert run(["solve", "walk.mbm", "--write", "kitti", "out", "--quiet"]) == 0
    assert {path.name for path in (folder / "out").iterdir()} == {"T.txt", ".mbm-write"}


def test_other_things_are_kept(folder, capsys):
    other = folder / "out" / "notes.txt"
    other.parent.mkdir()
    other.write_text("years of work", encoding="utf-8")
    assert run(["solve", "walk.mbm", "--write", "tum", "out"]) == 2
    outcome = capsys.readouterr()
    assert "error[foreign-folder]: `out` holds files that `mbm solve --write` did not write" in outcome.err
    assert outcome.out == ""  # it is known before the work begins
    assert run(["solve", "walk.mbm", "--write", "tum", "out", "--force", "-q"]) == 0
    assert other.read_text(encoding="utf-8") == "years of work"
    (folder / "out" / "T.tum").write_text("mine", encoding="utf-8")
    assert run(["solve", "walk.mbm", "--write", "tum", "out", "-q"]) == 2
    assert (folder / "out" / "T.tum").read_text(encoding="utf-8") == "mine"


def test_several_formats_are_written(folder, capsys):
    assert run(["solve", "walk.mbm", "-q", "--write", "tum", "out", "--write", "kitti", "other"]) == 0
    assert {path.name for path in (folder / "out").iterdir()} == {"T.tum", ".mbm-write"}
    assert {path.name for path in (folder / "other").iterdir()} == {"T.txt", ".mbm-write"}
    (folder / "other" / "T.txt").write_text("mine", encoding="utf-8")
    capsys.readouterr()
    assert run(["solve", "walk.mbm", "-q", "--write", "kitti", "other", "--write", "tum", "third"]) == 2
    assert "error[would-overwrite]" in capsys.readouterr().err
    assert (folder / "third" / "T.tum").exists()  # what can be written is


@pytest.mark.parametrize("second", ["out", "./out", "third/../out", "link/out"])
def test_one_folder_for_two_formats_is_refused(folder, capsys, second):
    """The second would remove what the first wrote."""
    (folder / "third").mkdir()
    (folder / "link").symlink_to(".")
    assert run(["solve", "walk.mbm", "--write", "tum", "out", "--write", "kitti", second, "--force"]) == 2
    outcome = capsys.readouterr()
    assert "error[would-overwrite]: two outputs go to one folder, `out`" in outcome.err
    assert outcome.out == ""
    assert not (folder / "out").exists()


def test_a_folder_that_was_written_before_may_hold_notes(folder):
    """As a folder of `mbm compile`: the list in it says that it is ours, and what is not in the list stays."""
    assert run(["solve", "walk.mbm", "--write", "tum", "out", "-q"]) == 0
    (folder / "out" / "notes.txt").write_text("years of work", encoding="utf-8")
    assert run(["solve", "walk.mbm", "--write", "kitti", "out", "-q"]) == 0
    assert {path.name for path in (folder / "out").iterdir()} == {"T.txt", ".mbm-write", "notes.txt"}
    assert (folder / "out" / "notes.txt").read_text(encoding="utf-8") == "years of work"
    (folder / "out" / "T.tum").write_text("mine", encoding="utf-8")  # a name that would be needed is another matter
    assert run(["solve", "walk.mbm", "--write", "tum", "out", "-q"]) == 2
    assert (folder / "out" / "T.tum").read_text(encoding="utf-8") == "mine"


def test_links_and_the_folder_of_the_problem_are_refused(folder, capsys):
    (folder / "real").mkdir()
    (folder / "link").symlink_to("real")
    for target in ("link", "."):
        assert run(["solve", "walk.mbm", "--write", "tum", target, "--force"]) == 2
        assert "error[not-writable]" in capsys.readouterr().err
    assert sorted(path.name for path in folder.iterdir()) == ["link", "real", "walk.mbm"]


def test_what_cannot_be_written_is_said_beside_the_table(folder, capsys):
    assert run(["solve", "walk.mbm", "--write", "colmap", "out"]) == 2
    outcome = capsys.readouterr()
    assert (
        "error[format-needs]: the format `colmap` needs an observation `(= [u v] (project CAMERA POINT))`"
        in outcome.err
    )
    assert "3 rows" in outcome.out
    assert not (folder / "out").exists()
    assert run(["solve", "walk.mbm", "--write", "tumm", "out"]) == 2
    outcome = capsys.readouterr()
    assert "error[unknown-output]: `tumm` is no format to write" in outcome.err
    assert "did you mean `tum`?" in outcome.err
    assert outcome.out == ""


def rows_of(text: str) -> list[dict[str, str]]:
    stream = io.StringIO(newline="")
    write_estimates(mbm.loads(text).solve().result, stream)
    return list(csv.DictReader(io.StringIO(stream.getvalue())))


def test_estimates_have_a_row_each(folder):
    assert run(["solve", "walk.mbm", "--estimates", "e.csv", "--json", "e.json", "-q"]) == 0
    with (folder / "e.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 9
    assert [(row["name"], row["key"], row["component"]) for row in rows[3:5]] == [
        ("T", "1", "rot[1]"),
        ("T", "1", "trans[1]"),
    ]
    assert float(rows[4]["value"]) == pytest.approx(1)
    assert float(rows[4]["sigma"]) == pytest.approx(0.1)
    assert rows[4]["scalar"] == "T[1].trans[1]"


def test_keys_units_and_kinds_are_told():
    rows = rows_of("""
    (problem f (for-each key)
      (data d (table (key id x y) (1 "=a" 1 2) (1 b 3 4) (2 "=a" 5 6) (2 b 7 8)))
      (unknowns (p (vector 2) :per d.id :init [0 0] :unit cm) (a angle :init 90deg :unit deg :fixed true)
                (q :init 3 :in (0 1)))
      (observe d (= [x y] (p id)) :sigma 1cm) (observe (= 2 q) :sigma 1)
      (derive (s (norm (p "b")) :unit mm)))""")
    assert list(rows[0])[:2] == ["key.key", "name"]
    second = [row for row in rows if row["key.key"] == "2"]
    told = [tuple(row[name] for name in ("name", "key", "component", "unit", "kind")) for row in second]
    assert told == [
        ("p", "'=a", "[1]", "cm", "estimate"),
        ("p", "'=a", "[2]", "cm", "estimate"),
        ("p", "b", "[1]", "cm", "estimate"),
        ("p", "b", "[2]", "cm", "estimate"),
        ("a", "", "", "deg", "fixed"),
        ("q", "", "", "", "at-bound"),
        ("s", "", "", "mm", "derived"),
    ]
    assert [float(row["value"]) for row in second[:5]] == [500, 600, 700, 800, 90]
    assert (second[5]["value"], second[5]["sigma"]) == ("1.0", "")
    assert float(second[6]["value"]) == pytest.approx(1e3 * (7**2 + 8**2) ** 0.5)
