"""Slips on the command line: no problem, no measurement and no earlier result is lost by any of them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import mbm as package
from mbm.cli.main import run
from mbm.text.types import MbmError

Run = Callable[..., Any]

PROBLEM = """(use "parts.mbm")
(problem p
  (data d (csv "d.csv"))
  (data e (json "e.json"))
  (unknowns (a :init 0))
  (observe d (= y (twice a)) :sigma 1)
  (observe e (= z a) :sigma 1))
"""
QUICK = ("--backend", "numpy")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A problem with what it reads, by several names, and files of somebody."""
    place = tmp_path / "site"
    place.mkdir()
    monkeypatch.chdir(place)
    (place / "p.mbm").write_text(PROBLEM)
    (place / "parts.mbm").write_text("(defun twice (x) (* 2 x))\n")
    (place / "d.csv").write_text("y\n1\n2\n3\n")
    (place / "o.csv").write_text("y\n1\n2\n4\n")
    (place / "e.json").write_text('{"z": [1, 2]}')
    (place / "parts.txt").write_text("(defun twice (x) (* 2 x))\n")
    (place / "q.mbm").write_text(PROBLEM.replace("parts.mbm", "parts.txt"))
    (place / "wrong.mbm").write_text("(problem")
    (place / "notes.json").write_text('{"diagnostics": [1, 2]}')
    (place / "alike.json").write_text('{"mbm": [1], "status": [2], "solves": [3]}')
    (place / "empty").write_text("")
    (place / "link.csv").symlink_to("d.csv")
    (place / "hard.csv").hardlink_to(place / "d.csv")
    return place


def content(folder: Path) -> dict[str, object]:
    return {
        path.relative_to(folder).as_posix(): (path.is_symlink(), path.read_bytes())
        for path in folder.rglob("*")
        if path.is_file()
    }


DESTROYING: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    # what is said, and the call
    ("something else than a document", "bad-call", ("solve", "--json", "e.json")),
    ("is a problem file", "bad-call", ("solve", "--json", "p.mbm")),
    ("is a problem file", "bad-call", ("solve", "--json=p.mbm")),
    ("something else than a document", "bad-call", ("slove", "p.mbm", "--json", "d.csv")),
    ("something else than a document", "bad-call", ("solve", "p.mbm", "--oops", "--json", "d.csv")),
    ("a file that this call is about", "bad-call", ("solve", "p.mbm", "--oops", "--data=d=d.csv", "--json", "d.csv")),
    ("", "bad-call", ("solve", "--csv", "p.mbm")),
    ("is a problem file", "would-overwrite", ("solve", "wrong.mbm", "--json", "p.mbm")),
    ("something else than a document", "unclosed-bracket", ("solve", "wrong.mbm", "--json", "notes.json")),
    ("something else than a document", "unclosed-bracket", ("solve", "wrong.mbm", "--json", "alike.json")),
    ("something else than a document", "unclosed-bracket", ("solve", "wrong.mbm", "--json", "link.csv")),
    ("something else than a document", "would-overwrite", ("check", "p.mbm", "--json", "d.csv")),
    ("something else than a document", "would-overwrite", ("check", "wrong.mbm", "--json", "notes.json")),
    ("is a problem file", "would-overwrite", ("check", "p.mbm", "--json", "parts.mbm")),
    ("is a problem file", "would-overwrite", ("cache", "--json", "p.mbm")),
    ("something else than a document", "would-overwrite", ("cache", "clear", "--json", "d.csv")),
    ("is the problem itself", "would-overwrite", ("solve", "p.mbm", "--json", "p.mbm")),
    ("is a problem file", "would-overwrite", ("solve", "p.mbm", "--csv", "wrong.mbm")),
    ("is the problem itself", "would-overwrite", ("solve", "p.mbm", "--residuals", "./p.mbm")),
    ("is a problem file", "would-overwrite", ("solve", "p.mbm", "--json", "parts.mbm")),
    ("a file that the problem reads", "would-overwrite", ("solve", "q.mbm", "--json", "parts.txt")),
    ("is the file that table `d` reads", "would-overwrite", ("solve", "p.mbm", "--csv", "d.csv")),
    ("`d.csv`, the file that table `d` reads", "would-overwrite", ("solve", "p.mbm", "--csv", "link.csv")),
    ("`d.csv`, the file that table `d` reads", "would-overwrite", ("solve", "p.mbm", "--residuals", "hard.csv")),
    ("`d.csv`, the file that table `d` reads", "would-overwrite", ("solve", "p.mbm", "--csv", "../site/d.csv")),
    ("is the file that table `d` reads", "would-overwrite", ("solve", "p.mbm", "--data", "d=o.csv", "--csv", "o.csv")),
    ("is the file that table `d` reads", "would-overwrite", ("solve", "p.mbm", "--data", "d=o.csv", "--csv", "d.csv")),
    ("the file that table `e` reads", "would-overwrite", ("solve", "p.mbm", "--json", "e.json")),
    (
        "`d.csv`, the file that table `d`",
        "would-overwrite",
        ("solve", "p.mbm", "--csv", "./link.csv", "--residuals", "x"),
    ),
    ("two outputs go to one file", "would-overwrite", ("solve", "p.mbm", "--residuals", "x", "--csv", "./x")),
    ("it is a folder", "not-writable", ("solve", "p.mbm", "--json", ".")),
    ("its name is empty", "not-writable", ("solve", "p.mbm", "--json", "")),
    ("its name is empty", "not-writable", ("check", "p.mbm", "--json", "")),
    ("its folder does not exist", "not-writable", ("solve", "p.mbm", "--residuals", "none/r.csv")),
    ("names no picture format", "plot-format", ("solve", "p.mbm", "--csv", "new.csv", "--plot", "d.csv")),
    ("`start.json` is the file of `--init`", "would-overwrite", ("solve", "p.mbm", "--csv", "start.json")),
    ("it holds the problem", "not-writable", ("compile", "p.mbm", "--target", "c", "-o", ".")),
    ("it holds the problem", "not-writable", ("compile", "p.mbm", "--target", "c", "-o", ".", "--force")),
    ("it holds the problem", "not-writable", ("simulate", "p.mbm", "-o", ".", "--force")),
    ("it is no folder", "not-writable", ("simulate", "p.mbm", "-o", "d.csv", "--force")),
    ("", "exists-already", ("new", "d.csv")),
    ("", "exists-already", ("new", "../site")),
)


