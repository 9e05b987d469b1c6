"""A family may have no member at all, or none in one of the solves of ``for-each``: every command has an answer."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from mbm.cli.main import run

UNKNOWNS = """(unused direction :per tags :init [0 0 1]) (b (vector 2) :per tags :init [1 1])
    (T (pose 2) :per tags START) (q (rotation 3) :per tags) (s :per tags :init 1)"""
PROBLEM = """(problem p
  (data tags (table (tag run) ROWS) :key tag)
  (data d (table (run r) (1 5.0) (1 4.0) (2 3.0)))
  (unknowns (m :init 0) UNKNOWNS)
  (observe t tags (= [2 3] (b tag)) :sigma 1)
  (observe tt tags (= (pose2 0 0 0) (T tag)) :sigma [1 1 1])
  (observe ttt tags (= (s tag) 2) :sigma 1)
  (observe tttt tags (= (euler 0 0 0.1) (q tag)) :sigma 1)
  (observe d (= r m) :sigma 1)
  (derive (twice (* 2 (s tag)) :over tags) (two (b tag) :over tags))
  CLAUSE)
"""
ROWS = {"in one solve only": "(1 1) (2 1)", "nowhere": ""}
CLAUSES = ["", "(solve :method dogleg)", "(solve :robust lmeds)", "(constraints (<= (s tag) 9 :over tags))"]


def text_of(rows: str, clause: str, *, start: str) -> str:
    filled = PROBLEM.replace("ROWS", ROWS[rows]).replace("UNKNOWNS", UNKNOWNS).replace("START", start)
    return filled.replace("CLAUSE", clause)


@pytest.mark.parametrize("clause", CLAUSES)
@pytest.mark.parametrize("rows", ROWS)
@pytest.mark.parametrize("each", ["", "(for-each run)"])
@pytest.mark.parametrize("backend", ["auto", "numpy"])
def test_solve(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], clause: str, rows: str, each: str, backend: str
) -> None:
    file = tmp_path / "p.mbm"
    file.write_text(text_of(rows, f"{clause} {each}", start=""))
    json_path, csv_path = tmp_path / "o.json", tmp_path / "o.csv"
    options = ("--backend", backend, "--json", str(json_path), "--csv", str(csv_path))
    status = run(["solve", str(file), *options, "--residuals", str(tmp_path / "r.csv")])
    assert status in (0, 1), capfd.readouterr().err
    document = json.loads(json_path.read_text())
    means = [solve["estimates"]["m"]["value"] for solve in document["solves"]]
    assert means == pytest.approx([4.5, 3.0] if each else [4.0], abs=1e-9)  # of the rows of `d`, whatever else
    last = document["solves"][-1]["estimates"]
    members = [1, 2] if rows == "in one solve only" and not each else []
    assert {name: last[name]["keys"] for name in ("b", "T", "q", "s")} == dict.fromkeys("bTqs", members)
    with csv_path.open(newline="") as stream:
        assert len(list(csv.DictReader(stream))) == len(document["solves"])


@pytest.mark.parametrize("rows", ROWS)
@pytest.mark.parametrize("each", ["", "(for-each run)"])
@pytest.mark.parametrize(
    "command",
    [
        ["check"],
        ["explain"],
        ["explain", "--latex"],
        ["simulate", "-o", "out"],
        ["compile", "--target", "c", "-o", "out"],
    ],
    ids=" ".join,
)
def test_other_commands(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    rows: str,
    each: str,
    command: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("p.mbm").write_text(text_of(rows, each, start=":init (pose2 0 0 0)"))
    status = run([command[0], "p.mbm", *command[1:]])
    said = capfd.readouterr().err
    assert status == 0 or "error[not-emitted]" in said or "error[no-true-value]" in said, said
