"""The functions beside `solve` of generated solvers, against the compiled equations; other ways to build the C."""

from __future__ import annotations

import csv
import functools
import importlib.util
import shutil
import sys
from types import ModuleType

import numpy as np
import pytest
from scipy.optimize import minimize

import mbm
from mbm.emit.corrections import with_true_values
from mbm.problem.types import BlockRole
from tests.emit.agreeing import AGREEING
from tests.emit.making import emitted, flags, make, of_text, run, written
from tests.emit.shapes import CORRECTED, SHAPES

UNCOMPARED = ("loss", "losses", "loss-and-noise", "similarity", "for-each", "keys", "bounds", *AGREEING, *CORRECTED)
STATED = [n for n in SHAPES if n not in UNCOMPARED]
"""Shapes with a start, without losses, consensus, solves, bounds, errors: there a point means the same to both."""

CLOSE = 1e-10
"""Relative to the largest number: the same operations in another order, over at most ten rows."""

CALLS = """#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "{name}_tables.h"

int main(void)
{{
    char *paths[] = {{{paths}}};
    struct {name}_tables tables;
    {name}_workspace workspace;
    {name}_result result;
    double *point, *found;
    long m, n, i;

    if (!{name}_read_tables(&tables, paths))
        return 2;
    {name}_workspace_size(&tables.data, &workspace);
    workspace.reals = malloc(sizeof(double) * (size_t)workspace.reals_size);
    workspace.integers = malloc(sizeof(long) * (size_t)workspace.integers_size);
    if ({name}_begin(&tables.data, &result, &workspace) != 0)
        return 3;
    n = result.free;
    m = {name}_residual_count(&tables.data, &workspace);
    point = malloc(sizeof(double) * (size_t)result.numbers);
    memcpy(point, result.point, sizeof(double) * (size_t)result.numbers);
    found = calloc((size_t)(m + m * n + n * n), sizeof(double));
    {name}_residuals(&tables.data, point, found, &workspace);
    {name}_jacobian(&tables.data, point, found + m, &workspace);
    if (!{name}_covariance(&tables.data, point, found + m + m * n, &workspace))
        return 4;
    printf("%ld %ld\\n", m, n);
    for (i = 0; i < m + m * n + n * n; i++)
        printf("%.17g\\n", found[i]);
    free(found);
    free(point);
    free(workspace.reals);
    free(workspace.integers);
    {name}_free_tables(&tables);
    return 0;
}}
"""


def close(found, wanted) -> bool:
    """Whether numbers agree as `CLOSE` says."""
    wanted = np.asarray(wanted)
    return bool(np.all(np.abs(np.asarray(found) - wanted) <= CLOSE * np.abs(wanted).max(initial=1e-300)))


