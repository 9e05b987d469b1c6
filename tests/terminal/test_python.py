"""What Python shows of problems, results and errors, where their texts would do something to a terminal."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import pytest

import mbm
from mbm.cli.failure import report_failure
from mbm.cli.main import run
from mbm.files.journal import Journal
from mbm.report.answer import Solved
from mbm.text.types import Code, Diagnostic
from tests.terminal.hostile import HOSTILE, MARKS, NAME, objections, write


@pytest.fixture(params=[False, True], ids=["one", "many"])
def result(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Solved:
    monkeypatch.chdir(tmp_path)
    return mbm.load(write(tmp_path, "problem", many=request.param)).solve()


def test_results(result: Solved) -> None:
    for text in (str(result), repr(result), f"{result}", str(result.first), repr(result.first), result._repr_html_()):
        assert objections(text) == []
    assert repr(result).count("\n") == 0
    assert "1.50" in str(result)


def test_documents(result: Solved, tmp_path: Path) -> None:
    """The same document for a program: keys are what they are in the table."""
    text = result.to_json(tmp_path / "a.json")
    assert objections(text) == []
    assert objections((tmp_path / "a.json").read_text(encoding="utf-8")) == []
    solve = json.loads(text)["solves"][0]
    assert any(MARKS in str(key) for key in solve["key"].values()) == (len(result.solves) > 1)
    assert any(NAME in key for key in solve["estimates"]["offset"]["keys"])


def test_what_leads_to_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    problem = mbm.load(write(tmp_path, "problem"), sandbox=".").named(NAME)
    assert objections(repr(problem)) == []
    problem = mbm.load(write(tmp_path, "problem"))
    made = problem.compile()
    assert objections(repr(made)) == []
    assert objections(repr(made.estimator())) == []
    solved = made.solve()
    assert objections(repr(solved["offset"])) == []
    with pytest.raises(KeyError) as caught:
        solved[NAME]
    assert objections(str(caught.value)) == []
    assert all(objections(repr(row)) == [] for row in solved.first.rows())
    assert objections(repr(solved.first)) == []
    assert objections(repr(problem.simulate(at={"a": 1, "b": 2}).truth)) == []


def test_the_trace_of_a_fault_of_ours(capfd: pytest.CaptureFixture[str]) -> None:
    """Whatever the text of an unforeseen exception holds, which quotes what it stumbled upon."""
    try:
        raise ValueError(HOSTILE)
    except ValueError as fault:
        said = Diagnostic(code=Code("internal-fault", "A fault.", "Report it."), message=str(fault))
        report_failure((said,), ("solve", "-v"), Journal(), fault)
    err = capfd.readouterr().err
    assert "Traceback" in err
    assert {objection for objection in objections(err) if objection.startswith("U+")} == set()


@pytest.mark.parametrize("terminal", [False, True])
def test_a_source_laid_out_to_standard_output(
    terminal: bool, monkeypatch: pytest.MonkeyPatch, capsysbinary: pytest.CaptureFixture[bytes]
) -> None:
    """A program gets the source itself, with its comments; on a terminal it is shown as everything else is."""
    source = '; \x1b[2J\u202e\n(define a "\x9b31m")\n'
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(source.encode()), encoding="utf-8"))
    monkeypatch.setattr(sys.stdout, "isatty", lambda: terminal)
    assert run(("fmt", "-")) == 0
    out = capsysbinary.readouterr().out.decode()
    assert out == (source.translate(dict.fromkeys(map(ord, "\x1b\u202e\x9b"), "\ufffd")) if terminal else source)
