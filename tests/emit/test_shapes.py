"""Generated solvers of each shape of problem: compiled and run, against SciPy and the numbers of `mbm solve`."""

from __future__ import annotations

import csv
import importlib.util
import math
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

import mbm
from tests.emit.agreeing import AGREEING
from tests.emit.making import PROBLEMS, emitted, make, of_text, run, written
from tests.emit.outside import OUTSIDE
from tests.emit.shapes import CORRECTED, SHAPES, TURNS

GOLDEN = Path(__file__).parent / "golden"

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) is here")

AGREED = 1e-9
"""Of the larger of a number's size and its standard deviation: what CONTRACT §4 promises."""


@pytest.mark.parametrize("path", ["derived.h", "derived.c", "derived_kernels.h"])
def test_the_text_is_the_one_agreed_on(path, request):
    """One solver, kept to be read: update with ``pytest tests/emit --update-golden``, and read the difference."""
    text = {file.path: file.content for file in of_text(SHAPES["derived"], "c")}[path]
    if request.config.getoption("--update-golden"):
        (GOLDEN / path).write_bytes(text)
    assert text.decode() == (GOLDEN / path).read_text(encoding="utf-8")


@needs_compiler
@pytest.mark.parametrize("name", SHAPES)
def test_c_compiles_without_a_warning_and_gives_the_reference_numbers(name, tmp_path):
    folder = written(of_text(SHAPES[name], "c"), tmp_path)
    made = make(folder, "all", "test")
    assert made.returncode == 0, made.stdout + made.stderr
    assert "0 of" in made.stdout


@needs_compiler
def test_angles_begin_where_the_reference_says(tmp_path):
    made = make(written(of_text(TURNS, "c"), tmp_path), "all", "test")
    assert made.returncode == 0, made.stdout + made.stderr


@needs_compiler
@pytest.mark.parametrize("broken", ["reference.csv", "data"])
def test_a_test_with_a_broken_file_says_so_and_frees_what_it_read(broken, tmp_path):
    folder = written(of_text(SHAPES["derived"], "c"), tmp_path)
    assert make(folder, "derived_test").returncode == 0
    place = folder / broken if broken.endswith(".csv") else min((folder / broken).iterdir())
    place.write_text(place.read_text() + "1,2,3,4,5,6,7,8,9\n")
    found = run("./derived_test", folder=folder)
    assert found.returncode == 2, found.stderr
    assert "another number of fields" in found.stderr
    assert "LeakSanitizer" not in found.stderr


NEAR = 3e-7
"""Standard deviations from SciPy's minimum: as `tests.oracles.outside.FAR` says. Deviations differ to first order."""


@needs_compiler
@pytest.mark.parametrize("name", OUTSIDE)
def test_the_program_prints_what_scipy_finds(name, tmp_path):
    folder = written(of_text(SHAPES[name], "c"), tmp_path)
    assert make(folder, "all").returncode == 0
    tables = re.findall(r'"(data/.+?)"', (folder / "test.c").read_text())
    found = run(f"./{name.replace('-', '_')}", *tables, folder=folder)
    assert found.returncode == 0, found.stderr
    rows = list(csv.DictReader(found.stdout.splitlines()))
    printed = len(rows) // len(OUTSIDE[name])
    for number, expected in enumerate(OUTSIDE[name]):
        values, sigmas, room = expected.numbers()
        each = rows[number * printed : (number + 1) * printed]
        mine = [row for row in each if not expected.names or row["name"] in expected.names][: len(values)]
        np.testing.assert_allclose([float(row["value"]) for row in mine], values, rtol=0, atol=NEAR * room)
        if sigmas is not None:
            own = [float(row["sigma"] or 0.0) for row in mine]  # a bound holds what has none
            np.testing.assert_allclose(own, sigmas, rtol=1e-6, atol=NEAR * room)


