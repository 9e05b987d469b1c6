"""Powers and logarithms whose data are 0: their limit is 0 whatever the unknowns are, and so are their derivatives."""

from __future__ import annotations

import csv
import io
import sys
from shutil import which

import numpy as np
import pytest
from scipy.optimize import curve_fit

import mbm
from mbm.api.files import emit_file
from mbm.report.options import SolveOptions
from tests.emit.making import make, run, written

X = np.array([1.0, 2.0, 3.0, 4.0])
Y = np.array([1.1, 2.8, 5.3, 8.1])
MODELS = {
    "(^ (/ x e) b)": lambda x, e, b: (x / e) ** b,
    "(* e (^ x b))": lambda x, e, b: e * x**b,
    "(* b (sqrt (/ x e)) (+ 1 (* e x)))": lambda x, e, b: b * np.sqrt(x / e) * (1 + e * x),
    "(* e (^ (* 2 x) (/ b 2)))": lambda x, e, b: e * (2 * x) ** (b / 2),
}
AT = 1.5
"""The reading at x = 0, where each model is 0: it adds 1.5² to the cost, and nothing to the estimates."""


def text(model, rows=f"(0 {AT}) ", extra=""):
    rows += " ".join(f"({x} {y})" for x, y in zip(X, Y, strict=True))
    return f"""(problem p (data d (table (x y) {rows})) (unknowns (e :init 1) (b :init 1.4))
      (observe d (= y {model}) :sigma 1){extra})"""


def fitted(model):
    """By SciPy, without the row at 0."""
    found, covariance = curve_fit(
        MODELS[model], X, Y, (1.0, 1.4), sigma=np.ones(4), absolute_sigma=True, ftol=1e-13, xtol=1e-13
    )
    return found, np.sqrt(np.diag(covariance))


@pytest.mark.parametrize("backend", ["native", "casadi", "numpy"])
@pytest.mark.parametrize("model", MODELS)
def test_a_row_at_zero_has_its_limit(model, backend):
    values, sigmas = fitted(model)
    result = mbm.loads(text(model)).solve(backend=backend)
    # SciPy's own tolerance, and its differences for the covariance.
    np.testing.assert_allclose([result["e"].value, result["b"].value], values, rtol=1e-6)
    np.testing.assert_allclose([result["e"].sigma, result["b"].sigma], sigmas, rtol=1e-4)
    without = mbm.loads(text(model, "")).solve(backend=backend)
    assert result.cost == pytest.approx(without.cost + AT**2, rel=1e-9)


def test_batches_have_it():
    rows = " ".join(f"({k} {x} {y})" for k in (1, 2) for x, y in zip((0.0, *X), (AT, *Y), strict=True))
    many = mbm.loads(
        f"""(problem p (data d (table (k x y) {rows})) (unknowns (e :init 1) (b :init 1.4))
          (observe d (= y (^ (/ x e) b)) :sigma 1) (for-each k))"""
    ).solve()
    for each in many.solves:
        np.testing.assert_allclose([each["e"].value, each["b"].value], fitted("(^ (/ x e) b)")[0], rtol=1e-6)


FIXED = [
    ("(x0 :init 7 :fixed true)", "(/ (- x x0) e)"),
    ("(v (vector 2) :init [0 7] :fixed true)", "(/ (- x (v 2)) e)"),
    ("(v (vector 2) :init [0 7] :fixed [false true])", "(/ (- x (v 2)) (+ e (* 0 (v 1))))"),
    ("(T (pose 2) :at (pose2 7 0 0) :fixed true)", "(/ (- x ((translation T) 1)) e)"),
]


@pytest.mark.parametrize(("unknown", "base"), FIXED)
def test_a_fixed_unknown_counts_as_data(unknown, base):
    """The same data and estimates with x shifted by 7, which an unknown that is fixed takes off again."""
    rows = " ".join(f"({x + 7} {y})" for x, y in zip((0.0, *X), (AT, *Y), strict=True))
    result = mbm.loads(
        f"""(problem p (data d (table (x y) {rows})) (unknowns {unknown} (e :init 1) (b :init 1.4))
          (observe d (= y (^ {base} b)) :sigma 1) {"(constraints (= (v 1) 0))" if "false" in unknown else ""})"""
    ).solve()
    values, sigmas = fitted("(^ (/ x e) b)")
    np.testing.assert_allclose([result["e"].value, result["b"].value], values, rtol=1e-6)
    np.testing.assert_allclose([result["e"].sigma, result["b"].sigma], sigmas, rtol=1e-4)


