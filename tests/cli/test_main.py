"""The command line as a whole: help, versions, colours, faults of all kinds, what it imports."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import mbm.cli.main
from mbm.cli.group import COMMANDS, LATER
from mbm.cli.options import NumberFrom
from mbm.version import __version__

Run = Callable[..., Any]
ROOT = Path(mbm.cli.main.__file__).parents[2]


def process(*arguments: str, stdout: Any = subprocess.PIPE, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), **variables},
        timeout=60,
        check=False,
    )


def test_help_lists_every_command(mbm: Run) -> None:
    outcome = mbm("--help")
    assert outcome.status == 0
    for name in COMMANDS:
        assert re.search(rf"^  {name} ", outcome.out, re.MULTILINE)


@pytest.mark.parametrize("name", list(COMMANDS))
def test_every_command_has_help(name: str, mbm: Run) -> None:
    outcome = mbm(name, "--help")
    assert outcome.status == 0
    assert outcome.out.startswith(f"Usage: mbm {name} ")


def test_version_is_that_of_the_project(mbm: Run) -> None:
    assert mbm("--version").out == f"mbm, version {__version__}\n"
    project = ROOT / "pyproject.toml"
    if project.exists():
        assert tomllib.loads(project.read_text())["project"]["version"] == __version__


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; sys.argv = ['mbm', '--help']\n"
        "from mbm.cli.main import run\n"
        "run(['--help'])\n"
        "heavy = {'numpy', 'sympy', 'casadi', 'lark', 'scipy', 'rich', 'matplotlib', 'pandas'}\n"
        "print(sorted(heavy & set(sys.modules)), file=sys.stderr)\n"
    )
    finished = process("-c", code)
    assert finished.stderr == "[]\n"
    assert "Usage: mbm" in finished.stdout


def test_fmt_imports_no_mathematics(tmp_path: Path) -> None:
    path = tmp_path / "a.mbm"
    path.write_text("(defun f (x) x)\n")
    code = (
        "import sys\n"
        "from mbm.cli.main import run\n"
        f"status = run(['fmt', {str(path)!r}])\n"
        "print(status, sorted({'numpy', 'sympy', 'casadi', 'scipy'} & set(sys.modules)))\n"
    )
    assert process("-c", code).stdout == "0 []\n"


def test_runs_as_a_module() -> None:
    finished = process("-m", "mbm", "--version")
    assert (finished.returncode, finished.stdout) == (0, f"mbm, version {__version__}\n")


def test_without_a_command_shows_the_help(mbm: Run) -> None:
    outcome = mbm()
    assert outcome.status == 2
    assert "Usage: mbm" in outcome.err


@pytest.mark.parametrize("name", LATER)
def test_later_commands_say_so_in_one_line(name: str, mbm: Run) -> None:
    outcome = mbm(name, "desk.mbm")
    assert outcome.status == 2
    assert outcome.err == f"error[not-available-yet]: `mbm {name}` is not available yet\n"


def test_unknown_commands_get_a_suggestion(mbm: Run) -> None:
    outcome = mbm("slove", "desk.mbm")
    assert outcome.status == 2
    assert "did you mean `solve`?" in outcome.err


def test_wrong_calls_are_json_too(mbm: Run) -> None:
    outcome = mbm("solve", "--json", "-")
    assert outcome.status == 2
    assert json.loads(outcome.out)["diagnostics"][0]["code"] == "bad-call"


def test_json_without_a_file_is_a_wrong_call(mbm: Run) -> None:
    outcome = mbm("solve", "desk.mbm", "--json")
    assert outcome.status == 2
    assert "--json" in outcome.err
    assert "Traceback" not in outcome.err
    assert "internal" not in outcome.err


def test_an_internal_fault_asks_for_a_report_and_hides_the_traceback(mbm: Run, api: Any) -> None:
    api.answers["solve_file"] = ZeroDivisionError("float division by zero\nsecond line")
    outcome = mbm("solve", "desk.mbm")
    assert outcome.status == 2
    assert "internal fault in mbm (ZeroDivisionError: float division by zero)" in outcome.err
    assert "please report it" in outcome.err
    assert "Traceback" not in outcome.err


def test_verbose_shows_the_traceback_of_an_internal_fault(mbm: Run, api: Any) -> None:
    api.answers["solve_file"] = RecursionError("maximum recursion depth exceeded")
    outcome = mbm("-v", "solve", "desk.mbm")
    assert outcome.status == 2
    assert "Traceback (most recent call last)" in outcome.err


def test_control_c_ends_with_130(mbm: Run, api: Any) -> None:
    api.answers["solve_file"] = KeyboardInterrupt()
    outcome = mbm("solve", "desk.mbm")
    assert (outcome.status, outcome.err) == (130, "interrupted\n")


def test_a_reader_that_leaves_is_no_fault() -> None:
    """``mbm --help | head -0``: the pipe is closed before anything is written."""
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as closed:
        finished = process("-m", "mbm", "--help", stdout=closed)
    assert (finished.returncode, finished.stderr) == (0, "")


def test_a_terminal_without_the_characters_is_no_fault() -> None:
    """The help of ``solve`` holds an arrow and an ellipsis."""
    finished = process("-m", "mbm", "solve", "--help", PYTHONIOENCODING="ascii")
    assert (finished.returncode, finished.stderr) == (0, "")


def test_no_color_in_a_pipe(mbm: Run, api: Any) -> None:
    assert "\x1b" not in mbm("solve", "desk.mbm").out


@pytest.mark.parametrize(
    ("variables", "flag", "colored"), [({}, (), True), ({"NO_COLOR": "1"}, (), False), ({}, ("--no-color",), False)]
)
def test_colour_on_a_terminal(
    variables: dict[str, str],
    flag: tuple[str, ...],
    colored: bool,
    mbm: Run,
    api: Any,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    assert ("\x1b[" in mbm("solve", "desk.mbm", *flag).out) is colored


def test_shell_completion_knows_the_commands() -> None:
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "_MBM_COMPLETE": "bash_complete",
        "COMP_WORDS": "mbm s",
        "COMP_CWORD": "1",
    }
    finished = subprocess.run(
        [sys.executable, "-m", "mbm"], capture_output=True, text=True, env=environment, timeout=60, check=False
    )
    assert finished.stdout == "plain,solve\nplain,simulate\n"


@pytest.mark.skipif(os.name == "nt", reason="outputs are closed by a shell")
@pytest.mark.parametrize(("closed", "status"), [(">&-", 2), ("2>&-", 2), (">&- 2>&-", 2)])
def test_closed_outputs_change_no_status(closed: str, status: int) -> None:
    command = f'"{sys.executable}" -m mbm check no-such-file {closed}'
    finished = subprocess.run(["sh", "-c", command], env={**os.environ, "PYTHONPATH": str(ROOT)}, check=False)
    assert finished.returncode == status


def test_the_process_ends_after_threads_and_what_is_registered_for_the_end() -> None:
    code = (
        "import atexit, sys, threading, time\n"
        "import mbm.cli.main\n"
        "from mbm.__main__ import process\n"
        "def main(heard):\n"
        "    threading.Thread(target=lambda: (time.sleep(0.2), print('thread'))).start()\n"
        "    atexit.register(print, 'registered')\n"
        "    print('said')\n"
        "    return 7\n"
        "mbm.cli.main.main = main\n"
        "process()\n"
    )
    finished = process("-c", code)
    assert (finished.stdout, finished.stderr, finished.returncode) == ("said\nthread\nregistered\n", "", 7)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (("--starts", "0"), "'--starts': `0` is no whole number from 1"),
        (("--starts", "2.5"), "'--starts': `2.5` is no whole number from 1"),
        (("--seed", "x"), "'--seed': `x` is no whole number from 0"),
        (("--seed", "-3"), "'--seed': `-3` is no whole number from 0"),
        (("--workers", "inf"), "'--workers': `inf` is no whole number from 1"),
    ],
)
def test_numbers_that_options_do_not_take(given: tuple[str, str], says: str, mbm: Run) -> None:
    outcome = mbm("solve", "p.mbm", *given)
    assert outcome.status == 2
    assert says in outcome.err


def test_numbers_with_an_exponent_are_whole_ones() -> None:
    assert repr(NumberFrom(1).convert("1e3", None, None)) == "1000"
    assert repr(NumberFrom(whole=False).convert("1e-3", None, None)) == "0.001"