@pytest.mark.parametrize(("said", "code", "call"), DESTROYING, ids=[" ".join(call) for _, _, call in DESTROYING])
def test_nothing_is_lost(said: str, code: str, call: tuple[str, ...], folder: Path, mbm: Run) -> None:
    (folder / "start.json").write_text('{"a": 1}')
    if "start.json" in call:
        call = (*call, "--init", "start.json")
    before = content(folder)
    outcome = mbm(*call)
    assert outcome.status == 2
    assert content(folder) == before
    assert code in outcome.err
    assert said in " ".join(outcome.err.split())
    assert outcome.err.count("would-overwrite") <= 1


def test_an_hour_of_work_is_not_done_first(folder: Path, mbm: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    from mbm.api.compiled import CompiledProblem

    monkeypatch.setattr(CompiledProblem, "result", lambda *_: pytest.fail("it was solved"))
    assert "table `d` reads" in mbm("solve", "p.mbm", *QUICK, "--csv", "link.csv").err


def test_a_document_may_take_the_place_of_the_one_it_began_from(folder: Path, mbm: Run) -> None:
    assert mbm("solve", "p.mbm", *QUICK, "--json", "r.json").status == 0
    first = json.loads((folder / "r.json").read_bytes())
    assert mbm("solve", "p.mbm", *QUICK, "--init", "r.json", "--json", "./r.json").status == 0
    second = json.loads((folder / "r.json").read_bytes())
    assert second["solves"][0]["estimates"] == first["solves"][0]["estimates"]
    assert second["options"]["init"]
    before = content(folder)
    assert "the file of `--init`" in mbm("solve", "p.mbm", *QUICK, "--init", "r.json", "--csv", "r.json").err
    for call in (("wrong.mbm",), ("p.mbm", "--set", "zzz=1"), ("p.mbm", "--oops")):
        assert mbm("solve", *call, "--init", "r.json", "--json", "r.json").status == 2
        assert content(folder) == before, "a call that went wrong took the values that it was to begin from"


def test_diagnostics_replace_documents_of_mbm_and_fill_what_is_empty(folder: Path, mbm: Run) -> None:
    assert mbm("solve", "p.mbm", *QUICK, "--json", "r.json").status == 0
    for name in ("r.json", "r.json", "empty", "new.json"):
        assert mbm("solve", "wrong.mbm", "--json", name).status == 2
        (found,) = json.loads((folder / name).read_bytes())["diagnostics"]
        assert found["code"] == "unclosed-bracket"
    assert mbm("check", "p.mbm", "--json", "r.json").status == 0
    assert json.loads((folder / "r.json").read_bytes()) == {"diagnostics": []}
    assert mbm("solve", "p.mbm", *QUICK, "--json", "r.json").status == 0
    assert json.loads((folder / "r.json").read_bytes())["status"] == "ok"


def test_a_document_that_the_problem_reads_is_not_replaced_by_diagnostics(folder: Path, mbm: Run) -> None:
    assert mbm("solve", "p.mbm", *QUICK, "--json", "r.json").status == 0
    (folder / "q.mbm").write_text('(problem q (data d (json "r.json")) (unknowns (a)) (observe d (= y a) :sigma 1))')
    before = content(folder)
    for command in ("solve", "check"):
        outcome = mbm(command, "q.mbm", "--json", "r.json")
        assert outcome.status == 2
        assert "is the file that table `d` reads" in outcome.err
        assert content(folder) == before


def test_what_can_be_written_is_written_and_the_table_said(folder: Path, mbm: Run) -> None:
    """The disk was full for one of them: the others, which took as long, are there."""
    outcome = mbm("solve", "p.mbm", *QUICK, "--csv", "/dev/full", "--json", "r.json", "--residuals", "res.csv")
    assert outcome.status == 2
    assert "`/dev/full` cannot be written: No space left on device" in outcome.err
    assert json.loads((folder / "r.json").read_bytes())["status"] == "ok"
    assert len((folder / "res.csv").read_text().splitlines()) == 6
    assert "converged" in outcome.out


def test_standard_output_by_its_name(folder: Path, mbm: Run) -> None:
    outcome = mbm("solve", "p.mbm", *QUICK, "--csv", "/dev/fd/1")
    assert outcome.status == 0
    assert outcome.out.startswith("status,cost,dof")
    assert "converged" in outcome.out


@pytest.mark.parametrize("name", ["a\nb.json", "\udcff.json", "\x1b[31m.json"])
def test_odd_names_are_written_and_never_shown_as_they_are(name: str, folder: Path, mbm: Run) -> None:
    assert mbm("solve", "p.mbm", *QUICK, "--json", name).status == 0
    assert json.loads((folder / name).read_bytes())["status"] == "ok"
    assert mbm("solve", "wrong.mbm", "--json", name).status == 2
    (folder / name).write_text("somebody's")
    said = mbm("solve", "wrong.mbm", "--json", name).err
    assert "would-overwrite" in said
    assert name not in said


def test_fmt_lays_out_what_a_link_leads_to_and_keeps_its_mode(folder: Path, mbm: Run) -> None:
    ugly = "(defun   f (x)\n x )\n"
    (folder / "real.mbm").write_text(ugly)
    (folder / "real.mbm").chmod(0o640)
    (folder / "a.mbm").symlink_to("real.mbm")
    (folder / "backup.mbm").hardlink_to(folder / "real.mbm")
    assert mbm("fmt", "a.mbm").status == 0
    assert (folder / "a.mbm").is_symlink()
    assert (folder / "real.mbm").read_text() == "(defun f (x)\n  x)\n"
    assert (folder / "real.mbm").stat().st_mode & 0o777 == 0o640
    assert (folder / "backup.mbm").read_text() == ugly


@pytest.mark.parametrize("text", ["x y\n1   2\n", "x\n1\n2 \n", "1 2 (3)\n4 5 6\n"])
def test_fmt_lays_out_no_tables(text: str, folder: Path, mbm: Run) -> None:
    """``mbm fmt *``: rows would be torn apart."""
    (folder / "d.csv").write_text(text)
    (folder / "link.mbm").symlink_to("d.csv")
    for name in ("d.csv", "link.mbm"):
        outcome = mbm("fmt", name)
        assert outcome.status == 2
        assert "only definitions and problems may stand at top level" in outcome.err
        assert (folder / "d.csv").read_text() == text
    (folder / "models").write_text("(defun   f (x)\n x )\n")
    assert mbm("fmt", "models").status == 0
    assert (folder / "models").read_text() == "(defun f (x)\n  x)\n"


def test_fmt_writes_no_stream_and_nothing_that_is_read_only(folder: Path, mbm: Run) -> None:
    ugly = "(defun   f (x)\n x )\n; more\n"
    path = folder / "a.mbm"
    path.write_text(ugly)
    with path.open("r+b") as stream:
        outcome = mbm("fmt", f"/dev/fd/{stream.fileno()}")
    assert (outcome.status, path.read_text()) == (2, ugly)
    path.chmod(0o444)
    outcome = mbm("fmt", path)
    assert (outcome.status, path.read_text()) == (2, ugly)
    assert "it is read-only" in outcome.err
    assert mbm("fmt", "--check", path).status == 1


def test_an_interrupted_write_leaves_the_source(folder: Path, mbm: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    from mbm.files import writing

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    (folder / "a.mbm").write_text("(defun   f (x)\n x )\n")
    before = content(folder)
    monkeypatch.setattr(writing, "_synchronise", interrupt)
    assert mbm("fmt", "a.mbm").status == 130
    assert content(folder) == before


def test_in_python_a_result_is_never_written_onto_what_it_was_made_from(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "e.json").write_text('{"z": [1.5]}')
    for _ in ("cold", "warm"):
        monkeypatch.chdir(folder)
        problem = package.load("p.mbm")
        compiled = problem.compile(backend="numpy")
        monkeypatch.chdir(tmp_path)
        before = content(folder)
        for result in (compiled.solve(), compiled.solve(data={"d": {"y": [1.0, 2.0]}})):
            for name in ("p.mbm", "parts.mbm", "d.csv", "e.json", "hard.csv", "link.csv"):
                for write in (result.to_json, result.plot):
                    if write == result.plot:
                        pytest.importorskip("matplotlib")
                    (tmp_path / "x.svg").unlink(missing_ok=True)
                    (tmp_path / "x.svg").symlink_to(folder / name)
                    with pytest.raises(MbmError, match="would-overwrite"):
                        write(tmp_path / "x.svg")
            assert content(folder) == before
            (tmp_path / "x.svg").unlink()
            result.to_json(tmp_path / "x.svg")
            with pytest.raises(MbmError, match="not-writable"):
                result.to_json(tmp_path / "none" / "x.json")


def test_folders_of_simulations_may_be_written_again_until_somebody_changes_them(folder: Path, mbm: Run) -> None:
    out = folder / "out"
    for seed in (1, 2):
        assert mbm("simulate", "p.mbm", "-o", "out", "--seed", seed).status == 0
    (out / "plot.png").write_bytes(b"somebody's")
    assert mbm("simulate", "p.mbm", "-o", "out").status == 0
    (out / "d.csv").write_text("y\n5\n6\n7\n")
    before = content(folder)
    outcome = mbm("simulate", "p.mbm", "-o", "out")
    assert outcome.status == 2
    assert "`out/d.csv` was changed since `mbm simulate` wrote it" in outcome.err
    assert "foreign-folder" in mbm("compile", "p.mbm", "--target", "casadi", "-o", "out").err
    assert "the file that table `d` reads" in mbm("simulate", "p.mbm", "--data", "d=out/d.csv", "-o", "out").err
    forced = mbm("simulate", "p.mbm", "--data", "d=out/d.csv", "-o", "out", "--force")
    assert "the file that table `d` reads" in forced.err
    assert content(folder) == before
    assert mbm("simulate", "p.mbm", "-o", "out", "--force").status == 0
    assert (out / "plot.png").read_bytes() == b"somebody's"


def test_real_measurements_behind_links_are_safe(folder: Path, mbm: Run) -> None:
    out = folder / "out"
    assert mbm("simulate", "p.mbm", "-o", "out").status == 0
    (out / "d.csv").unlink()
    (out / "d.csv").symlink_to("../d.csv")
    (folder / "away").symlink_to(folder / "out")
    before = content(folder)
    for target in ("out", "away"):
        for force in ((), ("--force",)):
            outcome = mbm("simulate", "p.mbm", "-o", target, *force)
            assert outcome.status == 2
            assert "symbolic link" in outcome.err
    assert content(folder) == before


def test_a_full_disk_leaves_earlier_results_and_sources(folder: Path, mbm: Run) -> None:
    import resource

    (folder / "long.mbm").write_text("; comment\n" * 3000 + "(defun   f (x)\n x )\n")
    (folder / "r.json").write_text("{}")
    assert mbm("simulate", "p.mbm", "-o", "out").status == 0
    before = content(folder)
    bound = resource.getrlimit(resource.RLIMIT_FSIZE)
    for call in (
        ("fmt", "long.mbm"),
        ("solve", "p.mbm", *QUICK, "--json", "r.json"),
        ("simulate", "p.mbm", "-o", "out", "--seed", "3"),
        ("simulate", "p.mbm", "-o", "new"),
        ("new", "first"),
    ):
        resource.setrlimit(resource.RLIMIT_FSIZE, (60, bound[1]))
        try:
            status = run([str(each) for each in (*call, "-q")])
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, bound)
        assert status == 2, call
        assert content(folder) == before
    assert {path.name for path in folder.iterdir()} == {name.split("/")[0] for name in before}


@pytest.mark.parametrize(
    ("command", "option"),
    [
        *(("solve", each) for each in ("--csv", "--estimates", "--residuals", "--plot", "--overlay", "--write g2o")),
        *(("propagate", "--samples"), ("report", "-o"), ("view", "-o"), ("simulate", "-o"), ("budget", "--plot")),
        ("compile", "--target python -o"),
        *(("budget", each) for each in ("--csv", "--latex")),
        ("design", "--csv"),
        ("trajectory", "--csv"),
    ],
)
def test_only_the_document_goes_to_standard_output(
    folder: Path, command: str, option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = content(folder)
    assert run([command, "p.mbm", *option.split(), "-"]) == 2
    said = capsys.readouterr()
    assert "only `--json -` goes to standard output" in said.err
    assert "name a file" in said.err
    assert not said.out
    assert content(folder) == before