C = pytest.param("c", marks=pytest.mark.skipif(which("cc") is None, reason="there is no C compiler"))


@pytest.mark.parametrize("target", ["python", C])
def test_generated_solvers_have_it(target, tmp_path):
    (tmp_path / "p.mbm").write_text(text("(^ (/ x e) b)"), encoding="utf-8")
    folder = written(emit_file(tmp_path / "p.mbm", SolveOptions(), target), tmp_path / "out")
    if target == "c":
        assert make(folder, "p", watched=False).returncode == 0
    command = ["./p"] if target == "c" else [sys.executable, "p.py"]
    rows = {row[0]: row for row in csv.reader(io.StringIO(run(*command, "data/d.csv", folder=folder).stdout))}
    values, sigmas = fitted("(^ (/ x e) b)")
    np.testing.assert_allclose([float(rows[name][1]) for name in "eb"], values, rtol=1e-6)
    np.testing.assert_allclose([float(rows[name][2]) for name in "eb"], sigmas, rtol=1e-4)


@pytest.mark.parametrize(
    "product", ["(* x (log x))", "(* (/ x 1s) (log (/ x 1s)))", "(- (* x (log (* 2 x))) (* x (log 2)))"]
)
def test_entropy_at_zero(product):
    """x·log x is 0 at 0: a line through the origin of x log x."""
    rows = text(f"(+ b (* e {product}))")
    result = mbm.loads(rows).solve()
    x = np.array([0.0, *X])
    columns = np.column_stack([np.ones(5), np.where(x > 0, x * np.log(np.maximum(x, 1e-300)), 0.0)])
    values = np.linalg.lstsq(columns, np.array([AT, *Y]), rcond=None)[0]
    np.testing.assert_allclose([result["b"].value, result["e"].value], values, rtol=1e-9)


@pytest.mark.parametrize(
    "model",
    [
        pytest.param("(* e (^ x (- b 3)))", id="infinite at 0"),
        pytest.param("(* e (exp (* b (log x))))", id="no limit that the form shows"),
        pytest.param("(* e (/ (* x (log x)) (- (exp x) 1)))", id="log x, beside a quotient of zeros"),
        pytest.param("(* e (^ (/ x (- (exp x) 1)) b))", id="a quotient of zeros to a power"),
    ],
)
def test_what_has_no_limit_names_its_row(model):
    result = mbm.loads(text(model)).solve()
    assert result.status == "attention"
    messages = [each.message for each in result.diagnostics]
    assert any("no finite value" in each and "row 1" in each for each in messages), messages
    assert "NaN" not in result.to_json()


def test_slopes_that_vanish_nowhere_else_are_kept():
    """Where the base is 0 by its unknowns, and not by its data, the slope is that of the power: 1 for b = 1."""
    compiled = mbm.loads(text("(* e (^ (- x c) 1.5))", "(1 0) ").replace("(e :init 1)", "(e :init 1) (c :init 1)"))
    jacobian = compiled.compile().jacobian(np.zeros(3))
    assert np.isfinite(jacobian).all()


def test_what_an_expression_depends_on_is_found_once_for_each_node():
    """Sixty sums of a value with itself: a walk along all ways through them would not end."""
    model = "(^ (/ x e) b)"
    for _ in range(60):
        model = f"(let ((a {model})) (+ (/ a 2) (/ (* a (+ 1 (^ a (* 0 b)))) 4)))"
    result = mbm.loads(text(model, "")).solve()
    np.testing.assert_allclose([result["e"].value, result["b"].value], fitted("(^ (/ x e) b)")[0], rtol=1e-6)


def test_derived_numbers_without_unknowns_have_it():
    """The sum of x log x over X and 0, and 0 to an estimated power."""
    extra = "(derive (s (* 5 (mean d (* x (log x))))) (z (+ e (^ 0 b))))"
    result = mbm.loads(text("(* e (^ x b))", extra=extra)).solve()
    assert result["s"].value == pytest.approx(np.sum(X * np.log(X)), rel=1e-12)
    np.testing.assert_allclose(
        [result["z"].value, result["z"].sigma], [result["e"].value, result["e"].sigma], rtol=1e-9
    )


def test_products_of_products_are_looked_at_once():
    """a^(2^60), each square once: as a tree it has 10^18 factors, and finding them would not end."""
    squares = " ".join(f"(x{k + 1} (* x{k} x{k}))" for k in range(60))
    text = f"(problem p (unknowns (a :init 1)) (observe (= 1 (let* ((x0 a) {squares}) x60)) :sigma 1))"
    assert mbm.loads(text).solve()["a"].value == pytest.approx(1.0, abs=1e-15)