@pytest.mark.parametrize("name", [n for n in SHAPES if n not in AGREEING])
def test_python_gives_what_solve_gives(name, tmp_path, monkeypatch):
    folder = written(of_text(SHAPES[name], "python"), tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    identifier = name.replace("-", "_")
    spec = importlib.util.spec_from_file_location(f"emitted_{identifier}", folder / f"{identifier}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    files = [str(folder / "data" / path) for path in sorted(p.name for p in (folder / "data").iterdir())]
    by_table = {Path(file).stem: file for file in files}
    tables = module.read_tables([by_table[table] for table in module.COLUMNS])
    solved = mbm.loads(SHAPES[name]).solve()
    for (_, found), wanted in zip(module.solve_each(tables), solved.solves, strict=True):
        assert found["status"] == wanted.status
        matrix = np.asarray(wanted.record.covariance.matrix, dtype=float)
        own = found["covariance"]
        assert own.shape == matrix.shape or name in CORRECTED
        own = own[: len(matrix), : len(matrix)]
        known = np.isfinite(matrix)  # the document has no variance for what a bound holds, the solver 0
        assert np.all(known | (own == 0.0))
        sigma = np.sqrt(np.diag(matrix))
        sigma[sigma <= 1e-12 * np.nanmax(sigma)] = np.nanmax(sigma)  # what constraints determine: rounding alone
        difference = (own - matrix)[known]  # both in SI
        size = np.maximum(np.abs(matrix), np.outer(sigma, sigma))[known]
        assert np.all(np.abs(difference) <= AGREED * size)
        assert math.isclose(found["cost"], wanted.cost, rel_tol=AGREED, abs_tol=AGREED)
        assert found["freedom"] == wanted.dof


@needs_compiler
@pytest.mark.parametrize(
    ("problem", "name"),
    [
        ("calibration", None),
        ("decay", None),
        ("desk", "desk"),
        ("desk", "desk-and-shape"),
        ("desk", "desk-with-priors"),
        ("desk-as-printed", None),
        ("echoes", None),
        ("enzyme", None),
        ("light", "pooled"),
        ("light", "by-series"),
        ("loop", None),
        ("meridian", None),
        ("oxygen-demand", "far"),
        ("oxygen-demand", "near"),
        ("rim", None),
        ("skeleton", "skeleton-near"),
        ("station", None),
        ("tags", None),
        ("triangle", None),
    ],
)
@pytest.mark.slow
def test_every_problem_that_can_be_emitted_gives_its_numbers_in_c_and_python(problem, name, tmp_path):
    loaded = mbm.load(PROBLEMS / problem / f"{problem}.mbm")
    loaded = loaded if name is None else loaded.named(name)
    folder = written(emitted(loaded, "c"), tmp_path / "c")
    made = run("make", "test", "CFLAGS=-O1", folder=folder)
    assert made.returncode == 0, made.stdout + made.stderr
    folder = written(emitted(loaded, "python"), tmp_path / "python")
    test = next(path.name for path in folder.iterdir() if path.name.startswith("test_"))
    found = run(sys.executable, "-W", "error", test, folder=folder)
    assert found.returncode == 0, found.stdout + found.stderr


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
def test_c_is_clean_under_the_sanitizers(name, tmp_path):
    folder = written(of_text(SHAPES[name], "c"), tmp_path)
    flags = "CFLAGS=-O1 -g -fsanitize=address,undefined -fno-sanitize-recover"
    made = run("make", "test", flags, folder=folder)
    if "cannot find" in made.stderr and "san" in made.stderr:
        pytest.skip("the compiler has no sanitizers")
    assert made.returncode == 0, made.stdout + made.stderr


@needs_compiler
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="valgrind is not here")
@pytest.mark.slow
@pytest.mark.parametrize("name", ["family", "losses", "for-each", "startless", "both", "held"])
def test_c_is_clean_under_valgrind(name, tmp_path):
    identifier = name.replace("-", "_")
    folder = written(of_text(SHAPES[name], "c"), tmp_path)
    assert run("make", f"{identifier}_test", "CFLAGS=-O1 -g", folder=folder).returncode == 0
    found = run("valgrind", "-q", "--leak-check=full", "--error-exitcode=9", f"./{identifier}_test", folder=folder)
    assert found.returncode == 0, found.stderr


@needs_compiler
def test_the_program_prints_estimates_in_the_units_of_the_problem(tmp_path):
    folder = written(of_text(SHAPES["joined"], "c"), tmp_path)
    assert make(folder, "all").returncode == 0
    found = run("./joined", "data/places.csv", "data/ranges.csv", folder=folder)
    assert found.returncode == 0, found.stderr
    rows = list(csv.DictReader(found.stdout.splitlines()))
    wanted = mbm.loads(SHAPES["joined"]).solve()["p"]
    assert [row["unit"] for row in rows] == ["cm", "cm"]
    for row, value, sigma in zip(rows, wanted.value, wanted.sigma, strict=True):
        assert abs(float(row["value"]) - value) <= AGREED * max(abs(value), sigma)
        assert math.isclose(float(row["sigma"]), sigma, rel_tol=AGREED)


WRONG = {
    "no number": ("place,r\nnorth,8.1\neast,nine\n", "row 3, column `r`: `nine` is no number"),
    "no column": ("place,s\nnorth,8.1\n", "row 1, column `r`: there is no such column"),
    "fields": ("place,r\nnorth,8.1,7\n", "row 2: has another number of fields"),
    "unknown key": ("place,r\nsouth,8.1\n", "a key names no row or member"),
    "missing": (None, "cannot be read"),
}


@needs_compiler
def test_the_program_says_where_a_table_is_wrong(tmp_path):
    folder = written(of_text(SHAPES["joined"], "c"), tmp_path)
    assert make(folder, "all").returncode == 0
    for content, message in WRONG.values():
        wrong = folder / "wrong.csv"
        wrong.unlink(missing_ok=True)
        if content is not None:
            wrong.write_text(content, encoding="utf-8")
        found = run("./joined", "data/places.csv", "wrong.csv", folder=folder)
        assert found.returncode == 2
        assert message in found.stderr
    assert run("./joined", folder=folder).returncode == 2


@pytest.mark.parametrize("name", ["pose", "derived", "both"])
def test_casadi_gives_residuals_derivatives_and_what_is_derived(name, tmp_path):
    folder = written(of_text(SHAPES[name], "casadi"), tmp_path)
    found = run(sys.executable, "test_functions.py", folder=folder)
    assert found.returncode == 0, found.stderr
