"""Data beside a generated solver: the numbers of the user's files, in the units of these."""

from __future__ import annotations

import csv
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mbm.cli.main import run

PROBLEM = """(problem bar
  (data readings (csv "readings.csv") :columns ((x place :unit mm) (y :unit um) (w :unit deg)))
  (unknowns (a :init 0m :unit m) (b :init 0 :unit um/m) (c angle :init 0))
  (observe readings (= y (+ a (* b x))) :sigma 2um)
  (observe turns readings (= w c) :sigma 1deg))
"""
ROWS = [
    ("place", "y", "w", "note"),
    (100, 12.5, 10, "p"),
    (250, 31, 11.5, "q"),
    (400, 48.5, 9, "r"),
    (900, 110, 10, "s"),
]


@pytest.fixture(scope="module", params=["python", "c"])
def made(request, tmp_path_factory) -> Path:
    """The folder with the solver, beside the problem."""
    folder = tmp_path_factory.mktemp("units")
    with (folder / "readings.csv").open("w", newline="") as stream:
        csv.writer(stream).writerows(ROWS)
    (folder / "bar.mbm").write_text(PROBLEM)
    out = folder / request.param
    assert run(["compile", str(folder / "bar.mbm"), "--target", request.param, "-o", str(out), "--quiet"]) == 0
    return out


def test_the_numbers_are_those_of_the_file(made: Path) -> None:
    with (made / "data" / "readings.csv").open(newline="") as stream:
        names, *rows = list(csv.reader(stream))
    assert set(names) == {"place", "y", "w"}
    for name in names:
        place, other = names.index(name), ROWS[0].index(name)
        # To SI and back: two roundings.
        np.testing.assert_allclose([float(r[place]) for r in rows], [float(r[other]) for r in ROWS[1:]], rtol=4e-16)


def test_the_solver_reads_the_file_of_the_user_in_its_units(made: Path) -> None:
    """Least squares in SI from the user's own file, which has a column that nothing reads."""
    if made.name == "python":
        command = [sys.executable, "bar.py"]
    else:
        if shutil.which("cc") is None:
            pytest.skip("no C compiler (cc) is here")
        sources = sorted(path.name for path in made.glob("*.c") if path.name != "test.c")
        subprocess.run(["cc", "-O1", *sources, "-o", "bar", "-lm"], cwd=made, check=True)
        command = ["./bar"]
    done = subprocess.run([*command, "../readings.csv"], cwd=made, capture_output=True, text=True, check=True)
    found = {row["name"]: row for row in csv.DictReader(done.stdout.splitlines())}
    place, y, w = (np.array([float(row[i]) for row in ROWS[1:]]) for i in range(3))
    design = np.column_stack([np.ones(4), place * 1e-3])
    line, *_ = np.linalg.lstsq(design, y * 1e-6, rcond=None)
    sigma = 2e-6 * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    wanted = {"a": (line[0], sigma[0]), "b": (line[1] * 1e6, sigma[1] * 1e6)}
    wanted["c"] = (np.deg2rad(w.mean()), np.deg2rad(0.5))
    for name, (value, deviation) in wanted.items():
        # Generated solvers agree with mbm to 1e-9 standard deviations.
        assert float(found[name]["value"]) == pytest.approx(value, abs=1e-8 * deviation)
        assert float(found[name]["sigma"]) == pytest.approx(deviation, rel=1e-8)
