"""Generated solvers of problems whose every text is hostile: they compile, run, and give the numbers of `mbm solve`."""

from __future__ import annotations

import csv
import json
import math
import shutil
import sys
from pathlib import Path

import casadi
import numpy as np
import pytest

import mbm
from mbm.text.shown import one_line
from tests.emit.hostile import EPOCHS, TEXT, as_read, written_problem
from tests.emit.making import emitted, of_text, run, written

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) is here")

AGREED = 1e-9
"""Of the larger of a number's size and its standard deviation: what CONTRACT §4 promises."""

SAFE = set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_./")


def shown_by_c(text: str) -> str:
    """What the C program prints of a text: blanks for white space, U+FFFD for what else is not printable."""
    return "".join(c if c.isprintable() else " " if c.isspace() else "\N{REPLACEMENT CHARACTER}" for c in text)


def wanted_rows(solve, shown, head=()):
    """Rows of the program's table: names as they are printed, values and standard deviations in the stated unit."""
    for name, held in (*solve["estimates"].items(), *solve.get("derived", {}).items()):
        unit = held.get("unit") or ""
        values, sigmas = np.asarray(held["value"], dtype=float), np.asarray(held["sigma"], dtype=float)
        keys = [None]
        if "keys" in held:
            # those of derived quantities are the rows of the table that are left
            derived = name in solve.get("derived", {})
            keys = range(1, len(values) + 1) if derived else held["keys"]
            values, sigmas = values.reshape(len(values), -1), sigmas.reshape(len(sigmas), -1)
        else:
            values, sigmas = values.reshape(1, -1), sigmas.reshape(1, -1)
        for key, several, spreads in zip(keys, values, sigmas, strict=True):
            for i, (value, sigma) in enumerate(zip(several, spreads, strict=True)):
                label = name + ("" if key is None else f"[{key}]") + (f"[{i + 1}]" if len(several) > 1 else "")
                yield [*head, field(label, shown), value, sigma, unit]


def field(text, shown):
    return ("'" if text[0] in "=+-@\t\r" else "") + shown(text)


def compare(printed: str, wanted: list) -> None:
    """The table that a program printed, against `wanted_rows`."""
    rows = list(csv.reader(printed.splitlines()))[1:]
    assert len(rows) == len(wanted)
    for row, expected in zip(rows, wanted, strict=True):
        assert row[:-3] == expected[:-3]
        assert row[-1] == expected[-1]
        value, sigma = float(row[-3]), float(row[-2])
        assert abs(value - expected[-3]) <= AGREED * max(abs(expected[-3]), expected[-2])
        assert math.isclose(sigma, expected[-2], rel_tol=AGREED)


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    return mbm.load(written_problem(tmp_path_factory.mktemp("hostile")))


@pytest.fixture(scope="module")
def solved(problem):
    solve = problem.solve().document()["solves"][0]
    assert solve["status"] == "converged"
    return solve


def hostile_copies(folder: Path) -> list[str]:
    """The tables of the test in files whose names are hostile too, as arguments in the order of the tables."""
    found = []
    for number, name in enumerate(("t_acute.csv", "d_acute.csv")):
        found.append(f"{number}*: {as_read(TEXT).replace('/', ':')}"[:120])
        shutil.copy(folder / "data" / name, folder / found[-1])
    return found


@needs_compiler
def test_c_compiles_runs_and_gives_what_solve_gives(problem, solved, tmp_path):
    folder = written(emitted(problem, "c"), tmp_path)
    made = run("make", "all", "test", "CFLAGS=-O0", folder=folder)
    assert made.returncode == 0, made.stdout + made.stderr
    found = run("./p_acute", *hostile_copies(folder), folder=folder)
    assert found.returncode == 0, found.stderr
    compare(found.stdout, list(wanted_rows(solved, shown_by_c)))
    assert all(line.isprintable() for line in (found.stdout + found.stderr).splitlines())


def test_python_runs_and_gives_what_solve_gives(problem, solved, tmp_path):
    folder = written(emitted(problem, "python"), tmp_path)
    checked = run(sys.executable, "-W", "error", "test_p_acute.py", folder=folder)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    found = run(sys.executable, "-W", "error", "p_acute.py", *hostile_copies(folder), folder=folder)
    assert found.returncode == 0, found.stderr
    compare(found.stdout, list(wanted_rows(solved, one_line)))
    assert all(line.isprintable() for line in (found.stdout + found.stderr).splitlines())


def test_casadi_gives_what_solve_gives(problem, solved, tmp_path):
    folder = written(emitted(problem, "casadi"), tmp_path)
    checked = run(sys.executable, "test_functions.py", folder=folder)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    described = json.loads((folder / "functions.json").read_text(encoding="utf-8"))
    reference = json.loads((folder / "reference.json").read_text(encoding="utf-8"))
    assert [each["name"] for each in described["unknowns"]] == list(solved["estimates"])
    assert described["residuals"]["coordinates"] == solved["covariance"]["names"]
    derived = casadi.Function.deserialize((folder / "derived.casadi").read_text(encoding="utf-8"))
    values, slopes = (np.array(each.full()) for each in derived(reference["answer"]))
    matrix = np.array(reference["covariance"])
    sigmas = np.sqrt(np.einsum("ij,jk,ik->i", slopes, matrix, slopes))
    place = 0
    for quantity in described["derived"]["quantities"]:
        wanted = solved["derived"][quantity["name"]]
        for value, sigma in zip(np.ravel(wanted["value"]), np.ravel(wanted["sigma"]), strict=True):
            assert math.isclose(float(values[place, 0]) / quantity["factor"], value, rel_tol=AGREED)
            assert math.isclose(sigmas[place] / quantity["factor"], sigma, rel_tol=AGREED)
            place += 1
    assert place == len(values)


@needs_compiler
def test_solves_are_told_apart_by_hostile_keys(tmp_path):
    solves = mbm.loads(EPOCHS).solve().document()["solves"]
    wanted = {
        shown: [row for s in solves for row in wanted_rows(s, shown, [field(k, shown) for k in s["key"].values()])]
        for shown in (shown_by_c, one_line)
    }
    folder = written(of_text(EPOCHS, "c"), tmp_path / "c")
    made = run("make", "all", "test", "CFLAGS=-O0", folder=folder)
    assert made.returncode == 0, made.stdout + made.stderr
    compare(run("./n_acute", "data/d_acute.csv", folder=folder).stdout, wanted[shown_by_c])
    folder = written(of_text(EPOCHS, "python"), tmp_path / "python")
    compare(run(sys.executable, "n_acute.py", "data/d_acute.csv", folder=folder).stdout, wanted[one_line])


@pytest.mark.parametrize("target", ["c", "python", "casadi"])
def test_names_of_files_are_plain_and_stay_in_the_folder(problem, target):
    for file in emitted(problem, target):
        assert set(file.path) <= SAFE
        assert not file.path.startswith("/")
        assert ".." not in file.path
