"""What a command loads: heavy libraries only where they are needed, so that everything else starts at once."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from mbm.cli.main import COMMANDS, run

HEAVY = {"numpy", "scipy", "sympy", "casadi", "matplotlib", "pandas", "polars", "lark", "rich", "pint", "IPython"}
"""Whatever costs more than a few hundredths of a second, or is not needed by every command."""

REPORT = """
import contextlib, io, json, sys
from mbm.cli.main import run
with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
    status = run(sys.argv[1:])
print(json.dumps([status, sorted({name.partition(".")[0] for name in sys.modules})]))
"""


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("startup") / "first"
    assert run(["new", str(folder), "-q"]) == 0
    return folder / "first.mbm"


def _loaded(*arguments: str | Path) -> set[str]:
    """The heavy libraries that a command line loads in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", REPORT, *map(str, arguments)], capture_output=True, text=True, check=True
    )
    status, modules = json.loads(done.stdout)
    assert status == 0, done.stderr
    return HEAVY & set(modules)


def _loaded_by(code: str) -> set[str]:
    done = subprocess.run(
        [sys.executable, "-c", f"import json, sys\n{code}\nprint(json.dumps(sorted(sys.modules)))"],
        capture_output=True,
        text=True,
        check=True,
    )
    return HEAVY & {name.partition(".")[0] for name in json.loads(done.stdout.splitlines()[-1])}


def test_help_loads_nothing_heavy() -> None:
    assert _loaded("--help") == set()


def test_version_loads_nothing_heavy() -> None:
    assert _loaded("--version") == set()


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command_loads_nothing_heavy(command: str) -> None:
    assert _loaded(command, "--help") == set()


def test_import_of_the_package_loads_nothing_heavy() -> None:
    assert _loaded_by("import mbm; dir(mbm)") == set()


def test_new_loads_nothing_heavy(tmp_path: Path) -> None:
    assert _loaded("new", tmp_path / "second") == set()


def test_fmt_loads_the_grammar_only(problem: Path) -> None:
    assert _loaded("fmt", "--check", problem) == {"lark"}


def test_check_loads_no_algebra(problem: Path) -> None:
    assert _loaded("check", problem) == {"lark", "numpy"}


def test_expand_loads_no_algebra(problem: Path) -> None:
    assert not _loaded("expand", problem, "(list 1 2)") & {"sympy", "casadi", "scipy", "matplotlib", "pandas"}


def test_solve_loads_what_derives_and_evaluates(problem: Path) -> None:
    assert _loaded("solve", problem) == {"lark", "numpy", "sympy", "casadi"}


def test_solve_with_files_loads_no_plots(problem: Path, tmp_path: Path) -> None:
    found = _loaded("solve", problem, "--json", tmp_path / "a.json", "--csv", tmp_path / "a.csv")
    assert found == {"lark", "numpy", "sympy", "casadi"}
