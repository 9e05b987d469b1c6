"""``mbm compile`` through the command line: which folders it writes to, and what stands in them."""

from __future__ import annotations

from pathlib import Path

import pytest

from mbm.cli.main import run

PROBLEM = """(problem mean "A mean."
  (data d (table (y) (1.5) (2.5)))
  (unknowns (m :init 0))
  (observe d (= y m) :sigma 1))
"""
FILES = {
    "c": {"mean.c", "mean.h", "main.c", "test.c", "Makefile", "CMakeLists.txt", "README.md", "reference.csv"},
    "python": {"mean.py", "test_mean.py", "README.md", "reference.csv"},
    "casadi": {"residuals.casadi", "d.casadi", "functions.json", "README.md", "test_functions.py"},
}


@pytest.fixture
def problem(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mean.mbm").write_text(PROBLEM, encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("target", FILES)
def test_every_target_writes_its_folder(problem, target, capsys):
    assert run(["compile", "mean.mbm", "--target", target, "-o", "solver"]) == 0
    assert {path.name for path in (problem / "solver").iterdir()} >= FILES[target]
    assert str(Path("solver") / "README.md") in capsys.readouterr().out


def test_its_own_folder_is_written_again(problem):
    for _ in range(2):
        assert run(["compile", "mean.mbm", "--target", "python", "-o", "solver"]) == 0


def test_a_foreign_folder_is_refused_without_force(problem, capsys):
    other = problem / "solver" / "thesis.tex"
    other.parent.mkdir()
    other.write_text("years of work", encoding="utf-8")
    assert run(["compile", "mean.mbm", "--target", "c", "-o", "solver"]) == 2
    assert "error[foreign-folder]" in capsys.readouterr().err
    assert [path.name for path in other.parent.iterdir()] == ["thesis.tex"]
    assert run(["compile", "mean.mbm", "--target", "c", "-o", "solver", "--force"]) == 0
    assert other.read_text(encoding="utf-8") == "years of work"


def test_what_is_written_is_the_same_each_time(problem):
    for folder in ("one", "two"):
        assert run(["compile", "mean.mbm", "--target", "c", "-o", folder]) == 0
    files = sorted(path.relative_to(problem / "one") for path in (problem / "one").rglob("*") if path.is_file())
    assert files
    for file in files:
        assert (problem / "one" / file).read_bytes() == (problem / "two" / file).read_bytes()


def test_a_target_must_be_named(problem, capsys):
    assert run(["compile", "mean.mbm", "-o", "solver"]) == 2
    said = capsys.readouterr().err
    assert "error[bad-call]" in said
    assert "choose from: c, python, casadi" in said.lower()