@functools.cache
def at_the_start(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Residuals and Jacobian of the compiled problem at its start."""
    compiled = mbm.loads(SHAPES[name]).compile()
    nothing = np.zeros(len(compiled.solve().covariance.matrix))
    return compiled.residuals(nothing), compiled.jacobian(nothing)


def module_of(name: str, tmp_path) -> tuple[ModuleType, dict]:
    """The generated Python module, and the tables that it was made with."""
    folder = written(of_text(SHAPES[name], "python"), tmp_path)
    identifier = name.replace("-", "_")
    spec = importlib.util.spec_from_file_location(f"functions_{identifier}", folder / f"{identifier}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module, module.read_tables([str(folder / "data" / f"{table}.csv") for table in module.COLUMNS])


@pytest.mark.parametrize("name", STATED)
def test_python_has_the_residuals_and_the_jacobian_of_the_compiled_problem(name, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    module, tables = module_of(name, tmp_path)
    begun = module.started(tables, {})
    point = np.concatenate([begun[unknown] for unknown in module.NAMES])
    residuals, jacobian = at_the_start(name)
    assert close(module.residuals(tables, point), residuals)
    assert close(module.jacobian(tables, point), jacobian)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) is here")
@pytest.mark.parametrize("name", STATED)
def test_c_has_the_residuals_the_jacobian_and_the_covariance_of_the_compiled_problem(name, tmp_path):
    folder = written(of_text(SHAPES[name], "c"), tmp_path)
    identifier = name.replace("-", "_")
    assert make(folder, f"{identifier}.o").returncode == 0
    test = (folder / "test.c").read_text()
    paths = test.split("char *const paths[] = {")[1].split("}")[0]
    (folder / "calls.c").write_text(CALLS.format(name=identifier, paths=paths), encoding="utf-8")
    strict = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function")
    made = run("cc", *flags().split(), *strict, "-o", "calls", "calls.c", f"{identifier}.o", "-lm", folder=folder)
    assert made.returncode == 0, made.stderr
    found = run("./calls", folder=folder)
    assert found.returncode == 0, found.stderr
    head, *numbers = found.stdout.split("\n")
    m, n = map(int, head.split())
    values = np.array([float(v) for v in numbers if v])
    residuals, jacobian = at_the_start(name)
    assert close(values[:m], residuals)
    slopes = values[m : m + m * n].reshape(m, n)
    assert close(slopes, jacobian)
    if "constraints" not in SHAPES[name]:
        # inverted by NumPy: ten digits are left of the sixteen where the condition is below a million
        assert close(values[m + m * n :].reshape(n, n) @ (jacobian.T @ jacobian), np.eye(n))


def test_python_derives_what_the_document_derives(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    module, tables = module_of("derived", tmp_path)
    found = module.solve(tables)["derived"]
    solved = mbm.loads(SHAPES["derived"]).solve()
    for name, factor in (("climb", 0.01), ("top", 1.0), ("both", 1.0)):
        assert close(found[name]["value"].ravel() / factor, np.ravel(solved[name].value))
        assert close(found[name]["sigma"].ravel() / factor, np.ravel(solved[name].sigma))


def test_keys_of_several_tables_are_solved_each(tmp_path):
    folder = written(of_text(SHAPES["keys"], "python"), tmp_path)
    found = run(sys.executable, "keys.py", "data/d.csv", "data/e.csv", folder=folder)
    assert found.returncode == 0, found.stderr
    rows = list(csv.DictReader(found.stdout.splitlines()))
    assert [float(row["day"]) for row in rows] == [1.0, 2.0, 3.0]
    # weighted means by hand: day 3 has two rows of `e` only, (2 · 6.3 + 1 · 3.2) / (2² + 1²)
    assert abs(float(rows[2]["value"]) - 15.8 / 5) < 1e-12


@pytest.mark.parametrize("target", ["c", "python"])
def test_the_test_of_a_solver_that_begins_at_the_answer_begins_elsewhere(target):
    files = {file.path: file.content.decode() for file in of_text(SHAPES["similarity"], target)}
    rows = [line.split(",") for line in files["reference.csv"].split("\n") if line]
    start = {row[2]: float(row[4]) for row in rows if row[1] == "start"}
    answer = {row[2]: float(row[4]) for row in rows if row[1] == "number"}
    variance = {row[2]: float(row[4]) for row in rows if row[1] == "covariance" and row[2] == row[3]}
    spread = [abs(start[i] - value) / variance[i] ** 0.5 for i, value in answer.items()]
    assert min(spread) > 0.1  # standard deviations: what the test solves is not solved already
    assert "begins at the answer" in files["README.md"]


def test_a_stated_start_is_where_the_solver_begins(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    module, tables = module_of("joined", tmp_path)
    assert module.started(tables, {})["p"].tolist() == [1.0, 1.0]


def test_keys_that_no_table_has_together_are_refused():
    text = """(problem apart (data d (table (day y) (1 1) (2 3))) (data e (table (kind z) (1 1) (2 2)))
      (unknowns (m :init 0)) (observe d (= y m) :sigma 1) (observe e (= z m) :sigma 1) (for-each day kind))"""
    with pytest.raises(mbm.MbmError) as caught:
        of_text(text, "c")
    assert [d.code.name for d in caught.value.diagnostics] == ["not-emitted"]


def test_a_loss_goes_with_errors_of_other_rows(tmp_path, monkeypatch):
    """SciPy minimises over the line and the offset alone: the best true values of a row are known in closed form."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    module, tables = module_of("errors-beside-loss", tmp_path)
    x, y, s, t, z = (np.asarray(tables[place[0]][place[1]]) for place in ("dx", "dy", "ds", "et", "ez"))

    def objective(p):
        line = (y - p[0] - p[1] * x) ** 2 / (s**2 + (0.1 * p[1]) ** 2)
        far = np.abs(p[0] + p[1] * t + p[2] - z) / 0.2
        return line.sum() + np.where(far > 1.5, 3.0 * far - 2.25, far**2).sum()

    found = module.solve(tables)
    expected = minimize(objective, (5.0, -0.5, 0.1), method="Nelder-Mead", options=EXACTLY)
    for name, value in zip("abc", expected.x, strict=True):
        own = found["estimates"][name]
        assert abs(own["value"] - value) < 1e-5 * own["sigma"]  # a minimum is known to the root of the precision


EXACTLY = {"xatol": 1e-10, "fatol": 1e-14, "maxiter": 10_000, "maxfev": 10_000}
REFUSED = {
    "(observe d (= y (m t)) :sigma 1) (solve :robust lmeds)": ("(m :per d.t :init 0)", "consensus of several parts"),
    "(observe d (= y (m 1)) :sigma 1 :loss cauchy) (observe e d (= t b) :sigma 1)": (
        "(m (vector 1) :init [0]) (b :init 0)",
        "a `:loss` that is not convex",
    ),
    "(observe d (= y m) :sigma 1 :errors ((y 1)) :loss huber)": ("(m :init 0)", "`:errors` beside consensus or a loss"),
    "(observe d (= y m) :errors ((y 1)))": ("(m)", "`:errors` without starts"),
    "(observe d (= y m) :sigma 1 :errors ((y 1))) (observe d (= t m) :sigma unknown :loss huber)": (
        "(m :init 0)",
        "the unknown noise of `d-2` beside the loss of `d-2` and `:errors`",
    ),
    "(observe d (= (hypot y m) 1) :errors ((y 1))) (observe d (= t m) :sigma 1 :loss huber)": (
        "(m :init 0)",
        "`:errors` of `d`, which has no measured side, beside the loss of `d",
    ),
    "(observe d (= y m)) (solve :starts (random 3))": ("(m :init 0)", "`:starts`"),
    "(observe d (= y m)) (solve :robust (gnc :quantile 99%))": ("(m :init 0)", "`gnc` with `:quantile` or `:trust`"),
    "(observe d (= y m)) (window t :length 1 :step 1)": ("(m :init 0)", "`window`"),
    "(observe d (= y m)) (for-each t)": ("(m)", "`for-each` with `m`"),
}
"""Clauses that cannot be compiled: the unknown that they need, and how the message begins."""


@pytest.mark.parametrize("clauses", REFUSED)
def test_what_is_refused_is_refused_where_it_stands_with_what_to_do(clauses):
    unknown, what = REFUSED[clauses]
    text = f"(problem no (data d (table (t y) (0 1) (1 3) (2 2)))\n (unknowns {unknown})\n {clauses})"
    with pytest.raises(mbm.MbmError) as caught:
        of_text(text, "c")
    (found,) = caught.value.diagnostics
    assert found.code.name == "not-emitted"
    assert found.message.startswith(what)
    assert found.hint
    assert found.place is not None


@pytest.mark.parametrize("name", CORRECTED)
def test_true_values_as_unknowns_leave_the_other_estimates_as_the_elimination_has_them(name, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    module, tables = module_of(name, tmp_path)
    found, solved = module.solve(tables)["estimates"], mbm.loads(SHAPES[name]).solve()
    mine = [unknown for unknown in module.NAMES if "." not in unknown]
    assert mine == list(module.NAMES[: len(mine)])
    for unknown in mine:
        value, sigma = found[unknown]["value"].ravel(), found[unknown]["sigma"].ravel()
        wanted = np.ravel(solved[unknown].value)
        # both iterations end 1e-10 standard deviations from the minimum (`:tolerance`)
        assert np.all(np.abs(value - wanted) <= 1e-9 * np.maximum(np.abs(wanted), sigma))
        assert np.allclose(sigma, np.ravel(solved[unknown].sigma), rtol=1e-9, atol=0.0)


def test_functions_need_no_method_of_solution():
    """What a solver would have to refuse is none of the business of serialised functions."""
    text = """(problem no (data d (table (t y) (0 1) (1 3) (2 2))) (unknowns (m :init 0))
      (observe d (= y m)) (solve :starts (random 3)))"""
    assert "residuals.casadi" in {file.path for file in of_text(text, "casadi")}


def test_what_a_constraint_determines_is_compared_by_the_largest_sigma():
    files = {file.path: file.content.decode() for file in of_text(SHAPES["determined"], "c")}
    rows = [line.split(",") for line in files["reference.csv"].split("\n")]
    found = {(row[2], row[3]): (float(row[4]), float(row[5])) for row in rows if row[1:2] == ["covariance"]}
    largest = max(value for value, _ in found.values())
    assert found["2", "2"][0] < 1e-24 * largest  # none, but for the rounding of its root
    assert found["2", "2"][1] == pytest.approx(1e-9 * largest, rel=1e-12)  # a product of two square roots, rounded


@pytest.mark.parametrize("noise", ["0.05", "unknown"])
def test_an_ill_conditioned_problem_passes_the_test_that_it_is_given(noise, tmp_path):
    x = np.linspace(3.0, 9.0, 40)
    y = 1.0 + 0.1 * x + 0.05 * np.random.default_rng(1).standard_normal(40)
    powers = " ".join(f"(* c{i} (^ x {i}))" for i in range(10))
    text = f"""(problem powers
      (data d (table (x y) {" ".join(f"({a!r} {b!r})" for a, b in zip(x.tolist(), y.tolist(), strict=True))}))
      (unknowns {" ".join(f"(c{i} :init 0)" for i in range(10))})
      (observe d (= y (+ {powers})) :sigma {noise}))"""
    folder = written(of_text(text, "python"), tmp_path)
    found = run(sys.executable, "test_powers.py", folder=folder)
    assert found.returncode == 0, found.stdout
    columns = x[:, None] ** np.arange(10)
    condition = np.linalg.cond(columns / np.linalg.norm(columns, axis=0))
    assert condition > 1e8
    rows = list(csv.DictReader((folder / "reference.csv").read_text().splitlines()))
    own = [row for row in rows if row["what"] == "covariance" and row["row"] == row["column"]]
    shares = [float(row["allowed"]) / float(row["value"]) for row in own]
    # An epsilon of the condition, once each way; the condition itself is known to as many digits as that leaves.
    np.testing.assert_allclose(shares, 2.0 * np.finfo(float).eps * condition, rtol=1e-6)


@pytest.mark.skipif(shutil.which("cmake") is None, reason="cmake is not here")
@pytest.mark.slow
def test_cmake_builds_and_tests(tmp_path):
    folder = written(emitted(mbm.loads(SHAPES["family"]), "c"), tmp_path)
    for arguments in (("-B", "build"), ("--build", "build"), ("--build", "build", "--target", "test")):
        made = run("cmake", *arguments, folder=folder)
        assert made.returncode == 0, made.stdout + made.stderr
    assert "100% tests passed" in made.stdout


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("compiler", ["cc", "clang"])
def test_c_is_clean_with_optimisation_too(compiler, name, tmp_path):
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not here")
    folder = written(of_text(SHAPES[name], "c"), tmp_path)
    made = run("make", "all", "test", f"CC={compiler}", "CFLAGS=-O2", folder=folder)
    assert made.returncode == 0, made.stdout + made.stderr


def test_consensus_of_ranges_to_a_known_height_is_refused():
    """Their closed form takes the root of the height's square: no map of the data."""
    angles = np.linspace(0.0, 5.0, 8)
    x, y, h = 3.0 * np.cos(angles), 3.0 * np.sin(angles), 1.0 + 0.1 * angles
    rows = np.column_stack([x, y, h, np.sqrt((x - 1.0) ** 2 + (y - 0.5) ** 2 + h**2)])
    table = " ".join("({})".format(" ".join(map(repr, row))) for row in rows.tolist())
    text = f"""(problem high (data d (table (x y h r) {table})) (unknowns (p (vector 2) :init [1 1]))
      (observe d (= r (norm [(- (p 1) x) (- (p 2) y) h])) :sigma 0.01) (solve :robust lmeds))"""
    assert mbm.loads(text).solve()["p"].value == pytest.approx([1.0, 0.5], abs=1e-6)
    with pytest.raises(mbm.MbmError) as caught:
        of_text(text, "c")
    (found,) = caught.value.diagnostics
    assert found.code.name == "not-emitted"
    assert "this consensus" in found.message
    assert "mbm solve" in found.hint


@pytest.mark.parametrize(("name", "families", "constraints"), [("errors", 1, 0), ("rim", 2, 1)])
def test_a_measured_side_needs_no_true_values_of_its_own(name, families, constraints):
    """y = a + b x has the noise of y; where no side is a measured value alone, the equation is a constraint."""
    problem = with_true_values(mbm.loads(SHAPES[name]).compile().elaborated).problem
    assert sum(unknown.family is not None for unknown in problem.unknowns) == families
    assert sum(block.role is BlockRole.CONSTRAINT for block in problem.blocks) == constraints
