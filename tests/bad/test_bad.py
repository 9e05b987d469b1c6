"""Every diagnostic that a problem file or its data can produce, through the real command line.

Each ``<code>[-variant].mbm`` has an ``.expected`` beside it: the command, its exit status, what the diagnostic says,
where it points (line and column in a problem file; row and column in a data file) and what it advises.
"""

from __future__ import annotations

import importlib
import json
import pkgutil
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

import mbm
from mbm.cli.main import run
from mbm.text.types import Code

FOLDER = Path(__file__).parent
TESTS = FOLDER.parent

ELSEWHERE = {
    "assumed-noise": "simulation/test_measurements.py",
    "assumed-value": "simulation/test_measurements.py",
    "bad-array": "data/test_data_diagnostics.py",
    "bad-board": "images/test_boards.py",
    "bad-call": "cli/test_main.py",
    "bad-initial-values": "report/test_initial.py",
    "bad-photograph": "cli/test_view.py",
    "board-left-out": "images/test_chessboard.py",
    "broken-plug-in": "registry/test_plug_ins.py",
    "bad-json": "cli/test_solve.py",
    "malformed-bag": "data/test_rosbag.py",
    "no-topic": "data/test_rosbag.py",
    "damaged-image": "images/test_what_is_said.py",
    "deciding-input": "api/test_estimator.py",
    "design-assumed": "report/test_designs.py",
    "exists-already": "cli/test_commands.py",
    "file-too-large": "data/test_path_diagnostics.py",
    "foreign-folder": "cli/test_compile.py",
    "format-needs": "report/scenes/test_scenes.py",
    "internal-fault": "cli/test_main.py",
    "interrupted": "estimation/test_interruption.py",
    "kept-equation": "simulation/test_measurements.py",
    "measured-elsewhere": "simulation/test_measurements.py",
    "missing-extra": "report/test_plots.py",
    "model-without-values": "cli/test_view.py",
    "native-unavailable": "bad/test_made.py",
    "no-board": "images/test_what_is_said.py",
    "no-candidates": "report/test_designs.py",
    "no-object": "images/test_contour_faults.py",
    "no-rotation": "report/test_trajectories.py",
    "no-equation-for-row": "api/test_stream.py",
    "noise-too-large": "noise/test_shared_noise.py",
    "no-budget": "report/test_budgets.py",
    "no-region": "report/test_regions.py",
    "no-such-clause": "api/test_result.py",
    "no-such-input": "api/test_estimator.py",
    "no-true-value": "simulation/test_measurements.py",
    "not-a-stream": "api/test_estimator.py",
    "not-a-table": "data/test_data_diagnostics.py",
    "not-designed": "report/test_designs.py",
    "not-predicted": "report/test_predictions.py",
    "not-simulated": "simulation/test_measurements.py",
    "object-left-out": "images/test_contour.py",
    "other-size": "images/test_contour_faults.py",
    "no-density": "simulation/test_log_density.py",
    "not-settled": "simulation/test_propagation.py",
    "not-writable": "bad/test_made.py",
    "nothing-to-draw": "cli/test_view.py",
    "plot-format": "report/test_plots.py",
    "points-left-out": "images/test_what_is_said.py",
    "transparent-image": "images/test_what_is_said.py",
    "text-too-large": "bad/test_made.py",
    "too-long-to-print": "bad/test_made.py",
    "bad-memory-bound": "data/test_bound_diagnostics.py",
    "bad-work-bound": "data/test_bound_diagnostics.py",
    "too-many-columns": "data/test_bound_diagnostics.py",
    "too-many-matches": "data/test_unions.py",
    "too-many-files": "data/test_bound_diagnostics.py",
    "too-much-memory": "data/test_bound_diagnostics.py",
    "too-much-to-draw": "cli/test_view.py",
    "too-much-to-compile": "data/test_bound_diagnostics.py",
    "too-many-shared-errors": "estimation/implicit/test_components.py",
    "too-deeply-nested": "bad/test_made.py",
    "unclear-measurement": "simulation/test_measurements.py",
    "unknown-backend": "bad/test_made.py",
    "report-format": "report/test_page.py",
    "unknown-output": "report/scenes/test_scenes.py",
    "unknown-quantity": "cli/test_budget.py",
    "unknown-photo": "cli/test_view.py",
    "unknown-observation": "simulation/test_measurements.py",
    "unreadable-file": "files/test_reading.py",
    "values-against-constraint": "simulation/test_measurements.py",
    "would-overwrite": "cli/test_nothing_lost.py",
    "wrong-argument": "api/test_arguments.py",
    "stream-stopped": "api/test_stream.py",
    "wrong-input": "api/test_estimator.py",
    "wrong-step": "api/test_stream.py",
}
"""Codes that no problem file or table can produce by itself, or whose cases are too large to keep: their test."""


