"""Generated solvers with consensus, bounded losses, noise that goes with a loss, on data they were not made with."""

from __future__ import annotations

import csv
import importlib.util
import shutil
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import mbm
from tests.emit.agreeing import TEXTS, with_rows
from tests.emit.making import make, of_text, written

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) is here")

REFERENCES = 7
"""Numbers that are compared at least: status, freedom, cost, and of two unknowns estimates, two variances."""


def made_with_others(name: str, target: str, folder: Path) -> Path:
    """A solver made with some rows, whose test wants to see what mbm answers for other ones."""
    made = written(of_text(with_rows(name, 0), target), folder)
    other = {file.path: file for file in of_text(with_rows(name, 1), "python")}  # data and references are as for C
    replaced = [file for path, file in other.items() if path.startswith("data/") or path == "reference.csv"]
    return written(tuple(replaced), made)


def references(folder: Path) -> list[dict[str, str]]:
    """What the test in a folder compares with."""
    with (folder / "reference.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("name", TEXTS)
def test_python_answers_other_data_as_mbm_does(name, tmp_path, monkeypatch):
    identifier = name.replace("-", "_")
    folder = made_with_others(name, "python", tmp_path)
    assert len(references(folder)) >= REFERENCES
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setitem(sys.modules, identifier, module_of(folder, identifier))
    module_of(folder, f"test_{identifier}").test_reference_numbers()


@needs_compiler
@pytest.mark.parametrize("name", TEXTS)
def test_c_answers_other_data_as_mbm_does(name, tmp_path):
    folder = made_with_others(name, "c", tmp_path)
    assert len(references(folder)) >= REFERENCES
    found = make(folder, "test")
    assert found.returncode == 0, found.stdout + found.stderr


@needs_compiler
def test_what_the_closed_form_knows_in_c_outlasts_the_trials(tmp_path):
    """Eight ranges, three of them grossly wrong: scratch that is too short would reach into what is known of them."""
    folder = written(of_text(ranges_with_gross_errors(30), "c"), tmp_path)
    assert len(references(folder)) >= 30 * REFERENCES
    found = make(folder, "test")
    assert found.returncode == 0, found.stdout + found.stderr


def ranges_with_gross_errors(epochs: int) -> str:
    """A place from ranges, epoch by epoch without a start; noise of 0.3 and, in three rows of eight, errors of 5 to 20.

    More than half of the rows are good, so that consensus gives the answer at the first attempt.
    """
    generator = np.random.default_rng(13)
    masts = np.array([[-3, -1], [-1, -4], [5, -2], [-2, 6], [-1, 4], [-2, -5], [7, 6], [-1, 5]], dtype=float)
    rows = []
    for epoch in range(epochs):
        place = generator.uniform(-10, 10, 2)
        ranges = np.hypot(*(masts - place).T) + generator.normal(0, 0.3, 8)
        ranges[generator.choice(8, 3, replace=False)] += generator.uniform(5, 20, 3)
        rows += [f"({epoch} {mast} {r:.6f})" for mast, r in enumerate(ranges)]
    known = " ".join(f"({mast} {x} {y})" for mast, (x, y) in enumerate(masts))
    return f"""(problem crowded
      (data masts (table (id x y) {known}) :key id)
      (data ranges (table (epoch mast r) {" ".join(rows)}) :with (masts mast))
      (unknowns (p (vector 2)))
      (observe ranges (= r (distance p [masts.x masts.y])) :sigma 0.3)
      (for-each epoch)
      (solve :robust (lmeds :trials 200)))"""


def module_of(folder: Path, name: str) -> ModuleType:
    """A Python file of a folder."""
    spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def loaded(name: str, folder: Path, monkeypatch) -> tuple[ModuleType, dict]:
    """The generated module and its tables."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    made = written(of_text(with_rows(name, 0), "python"), folder)
    module = module_of(made, name.replace("-", "_"))
    return module, module.read_tables([str(made / "data" / f"{table}.csv") for table in module.COLUMNS])


def test_rows_that_do_not_agree_are_told(tmp_path, monkeypatch):
    module, tables = loaded("offset", tmp_path, monkeypatch)
    agreement = module.solve(tables)["agreement"]
    # three metres were added to the third range of the first epoch, as `ROWS` was made
    assert agreement["inside"].tolist() == [True, True, False, True, True, True]
    assert (agreement["units"], agreement["inliers"]) == (6, 5)


def test_a_start_that_the_caller_states_takes_the_place_of_the_one_from_the_data(tmp_path, monkeypatch):
    module, tables = loaded("startless", tmp_path, monkeypatch)
    _, chosen = next(iter(module.data_sets(tables)))
    by_itself, stated = module.solve(chosen), module.solve(chosen, {"p": [20.0, 20.0]})
    sigma = by_itself["estimates"]["p"]["sigma"]
    # both end where the same five ranges say: 1e-9 of a standard deviation is what the iteration leaves
    assert np.all(np.abs(stated["point"] - by_itself["point"]) <= 1e-8 * sigma)


def test_measurements_of_which_fewer_than_half_agree_are_no_answer(tmp_path, monkeypatch):
    module, tables = loaded("limited", tmp_path, monkeypatch)
    scattered = np.array([0.0, 50.0, -40.0, 90.0, 10.0, -70.0, 35.0, -15.0])
    found = module.solve({"d": {"x": tables["d"]["x"], "y": scattered}})
    rows = " ".join(f"({x} {y})" for x, y in zip(tables["d"]["x"], scattered, strict=True))
    assert found["status"] == "no-agreement"
    (wanted,) = mbm.loads(TEXTS["limited"].format(rows=rows)).solve().solves
    assert wanted.status == "not-converged"
    assert "too-few-agree" in {diagnostic.code.name for diagnostic in wanted.diagnostics}


def test_parts_that_nothing_connects_are_told_apart_where_the_data_make_them(tmp_path, monkeypatch):
    module, tables = loaded("levelling", tmp_path, monkeypatch)
    steps = {
        "from": np.array(["a", "a", "a", "a"]),
        "to": np.array(["b", "c", "b", "c"]),
        "rise": np.array([1.2, 2.0, 1.21, 2.01]),
    }
    with pytest.raises(module.DataError, match="no equation connects all unknowns"):
        module.solve({**tables, "steps": steps})
