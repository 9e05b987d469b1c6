"""A made-up addition of each kind, in just the files that CONTRIBUTING names, works in every way of solving."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from tests.architecture.additions import FILES, make

ROOT = Path(__file__).parents[2]
WAYS = ("native", "casadi", "numpy", "for-each", "c", "python")
PLACES = ((0.0, 0.11, -0.07, 0.3, 0.45, 4.0), (1.0, 1.2, 0.9, 1.05, 1.7))
"""As `use_additions` writes them."""


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What a copy of mbm with all additions answers."""
    tree = tmp_path_factory.mktemp("tree")
    for name in ("mbm", "grammar"):
        shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
    for addition, _ in FILES.values():
        make(tree, addition)
    work = tree / "work"
    work.mkdir()
    script = Path(__file__).with_name("use_additions.py")
    environment = {**os.environ, "PYTHONPATH": str(tree), "MBM_CACHE": str(tree / "cache")}
    done = subprocess.run(
        [sys.executable, script], cwd=work, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    answers: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    answers["said"] = done.stdout
    assert answers["source"] == str(tree / "mbm" / "__init__.py")
    return answers


@pytest.mark.parametrize("kind", FILES)
def test_an_addition_takes_few_files(kind: str) -> None:
    addition, most = FILES[kind]
    assert len(addition) <= most


@pytest.mark.parametrize("way", WAYS)
def test_an_operation_a_function_a_method_and_a_reader(found: dict[str, Any], way: str) -> None:
    """Curves without noise, made with Python's `math`: rounding of 25 values of size 1 is all there is."""
    np.testing.assert_allclose(found[f"curve {way}"][0], [2.0, 0.7, 0.5], rtol=1e-9)
    if way == "for-each":
        np.testing.assert_allclose(found[f"curve {way}"][1], [3.0, 0.5, -0.25], rtol=1e-9)


@pytest.mark.parametrize("way", WAYS)
def test_a_loss(found: dict[str, Any], way: str) -> None:
    """SciPy with the loss as a function, to its own tolerance."""
    for answer, values in zip(found[f"place {way}"], PLACES, strict=False):
        wanted = least_squares(
            lambda m, y=values: (np.array(y) - m) / 0.1,
            np.median(values),
            loss=lambda z: np.array([1 - np.exp(-z), np.exp(-z), -np.exp(-z)]),
            f_scale=2.0,
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
        )
        np.testing.assert_allclose(answer, wanted.x, atol=1e-7)


@pytest.mark.parametrize("name", ["curve", "place"])
def test_a_number_of_each_solve(found: dict[str, Any], name: str) -> None:
    """In documents, of one solve and of many, in files of columns and in the text."""
    for file, count in ((name, 1), ("runs", 2)):
        solves, cells = found[f"norms {name} {file}"]
        assert len(solves) == len(cells) == count
        for (cost, norm), cell in zip(solves, cells, strict=True):
            assert norm == float(cell) == cost**0.5
    assert "norm of the residuals " in found["said"]


def test_a_method_is_taken(found: dict[str, Any]) -> None:
    """Half the trust radius takes longer than all of it."""
    assert found["halfway"][0] == "halfway"
    assert found["halfway"][1] > found["gauss-newton"][1]
    assert "The iteration is `halfway` in a trust region" in found["words"]


def test_a_method_is_taken_by_the_sparse_solver(found: dict[str, Any]) -> None:
    assert found["sparse"] == "halfway-sparse"
    np.testing.assert_allclose(found["roots"], np.cbrt(np.linspace(1.0, 8.0, 400)), rtol=1e-9)
