"""Without llvmlite, without a compiler and without a cache everything works, and answers the same."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

PROBLEMS = Path(__file__).parents[2] / "problems"

BARE = """
import shutil, sys
sys.modules["llvmlite"] = None
from mbm.cli.main import run
from mbm.kernels.native.engine import available
assert not available()
assert not any(shutil.which(name) for name in ("cc", "gcc", "clang", "tcc", "zig", "cmake"))
sys.exit(run(sys.argv[1:]))
"""


def _called(*arguments: str | Path, bare: bool) -> bytes:
    """What a command line writes in a process of its own."""
    environment = dict(os.environ)
    if bare:
        environment |= {"PATH": "", "MBM_CACHE": "off"}
    start = ["-c", BARE] if bare else ["-m", "mbm"]
    command = [sys.executable, *start, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout


def _solves(file: Path, *, bare: bool) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(_called("solve", file, "--json", "-", bare=bare))["solves"]
    return found


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("triangle", id="constraints"),
        pytest.param("echoes", id="consensus", marks=pytest.mark.slow),
        pytest.param("tags", id="for-each", marks=pytest.mark.slow),
        pytest.param("skeleton", id="starts", marks=pytest.mark.slow),
        pytest.param("calibration", id="families", marks=pytest.mark.slow),
    ],
)
def test_a_problem_is_solved_with_nothing_but_the_interpreters(name: str) -> None:
    pytest.importorskip("llvmlite")
    file = PROBLEMS / name / f"{name}.mbm"
    bare, usual = _solves(file, bare=True), _solves(file, bare=False)
    assert [each["status"] for each in bare] == [each["status"] for each in usual]
    assert [each["residuals"] for each in bare if each["residuals"]]
    for mine, other in zip(bare, usual, strict=True):
        assert list(mine["estimates"]) == list(other["estimates"])
        assert {k: v["outliers"] for k, v in mine["residuals"].items()} == {
            k: v["outliers"] for k, v in other["residuals"].items()
        }
        # Both ends are minima to 1e-10 of the standard deviations; what is left is the curvature times that.
        np.testing.assert_allclose(mine["cost"], other["cost"], rtol=1e-8)
        assert mine["covariance"]["names"] == other["covariance"]["names"]
        if mine["covariance"]["matrix"] is not None:
            wanted = np.array(other["covariance"]["matrix"])
            size = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
            assert (np.abs(np.array(mine["covariance"]["matrix"]) - wanted) <= 1e-7 * size + 1e-300).all()


@pytest.mark.parametrize(
    "target", ["python", pytest.param("c", marks=pytest.mark.slow), pytest.param("casadi", marks=pytest.mark.slow)]
)
def test_a_solver_is_written(target: str, tmp_path: Path) -> None:
    _called("compile", PROBLEMS / "triangle" / "triangle.mbm", "--target", target, "-o", tmp_path / "out", bare=True)
    assert (tmp_path / "out" / "README.md").is_file()