@dataclass(frozen=True)
class Expected:
    command: tuple[str, ...]
    status: int
    says: str
    at: str
    hint: str


def expected(name: str) -> Expected:
    text = (FOLDER / f"{name}.expected").read_text("utf-8")
    lines = dict(line.split(": ", 1) for line in text.splitlines())
    return Expected(
        command=tuple(lines["command"].split()[1:]),
        status=int(lines["status"]),
        says=lines["says"],
        at=lines["at"],
        hint=lines["hint"],
    )


CASES = tuple(sorted(path.stem for path in FOLDER.glob("*.expected")))


def blocks(output: str) -> list[str]:
    """The diagnostics of an output, from `error[…]` or `warning[…]` to the next."""
    return re.split(r"\n(?=(?:error|warning)\[)", output)


def on_one_line(text: str) -> str:
    return re.sub(r"\s+", " ", text)


@pytest.mark.parametrize("name", CASES)
def test_the_command_line_says_what_is_wrong_where_and_what_to_do(
    name: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    wanted = expected(name)
    monkeypatch.chdir(FOLDER)
    status = run(wanted.command)
    out, err = capfd.readouterr()
    assert "Traceback" not in out + err
    found = [block for block in blocks(err + "\n" + out) if wanted.says in on_one_line(block)]
    assert found, err
    assert status == wanted.status, err
    place = next((line.strip()[4:] for line in found[0].splitlines() if line.strip().startswith("--> ")), "-")
    assert place == wanted.at
    if wanted.hint != "-":
        assert wanted.hint in on_one_line(found[0])


def every_code() -> Iterator[Code]:
    for module in pkgutil.walk_packages(mbm.__path__, "mbm."):
        if module.name.endswith(".faults"):
            names = vars(importlib.import_module(module.name)).values()
            yield from (value for value in names if isinstance(value, Code))


CODES = {code.name: code for code in every_code()}


def code_of(name: str) -> str:
    says = expected(name).says
    return says[says.index("[") + 1 : says.index("]")]


@pytest.mark.parametrize("code", sorted(CODES))
def test_every_code_is_tested(code: str) -> None:
    if code in {code_of(name) for name in CASES}:
        assert code not in ELSEWHERE, "the table names only what is not here"
        return
    place = TESTS / ELSEWHERE[code]
    text = place.read_text("utf-8")
    assert code in text or code.replace("-", "_") in text.lower()


@pytest.mark.parametrize("name", CASES)
def test_cases_are_named_after_their_code(name: str) -> None:
    bare = name.removeprefix("use-")
    assert bare == code_of(name) or bare.startswith(f"{code_of(name)}-")


@pytest.mark.parametrize("code", sorted(CODES))
def test_codes_are_kebab_case_and_say_meaning_and_mend_in_sentences(code: str) -> None:
    assert re.fullmatch(r"[a-z]+(-[a-z]+)*", code)
    for sentence in (CODES[code].meaning, CODES[code].mend):
        assert sentence.endswith((".", "…", ")", "`")), sentence
        assert sentence[0] in "`" or sentence[0].isupper(), sentence


def test_several_independent_errors_come_in_one_run(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "several.mbm"
    file.write_text(
        "(problem p\n  (unknowns (a :init b) (c :inti 1))\n  (observe o (= 1 (sin a a)))\n  (solve :seed x))\n"
    )
    assert run(["check", str(file), "--json", "-"]) == 2
    found = json.loads(capfd.readouterr().out)["diagnostics"]
    assert [(d["code"], d["line"], d["column"], d["length"]) for d in found] == [
        ("bad-form", 2, 28, 5),
        ("unknown-name", 2, 22, 1),
        ("wrong-arity", 3, 19, 9),
        ("unknown-name", 4, 16, 1),
    ]


def test_a_failed_declaration_is_reported_once_not_at_every_use(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "once.mbm"
    file.write_text("(problem p\n  (unknowns (a postive))\n  (observe o (= 1 (+ a a)))\n  (derive (b a)))\n")
    assert run(["check", str(file)]) == 2
    assert capfd.readouterr().err.count("error[") == 1


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_each_case_in_a_process_of_its_own(name: str) -> None:
    wanted = expected(name)
    done = subprocess.run(
        [sys.executable, "-m", "mbm", *wanted.command], cwd=FOLDER, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == wanted.status
    assert "Traceback" not in done.stderr
