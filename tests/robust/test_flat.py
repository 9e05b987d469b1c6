"""Huber's loss where no row is inside its corner: the cost is linear there, and what only such rows tell is free."""

from __future__ import annotations

import importlib.util
import shutil
import sys

import numpy as np
import pytest

import mbm
from mbm.estimation.minimise import sparsity
from mbm.report.types import SolveStatus
from tests.emit.making import of_text, run, written

LINE = "(data t external) (unknowns (a :init 0) (b :init 0)) (observe t (= y (+ a (* b x))) {noise} :loss huber)"

# Two of z below b and two above, all of them hundreds of deviations off: b may move at no cost. Four y tell a.
BESIDE = """
(data d (table (y z) (0.9 -1) (1.1 -1.2) (1.2 1.1) (0.8 0.9)))
(unknowns (a :init 0) (b :init 0.1))
(observe d (= y a) :sigma 0.2)
(observe d (= z b) :sigma 0.001 :loss huber)
(derive (both (+ a b)) (twice (* 2 a)))
"""
FLAT = """
(data d (table (z) (-1) (-1.2) (1.1) (0.9)))
(unknowns (b :init 0.1))
(observe d (= z b) :sigma 0.001 :loss huber)
"""


@pytest.mark.parametrize("backend", ["auto", "numpy", "casadi"])
@pytest.mark.parametrize("far", [0.0, 50.0])
@pytest.mark.parametrize("noise", ["", ":sigma 0.001"])
def test_a_line_with_no_row_inside_the_corner_is_free(backend, far, noise):
    x = np.linspace(0, 5, 4)
    y = 1 + 2 * x + 0.1 * np.random.default_rng(28).normal(size=4)
    y[0] += far
    solve = mbm.loads(f"(problem line {LINE.format(noise=noise)})").solve(data={"t": {"x": x, "y": y}}, backend=backend)
    assert solve.first.status is SolveStatus.UNOBSERVABLE
    reasons = {each.name: each.reason for each in solve.first.estimates}
    for name in ("a", "b"):
        assert np.isnan(solve[name].sigma)
        assert reasons[name] == "the data do not determine it"
    assert [each.unknowns for each in solve.observability.unobservable] == [("a",), ("b",)]


def check_beside(solve):
    """By hand: a is the mean of four with 0.2 each; nothing that b enters has a standard deviation."""
    assert solve.first.status is SolveStatus.UNOBSERVABLE
    # a few operations of rounding
    assert solve["a"].sigma == pytest.approx(0.1, rel=1e-12)
    assert solve["twice"].sigma == pytest.approx(0.2, rel=1e-12)
    reasons = {each.name: each.reason for each in (*solve.first.estimates, *solve.first.derived)}
    for name in ("b", "both"):
        assert np.isnan(solve[name].sigma)
        assert reasons[name] == "the data do not determine it"
    assert [each.unknowns for each in solve.observability.unobservable] == [("b",)]


@pytest.mark.parametrize("backend", ["auto", "numpy", "casadi"])
def test_what_other_rows_determine_keeps_its_deviation(backend):
    check_beside(mbm.loads(f"(problem p {BESIDE})").solve(backend=backend))


def test_so_it_does_in_sparse_problems(monkeypatch):
    monkeypatch.setattr(sparsity, "MOST_DENSE", 0)
    monkeypatch.setattr(sparsity, "SPARSE", 1.0)
    # both in one equation of two, so that the problem does not fall apart
    tied = BESIDE.replace("(derive", "(observe d (= (* 0 y) (* 0 a b)) :sigma 1) (derive")
    solve = mbm.loads(f"(problem p {tied})").solve()
    assert solve.first.method == "dogleg-sparse"
    check_beside(solve)


def test_one_direction_of_a_loss_beside_rows_that_tell_the_other():
    """The sum is told without a loss, the difference only by rows beyond the corner: neither a nor b is known."""
    text = BESIDE.replace("(= y a)", "(= y (+ a b))").replace("(= z b)", "(= z (- a b))").replace("(twice (* 2 a))", "")
    solve = mbm.loads(f"(problem p {text})").solve()
    assert solve.first.status is SolveStatus.UNOBSERVABLE
    assert np.isnan([solve["a"].sigma, solve["b"].sigma]).all()
    assert solve["both"].sigma == pytest.approx(0.1, rel=1e-9)
    assert [set(each.unknowns) for each in solve.observability.unobservable] == [{"a", "b"}]


def test_solves_side_by_side_say_the_same():
    """The window whose misfits are all gross has no deviation; the others keep theirs, as solves by themselves."""
    text = """
    (problem w (data d external)
      (unknowns (v :init 0.1) (b :init 0 :in (-1 1.5)))
      (observe d (= y (+ (* v x) b)) :sigma 0.1 :loss huber)
      (constraints (= v 0.5))
      (window t :length 2 :step 2))
    """
    generator = np.random.default_rng(1)
    t = 0.05 + np.arange(0, 20, 0.2)
    x = generator.normal(size=t.size)
    y = 0.5 * x + 0.3 + 0.1 * generator.normal(size=t.size)
    gross = (t > 6) & (t < 8)
    y[gross] += np.where(np.arange(gross.sum()) % 2, 40.0, -40.0)
    free, problem = 0, mbm.loads(text)
    many = problem.solve(data={"d": {"t": t, "x": x, "y": y}})
    plain = problem.solve(data={"d": {"t": t, "x": x, "y": y}}, backend="numpy")
    for own, other in zip(many.solves, plain.solves, strict=True):
        assert own.status is other.status
        found, wanted = ([float(e.sigma) for e in each.estimates] for each in (own, other))
        # descents end within 1e-8 deviations of one another
        np.testing.assert_allclose(found, wanted, rtol=1e-6)
        free += own.status is SolveStatus.UNOBSERVABLE
    assert free == 1


def test_generated_python(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    folder = written(of_text(f"(problem flat {FLAT})", "python"), tmp_path)
    spec = importlib.util.spec_from_file_location("flat", folder / "flat.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found = module.solve(module.read_tables([str(folder / "data" / "d.csv")]))
    assert found["status"] == "unobservable"
    assert np.isnan(found["estimates"]["b"]["sigma"]).all()
    assert found["freedom"] == mbm.loads(f"(problem flat {FLAT})").solve().first.dof
    assert run(sys.executable, "test_flat.py", folder=folder).returncode == 0


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) is here")
def test_generated_c(tmp_path):
    folder = written(of_text(f"(problem flat {FLAT})", "c"), tmp_path)
    made = run("make", "all", "test", "CFLAGS=-O0", folder=folder)
    assert made.returncode == 0, made.stdout + made.stderr
    found = run("./flat", "data/d.csv", folder=folder)
    assert found.returncode == 1
    assert all(line.split(",")[-1] == "" for line in found.stdout.splitlines()[1:])


@pytest.mark.parametrize("backend", ["numpy", "native", "casadi"])
def test_rows_without_weight_determine_nothing(backend: str) -> None:
    problem = mbm.loads("""(problem far (data d (table (x) (1.5) (2.25) (3.5) (4.75) (6.5)))
      (unknowns (a :init 1) (b :init 0 :sigma 2)) (observe d (= [a a] (* x [10 a])) :sigma 1 :loss tukey))""")
    solve = problem.solve(backend=backend).solves[0]
    assert solve.status == "unobservable"
    assert [name for each in solve.observability.unobservable for name in each.unknowns] == ["a"]
    assert problem.solve(backend=backend)["b"].sigma == pytest.approx(2.0)
