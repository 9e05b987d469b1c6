"""Rank decisions against exact arithmetic: linear problems of small integers, whose rank SymPy decides in fractions."""

from __future__ import annotations

import importlib.util
import sys

import numpy as np
import pytest
import sympy

import mbm
from mbm import compiler
from mbm.compiler import Inputs
from tests.emit.making import written

N = 5
"""Unknowns of each problem."""

SETS = 40

TEXT = """(problem ranks (data d external) (unknowns (p (vector 5) :init 1))
  (observe d (= y (dot p [c1 c2 c3 c4 c5])) :sigma s) {more})"""


def drawn(seed: int) -> np.ndarray:
    """A matrix (m, 5) of small integers: a product of two thin ones, so that its rank is anything up to full."""
    generator = np.random.default_rng(seed)
    m, inner = int(generator.integers(3, 9)), int(generator.integers(1, 7))
    return generator.integers(-3, 4, (m, inner)) @ generator.integers(-3, 4, (inner, N))


MATRICES = [drawn(seed) for seed in range(SETS)]


def exact(matrix: np.ndarray) -> tuple[int, np.ndarray]:
    """The rank, and which unknowns (5,) the rows determine: those that no vector of the null space moves."""
    whole = sympy.Matrix(matrix.tolist())
    moved = [any(vector[k] != 0 for vector in whole.nullspace()) for k in range(N)]
    return whole.rank(), ~np.array(moved)


def table(matrix: np.ndarray, scale: float = 1.0) -> dict[str, np.ndarray]:
    """Data whose derivatives are the matrix, in any unit of the measured values."""
    values = np.random.default_rng(len(matrix)).normal(size=len(matrix))
    return {f"c{k + 1}": scale * matrix[:, k].astype(float) for k in range(N)} | {
        "y": scale * values,
        "s": np.full(len(matrix), 0.1 * scale),
    }


def judged(report, matrix: np.ndarray) -> list[str]:
    """What is wrong with a solve."""
    rank, determined = exact(matrix)
    found, sigma = report.observability, np.asarray(report.estimates[0].sigma)
    wrong = [] if found.rank == rank else [f"rank {found.rank} for {rank}"]
    wrong += [] if report.dof == len(matrix) - rank else [f"{report.dof} degrees of freedom"]
    wrong += [] if (np.isfinite(sigma) == determined).all() else [f"σ {sigma}, determined: {determined}"]
    whole = rank == N
    return wrong + ([] if (report.status == "converged") is whole else [report.status])


@pytest.mark.parametrize("backend", ["native", "casadi", "numpy"])
@pytest.mark.parametrize("scale", [1.0, 1e-7, 1e7])
def test_single_solves(backend, scale):
    compiled = mbm.loads(TEXT.format(more="")).compile(data={"d": table(MATRICES[0])}, backend=backend)
    wrong = [judged(compiled.solve(data={"d": table(m, scale)}).first, m) for m in MATRICES]
    assert wrong == [[] for _ in MATRICES]


@pytest.mark.parametrize("clause", ["(for-each set)", "(window set :length 1 :step 1)"])
def test_many_solves_together(clause):
    tables = [table(m) for m in MATRICES]
    data = {name: np.concatenate([each[name] for each in tables]) for name in tables[0]}
    data["set"] = np.repeat(np.arange(SETS), [len(m) for m in MATRICES])
    solved = mbm.loads(TEXT.format(more=clause)).solve(data={"d": data})
    assert [judged(report, m) for report, m in zip(solved.solves, MATRICES, strict=True)] == [[] for _ in MATRICES]


@pytest.mark.parametrize("members", [SETS // 4, SETS, 2 * SETS])
def test_all_in_one_problem(members):
    """The unknowns of each matrix as members of one family: 50, 200 and 400 numbers, the last of them sparse."""
    matrices = [MATRICES[k % SETS] for k in range(members)]
    tables = [table(m) for m in matrices]
    data = {name: np.concatenate([each[name] for each in tables]) for name in tables[0]}
    data["set"] = np.repeat(np.arange(members), [len(m) for m in matrices])
    text = TEXT.format(more="").replace("(p (vector 5)", "(p (vector 5) :per d.set").replace("dot p", "dot (p set)")
    solved = mbm.loads(text).solve(data={"d": data})
    wanted = [exact(m) for m in matrices]
    assert solved.observability.rank == sum(rank for rank, _ in wanted)
    assert (np.isfinite(solved["p"].sigma) == np.array([determined for _, determined in wanted])).all()


def test_estimators():
    compiled = mbm.loads(TEXT.format(more="")).compile(data={"d": table(MATRICES[0])})
    same = [m for m in MATRICES if len(m) == len(MATRICES[0])]
    estimator = compiled.estimator("y", *(f"c{k + 1}" for k in range(N)))
    tables = [table(m) for m in same]
    found = estimator.many(*(np.stack([t[i.split(".")[1]] for t in tables]) for i in estimator.inputs))
    for sigma, status, matrix in zip(found.sigma, found.status, same, strict=True):
        rank, determined = exact(matrix)
        assert (status == "converged") is (rank == N)
        assert (np.isfinite(sigma) == determined).all()


def test_generated_solvers(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    problem = mbm.loads(TEXT.format(more=""))
    tables = {"d": table(MATRICES[0])}
    found = compiler.elaborated(problem.program, problem.name, Inputs(tables=tables), problem.registry)
    folder = written(compiler.emitted(found, "python", problem.registry), tmp_path)
    spec = importlib.util.spec_from_file_location("ranks", folder / "ranks.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for matrix in MATRICES[:12]:
        rank, determined = exact(matrix)
        answer = module.solve({"d": table(matrix)})
        assert answer["freedom"] == len(matrix) - rank
        assert (answer["status"] == "converged") is (rank == N)
        assert (np.isfinite(np.diag(answer["covariance"])) == determined).all()
