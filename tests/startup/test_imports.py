"""What a command loads: heavy libraries only where they are needed, so that everything else starts at once."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from mbm.api import loads
from mbm.cli.group import COMMANDS
from mbm.cli.main import run
from tests.startup.caches import seeded

HEAVY = {"numpy", "scipy", "sympy", "casadi", "matplotlib", "pandas", "polars", "lark", "rich", "pint", "IPython"}
HEAVY.add("shapely")
"""Whatever costs more than a few hundredths of a second, or is not needed by every command."""

REPORT = """
import contextlib, io, json, sys
from mbm.cli.main import run
with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
    status = run(sys.argv[1:])
print(json.dumps([status, sorted(sys.modules)]))
"""


@pytest.fixture(scope="module", autouse=True)
def _solver() -> None:
    """The solver's machine code is in the cache of the run: to make is half of a first solve, and loads no more."""
    loads("(problem p (unknowns (a :init 0)) (observe (= 1 a) :sigma 1))").solve()


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("startup") / "first"
    assert run(["new", str(folder), "-q"]) == 0
    return folder / "first.mbm"


def _modules(*arguments: str | Path) -> set[str]:
    """The modules that a command line loads in a process of its own, where no problem was compiled before."""
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder) / "cache"
        if arguments[0] == "solve":
            seeded(cache, Path(os.environ["MBM_CACHE"]))
        done = subprocess.run(
            [sys.executable, "-c", REPORT, *map(str, arguments)],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "MBM_CACHE": str(cache) if cache.exists() else "off"},
        )
    status, modules = json.loads(done.stdout)
    assert status == 0, done.stderr
    return set(modules)


def _loaded(*arguments: str | Path) -> set[str]:
    """The heavy libraries among them."""
    return HEAVY & {name.partition(".")[0] for name in _modules(*arguments)}


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


CONSTRAINED, SPARSE = "mbm.estimation.minimise.constrained", "mbm.sparse"
CORRECTIONS, CLOSED_FORMS = "mbm.equations.corrections", "mbm.estimation.starts.closed_forms"
SELDOM = (CONSTRAINED, SPARSE, CORRECTIONS, CLOSED_FORMS)
"""Rooms of methods that few problems need."""

LINE = """(problem line
  (data d (table (x y) (1 2.1) (2 3.9) (3 6.2)))
  (unknowns (a :init 0) (b :init 0))
  (observe d (= y (+ a (* b x))) {noise}){more})
"""


def _seldom(modules: set[str]) -> set[str]:
    """The rooms of `SELDOM` that are among the modules."""
    return {room for room in SELDOM if any(f"{name}.".startswith(f"{room}.") for name in modules)}


def test_check_loads_no_solver(problem: Path) -> None:
    modules = _modules("check", problem)
    assert not _seldom(modules)
    solving = ("mbm.estimation.minimise", "mbm.estimation.solve", "mbm.estimation.consensus")
    assert not {name for name in modules if name.startswith(("mbm.kernels", "mbm.symbolic", *solving))}
    assert not modules & {"mbm.equations.binding", "mbm.equations.assembly"}


def test_a_linear_solve_loads_no_method_that_it_does_not_need(tmp_path: Path) -> None:
    file = tmp_path / "line.mbm"
    file.write_text(LINE.format(noise=":sigma 0.1", more=""), encoding="utf-8")
    modules = _modules("solve", file)
    assert "mbm.estimation.solve.estimate" in modules
    assert not _seldom(modules)
    assert not modules & {"mbm.estimation.consensus.consensus", "mbm.estimation.consensus.agreeing"}


def test_a_start_that_is_given_is_compared_with_closed_forms_and_nothing_else(problem: Path) -> None:
    assert _seldom(_modules("solve", problem)) == {CLOSED_FORMS}


@pytest.mark.parametrize(
    ("noise", "more", "room"),
    [
        (":sigma 0.1", " (constraints (<= b 10 :name high))", CONSTRAINED),
        (":errors ((x 0.1) (y 0.1))", "", CORRECTIONS),
    ],
)
def test_a_method_is_loaded_by_the_problem_that_needs_it(noise: str, more: str, room: str, tmp_path: Path) -> None:
    file = tmp_path / "line.mbm"
    file.write_text(LINE.format(noise=noise, more=more), encoding="utf-8")
    assert room in _seldom(_modules("solve", file))
