"""An llvmlite that is installed and does not load: all works without it, and who asks for it learns why it does not."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

TEXT = "(problem p (data d (table (y) (1) (2) (3))) (unknowns (a :init 1)) (observe d (= y (exp a)) :sigma 1))\n"
SAID = "Could not find/load shared object file: libllvmlite.so"


@pytest.fixture
def broken(tmp_path: Path) -> Path:
    """A folder with such a package: Python finds it before any other."""
    package = tmp_path / "packages" / "llvmlite"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("from llvmlite import ir\n", "utf-8")
    (package / "ir.py").write_text("", "utf-8")
    (package / "_version.py").write_text("version_version = '99.0.0'\n", "utf-8")
    (package / "binding.py").write_text(f"raise OSError({SAID!r})\n", "utf-8")
    (tmp_path / "p.mbm").write_text(TEXT, "utf-8")
    return tmp_path


def called(broken: Path, command: str, *options: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(broken / "packages"), "MBM_CACHE": str(broken / "cache")}
    arguments = [sys.executable, "-m", "mbm", command, str(broken / "p.mbm"), *options]
    return subprocess.run(arguments, capture_output=True, text=True, check=False, env=environment)


def test_the_default_does_without_it(broken: Path) -> None:
    for _ in ("cold", "warm"):
        solved = called(broken, "solve")
        assert (solved.returncode, solved.stderr) == (0, "")
        assert "converged" in solved.stdout


def test_explain_says_why(broken: Path) -> None:
    explained = called(broken, "explain")
    assert explained.returncode == 0
    assert f"no machine code can be made here: llvmlite does not work ({SAID})" in explained.stdout


def test_who_asks_for_it_is_told(broken: Path) -> None:
    solved = called(broken, "solve", "--backend", "native")
    assert solved.returncode == 2
    assert "error[native-unavailable]" in solved.stderr
    assert SAID in solved.stderr


@pytest.mark.parametrize("backend", ["numpy", "casadi"])
def test_interpreters_make_no_kernels_of_machine_code(backend: str, tmp_path: Path) -> None:
    """Only the solver, which is the same for all problems."""
    (tmp_path / "p.mbm").write_text(TEXT, "utf-8")
    native = ("mbm.kernels.native.normal", "mbm.kernels.backends.native")
    code = f"""
import sys
from mbm.cli.main import run
assert run(["solve", {str(tmp_path / "p.mbm")!r}, "--backend", {backend!r}]) == 0
print([name for name in sys.modules if name.startswith({native!r})], file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "[]\n"


@pytest.mark.parametrize("backend", ["auto", "numpy", "casadi"])
def test_without_machine_code_the_text_of_the_solver_runs_as_python(backend: str, broken: Path) -> None:
    """The same digits as with it."""
    solved = called(broken, "solve", "--backend", backend)
    assert solved.returncode == 0, solved.stderr
    command = [sys.executable, "-m", "mbm", "solve", str(broken / "p.mbm")]
    # The environment that Python knows: libraries of a test run (readline) set a width beside it.
    with_it = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ)
    assert solved.stdout == with_it.stdout
