"""``mbm solve``: what it hands to the API, what it writes, and how it ends."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mbm.cli.main import run
from mbm.report.options import Backend, SolveOptions
from mbm.report.types import Result, SolveStatus
from mbm.text.types import Diagnostic, MbmError, Severity

Run = Callable[..., Any]


def test_prints_the_table_and_ends_with_0(mbm: Run, api: Any) -> None:
    outcome = mbm("solve", "desk.mbm")
    assert outcome.status == 0
    assert "h  0.7500 ± 0.0020  m" in outcome.out
    assert outcome.err == ""


@pytest.mark.parametrize("status", [SolveStatus.NOT_CONVERGED, SolveStatus.UNOBSERVABLE])
def test_an_answer_that_needs_attention_ends_with_1_and_is_written(
    status: SolveStatus, mbm: Run, api: Any, result_of: Callable[..., Result], tmp_path: Path
) -> None:
    api.answers["solve_file"] = result_of(status)
    path = tmp_path / "result.json"
    outcome = mbm("solve", "desk.mbm", "--json", path)
    assert outcome.status == 1
    assert status in outcome.out
    assert json.loads(path.read_text())["status"] == "attention"


def test_options_reach_the_api(mbm: Run, api: Any, tmp_path: Path) -> None:
    start = tmp_path / "start.json"
    start.write_text('{"p": [1, 2]}')
    outcome = mbm(
        *("solve", "desk.mbm", "--problem", "desk", "--set", "h=70cm", "--set", "x = -3", "--data", "d=today.csv"),
        *("--init", start, "--seed", 7, "--method", "dogleg", "--backend", "numpy", "--workers", 2),
        *("--sandbox", "here", "--covariance", "full"),
    )
    assert outcome.status == 0
    ((name, (path, options), _named),) = api.calls
    assert name == "solve_file"
    assert path == Path("desk.mbm")
    assert isinstance(options, SolveOptions)
    assert options.problem == "desk"
    assert options.set == (("h", "70cm"), ("x", "-3"))
    assert options.data == {"d": Path("today.csv")}
    assert options.init == {"p": [1, 2]}
    assert (options.seed, options.method, options.backend, options.workers) == (7, "dogleg", Backend.NUMPY, 2)
    assert options.sandbox == Path("here")
    assert options.covariance_full is True


def test_json_to_standard_output_is_nothing_but_json(mbm: Run, api: Any) -> None:
    outcome = mbm("solve", "desk.mbm", "--json", "-")
    document = json.loads(outcome.out)
    assert document["solves"][0]["estimates"]["h"] == {"value": 0.75, "sigma": 0.002, "unit": "m"}


def test_files(mbm: Run, api: Any, tmp_path: Path) -> None:
    paths = {name: tmp_path / name for name in ("solves.csv", "residuals.csv", "plot.svg")}
    outcome = mbm(
        *("solve", "desk.mbm", "--csv", paths["solves.csv"]),
        *("--residuals", paths["residuals.csv"], "--plot", paths["plot.svg"]),
    )
    assert outcome.status == 0
    (row,) = csv.DictReader(paths["solves.csv"].read_text().splitlines())
    assert row["h"] == "0.75"
    (residual,) = csv.DictReader(paths["residuals.csv"].read_text().splitlines())
    assert residual["clause"] == "d"
    assert "<svg" in paths["plot.svg"].read_text()


def test_a_fault_of_the_problem_is_said_with_its_place(
    mbm: Run, api: Any, diagnostic_of: Callable[..., Diagnostic]
) -> None:
    api.answers["solve_file"] = MbmError(diagnostic_of(), diagnostic_of())
    outcome = mbm("solve", "desk.mbm")
    assert outcome.status == 2
    assert outcome.out == ""
    assert outcome.err.count("error[unknown-name]: `rotat` is not a function here") == 2
    assert "--> desk.mbm:1:9" in outcome.err


@pytest.mark.parametrize("spelling", [("--json", "-"), ("--json=-",)])
def test_faults_as_json(
    spelling: tuple[str, ...], mbm: Run, api: Any, diagnostic_of: Callable[..., Diagnostic]
) -> None:
    api.answers["solve_file"] = MbmError(diagnostic_of())
    outcome = mbm("solve", "desk.mbm", *spelling)
    assert outcome.status == 2
    assert json.loads(outcome.out) == {
        "diagnostics": [
            {
                "severity": "error",
                "code": "unknown-name",
                "message": "`rotat` is not a function here",
                "file": "desk.mbm",
                "line": 1,
                "column": 9,
                "length": 5,
                "hint": "did you mean `rotate`?",
            }
        ]
    }


def test_faults_as_json_in_a_file(mbm: Run, api: Any, diagnostic_of: Callable[..., Diagnostic], tmp_path: Path) -> None:
    api.answers["solve_file"] = MbmError(diagnostic_of())
    path = tmp_path / "result.json"
    assert mbm("solve", "desk.mbm", "--json", path).status == 2
    assert json.loads(path.read_text())["diagnostics"][0]["code"] == "unknown-name"


def test_warnings_go_to_standard_error_unless_quiet(
    mbm: Run, api: Any, result_of: Callable[..., Result], diagnostic_of: Callable[..., Diagnostic]
) -> None:
    api.answers["solve_file"] = result_of(diagnostics=(diagnostic_of(Severity.WARNING),))
    assert "warning[unknown-name]" in mbm("solve", "desk.mbm").err
    assert mbm("solve", "desk.mbm", "-q").err == ""
    assert mbm("-q", "solve", "desk.mbm").err == ""


def test_quiet_prints_one_line(mbm: Run, tmp_path: Path) -> None:
    path = tmp_path / "p.mbm"
    path.write_text(
        "(problem p (data d (table (k y) (1 2) (1 4) (2 3)))\n  (unknowns (a)) (observe d (= y a) :sigma 1))"
    )
    assert mbm("-q", "solve", path).out == f"{path}: problem `p`: converged\n"
    path.write_text(path.read_text()[:-1] + "(for-each k))")
    assert mbm("-q", "solve", path).out == f"{path}: problem `p`: 2 solves: 2 converged\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--set", "h"), "--set wants NAME=VALUE"),
        (("--set", "=3"), "--set wants NAME=VALUE"),
        (("--data", "a=1", "--data", "a=2"), "names `a` twice"),
        (("--workers", "0"), "invalid value for '--workers'"),
        (("--backend", "gpu"), "invalid value for '--backend'"),
        (("--json", "no/such/folder/x.json"), "its folder does not exist"),
        (("--init", "no-such.json"), "`no-such.json` does not exist"),
        (("--starts", "0"), "invalid value for '--starts'"),
        (("--overlay", "o.txt"), "error[plot-format]"),
        (("--scheduler", "tcp://a"), "`--scheduler` is not available yet"),
        (("--nonsense",), "no such option"),
    ],
)
def test_wrong_calls_end_with_2(arguments: tuple[str, ...], words: str, mbm: Run, api: Any) -> None:
    outcome = mbm("solve", "desk.mbm", *arguments)
    assert outcome.status == 2
    assert words in outcome.err
    assert api.calls == []


def test_a_plot_of_unknown_format_leaves_the_other_files(mbm: Run, api: Any, tmp_path: Path) -> None:
    outcome = mbm("solve", "desk.mbm", "--csv", tmp_path / "a.csv", "--plot", tmp_path / "a.doc")
    assert outcome.status == 2
    assert "error[plot-format]" in outcome.err


def test_initial_values_must_be_json(mbm: Run, api: Any, tmp_path: Path) -> None:
    path = tmp_path / "start.json"
    path.write_text('{"p": [1,\n 2')
    outcome = mbm("solve", "desk.mbm", "--init", path)
    assert outcome.status == 2
    assert "error[bad-json]" in outcome.err
    assert "line 2" in outcome.err
    path.write_text("[1, 2]")
    assert mbm("solve", "desk.mbm", "--init", path).status == 2


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_a_result_with_numbers_that_json_does_not_have_may_be_a_start(number, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "p.mbm").write_text("(problem p (unknowns (a :init 1)) (observe (= 2 a) :sigma 1))")
    (tmp_path / "r.json").write_text(
        f'{{"solves": [{{"key": {{}}, "cost": {number}, "estimates": {{"a": {{"value": 3}}}}}}]}}'
    )
    status = run(["solve", "p.mbm", "--init", "r.json", "--backend", "numpy", "--json", "-"])
    said = capfd.readouterr()
    assert (status, said.err) == (0, "")
    assert '"sha256"' in said.out
