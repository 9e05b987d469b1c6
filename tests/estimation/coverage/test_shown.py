"""Intervals in documents, tables, CSV files and Python."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest

import mbm
from mbm.cli.main import run
from mbm.report.exports import write_estimates

TEXT = """
(problem shown
  (data d (table (x y) (0 1.0) (1 3.1) (2 4.9) (3 7.0)))
  (unknowns (a :unit mm) (b (vector 2)) (c :init 1) (k :init 2 :fixed true))
  (observe d (= y (+ (* 1 a) (* x (b 1)))) :sigma unknown)
  (constraints (normal (b 2) 0 1))
  (derive (f (+ a (* x (b 1))) :over d)))
"""


def test_documents_have_an_interval_for_each_number() -> None:
    solve = mbm.loads(TEXT).solve().document()["solves"][0]
    estimates, derived = solve["estimates"], solve["derived"]
    assert estimates["b"]["dof"] == [pytest.approx(2.0), None]
    assert np.shape(estimates["b"]["interval"]) == (2, 2)
    assert estimates["b"]["interval_kind"] == "t"
    nothing = {name: estimates["c"][name] for name in ("dof", "k", "U", "interval", "interval_kind")}
    assert set(nothing.values()) == {None}
    assert estimates["k"]["interval"] == [2.0, 2.0]
    assert estimates["k"]["U"] == 0.0
    for value, expanded, ends in zip(derived["f"]["value"], derived["f"]["U"], derived["f"]["interval"], strict=True):
        assert ends == pytest.approx([value - expanded, value + expanded])


def test_csv_files_have_the_intervals() -> None:
    found = mbm.loads(TEXT).solve()
    stream = io.StringIO(newline="")
    write_estimates(found.result, stream)
    rows = {row["scalar"]: row for row in csv.DictReader(io.StringIO(stream.getvalue()))}
    low, high = found["a"].interval()
    assert (float(rows["a"]["low"]), float(rows["a"]["high"])) == (low, high)
    assert float(rows["a"]["U"]) == float(found["a"].U)
    assert rows["b[2]"]["dof"] == ""
    assert [rows["c"][name] for name in ("dof", "k", "U", "low", "high", "interval_kind")] == [""] * 6


def test_the_table_shows_them_when_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "shown.mbm"
    file.write_text(TEXT, encoding="utf-8")
    run(["solve", str(file)])
    assert "95 % intervals" not in capsys.readouterr().out
    run(["solve", str(file), "--intervals"])
    out = capsys.readouterr().out
    assert "95 % intervals" in out
    line = next(each for each in out.splitlines() if each.startswith("  b[1]") and "…" in each)
    assert "k = 4.30" in line
    assert "dof = 2" in line


def test_python_refuses_levels_that_are_no_probabilities() -> None:
    found = mbm.loads(TEXT).solve()["a"]
    for level in (0.0, 1.0, 95.0, float("nan"), "95%", "0.95", [0.5, 0.95], True):
        with pytest.raises(ValueError, match="between 0 and 1"):
            found.interval(level)
