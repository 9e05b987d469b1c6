"""Generated solvers with constraints on data that they were not made with, against the general path's exact method."""

from __future__ import annotations

import csv
import importlib.util
import shutil
import sys

import numpy as np
import pytest

import mbm
from tests.emit.making import make, of_text, run, written

KINDS = {
    "circle": ("(exp (+ (* a x) b))", "(= (+ (* a a) (* b b)) 0.3)", "ab"),
    "linear": ("(exp (+ (* a x) b))", "(= (+ a b) 0.6)", "ab"),
    "active": ("(exp (+ (* a x) b))", "(<= (* a b) 0.03)", "ab"),
    "several": (
        "(+ (* a (exp (* -1 b x))) (* q x) w)",
        "(= (* a b) (+ 0.5 q)) (<= (+ (* q q) (* w w)) 0.4) (<= a 3)",
        "abqw",
    ),
}
STARTS = {"a": 0.5, "b": 0.5, "q": 0.3, "w": 0.3}
QUICK = ("circle",)

MADE_WITH = "(0.1 1.6) (0.4 1.9) (0.6 2.2) (0.8 2.3) (1.0 2.8) (1.2 3.0) (1.4 3.6)"


def text(kind, rows):
    """The problem with data of its own (``rows`` None: external ones)."""
    model, constraints, names = KINDS[kind]
    unknowns = " ".join(f"({name} :init {STARTS[name]})" for name in names)
    data = "external" if rows is None else f"(table (x y) {rows})"
    solve = "(solve :constraints exact)"
    observed = f"(observe d (= y {model}) :sigma 0.05)"
    return f"(problem {kind} (data d {data}) (unknowns {unknowns}) {observed} (constraints {constraints}) {solve})"


@pytest.mark.parametrize("kind", [k if k in QUICK else pytest.param(k, marks=pytest.mark.slow) for k in KINDS])
def test_random_data(kind, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    folder = written(of_text(text(kind, MADE_WITH), "python"), tmp_path)
    spec = importlib.util.spec_from_file_location(f"constrained_{kind}", folder / f"{kind}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    compared = 0
    for seed in range(8):
        generator = np.random.default_rng(seed)
        x = np.sort(generator.uniform(0.1, 1.5, 12))
        y = np.exp(0.6 * x + 0.4) + 0.05 * generator.standard_normal(12)
        found = module.solve({"d": {"x": x, "y": y}})
        wanted = mbm.loads(text(kind, None)).solve(data={"d": {"x": x, "y": y}}, backend="casadi")
        assert found["status"] == wanted.solves[0].status.replace("_", "-") == "converged"
        assert found["freedom"] == wanted.solves[0].dof
        if abs(found["cost"] - wanted.solves[0].cost) > 1e-6 * found["cost"]:
            continue  # another minimum: both methods go their own way from the start
        compared += 1
        for name in KINDS[kind][2]:
            value, sigma = found["estimates"][name]["value"].item(), found["estimates"][name]["sigma"].item()
            size = max(abs(wanted[name].value), wanted[name].sigma)
            assert abs(value - wanted[name].value) <= 1e-9 * size
            assert sigma == pytest.approx(wanted[name].sigma, rel=1e-8, abs=1e-9 * size)
    assert compared >= 6


HELD = {
    "sum of both": ("(+ a b)", True),
    "scaled": ("(* 2 (+ a b))", True),
    "one": ("a", True),
    "equation": ("(+ c a)", False),
    "bound": ("(* 3 c)", True),
    "square": ("(* e e)", True),
    "different limits": ("(+ e b)", True),
    "no slope": ("(^ (- c 1.2) 2)", True),
    "along": ("f", False),
    "across": ("(+ f g)", True),
    "free": ("h", False),
    "beside": ("(+ c h)", False),
}
"""Quantities, and whether they change only as estimates leave the limits that hold them.

The equation stays, whatever holds beside it; along its inequality f changes with the data.
"""
LIMITED = f"""(problem limited
  (data d (table (x y z) (0.1 1.6 1) (0.4 1.9 2) (0.6 2.2 1) (0.8 2.3 2)))
  (unknowns (a :init 0.5) (b :init 0.5) (c :init 1 :in (0 1.2)) (e :init 1) (f :init 0) (g :init 0) (h :init 0))
  (observe d (= y (+ (* a x) b)) :sigma 0.05)
  (observe d (= [z z y z y] [c e f g h]) :sigma 0.05)
  (constraints (<= (+ a b) 1.8) (<= (* e 2) 2.4) (= (+ c a) 2.0) (<= (+ f g) 1))
  (derive {" ".join(f"(q{i} {each})" for i, (each, _) in enumerate(HELD.values()))}))"""


def held_in(lines: str) -> list[bool]:
    """Which derived quantities a solver prints without a standard deviation."""
    return [row["sigma"] == "" for row in csv.DictReader(lines.splitlines()) if row["name"].startswith("q")]


def test_what_limits_hold_has_no_standard_deviation(tmp_path):
    wanted = [held for _, held in HELD.values()]
    result = mbm.loads(LIMITED).solve()
    assert [bool(np.isnan(result[f"q{i}"].sigma)) for i in range(len(wanted))] == wanted
    folder = written(of_text(LIMITED, "python"), tmp_path / "python")
    assert held_in(run(sys.executable, "limited.py", "data/d.csv", folder=folder).stdout) == wanted
    if shutil.which("cc") is None:
        return
    folder = written(of_text(LIMITED, "c"), tmp_path / "c")
    assert make(folder).returncode == 0
    assert held_in(run("./limited", "data/d.csv", folder=folder).stdout) == wanted


CONTRADICTORY = """(problem apart (data d (table (x y) (0 1.1) (1 2.9) (2 5.2) (3 6.8) (4 9.1)))
  (unknowns (a :init 1) (b :init 2)) (observe d (= y (+ a (* b x))) :sigma {sigma}) (constraints {limits})
  (derive (twice (* 2 a))) {solve})"""


@pytest.mark.parametrize("limits", ["(= b 2) (= b 3)", "(> b 4) (< b 3)"])
@pytest.mark.parametrize(("sigma", "solve"), [("0.1", ""), ("unknown", ""), ("0.1", "(solve :robust lmeds)")])
def test_where_no_point_meets_all_constraints_there_is_no_standard_deviation(limits, sigma, solve, tmp_path):
    """As `mbm solve` has it: the point is a compromise that no data decide."""
    problem = CONTRADICTORY.format(limits=limits, sigma=sigma, solve=solve)
    assert np.isnan(mbm.loads(problem).solve()["a"].sigma)
    folder = written(of_text(problem, "python"), tmp_path)
    ran = run(sys.executable, "apart.py", "data/d.csv", folder=folder)
    assert "infeasible" in ran.stderr
    assert [row["sigma"] for row in csv.DictReader(ran.stdout.splitlines())] == ["", "", ""]


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) is here")
def test_nor_in_c(tmp_path):
    problem = CONTRADICTORY.format(limits="(= b 2) (= b 3)", sigma="unknown", solve="")
    folder = written(of_text(problem, "c"), tmp_path)
    made = make(folder, "all", "test")
    assert made.returncode == 0, made.stdout + made.stderr
    ran = run("./apart", "data/d.csv", folder=folder)
    assert [row["sigma"] for row in csv.DictReader(ran.stdout.splitlines())] == ["", "", ""]
