"""Problems without unknowns: evaluations of type B, and fixed models against data."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

import mbm
from mbm.cli.main import run

TYPE_B = """
(problem product
  (constants (a 10 :sigma 0.1) (b 2 :prior (rectangular 1 3)) (v [1 2]))
  (derive (q (* a b)) (w (* b v)) (s (+ q a))))
"""
FIXED = """
(problem fixed
  (data t (table (x y k) (1 2.1 1) (2 3.9 1) (3 6.2 2) (4 7.9 2)))
  (constants (a 2 :sigma 0.1))
  (observe t (= y (* a x)) :sigma {sigma})
  (derive (m (* a x) :over t)){more})
"""
RESIDUALS = np.array([2.1, 3.9, 6.2, 7.9]) - 2.0 * np.arange(1.0, 5.0)


def test_derived_quantities_have_the_uncertainty_of_the_constants() -> None:
    """Sums of squares by hand: ∂q/∂a = 2, ∂q/∂b = 10, ∂s/∂a = 3, ∂s/∂b = 10."""
    found = mbm.loads(TYPE_B).solve()
    rectangular = 1.0 / np.sqrt(3.0)
    assert found.status == "ok"
    assert found.first.message == "there are no unknowns: the quantities are computed from what is given"
    assert (float(found["q"].value), float(found["s"].value)) == (20.0, 30.0)
    assert float(found["q"].sigma) == pytest.approx(np.hypot(2 * 0.1, 10 * rectangular))
    assert float(found["s"].sigma) == pytest.approx(np.hypot(3 * 0.1, 10 * rectangular))
    np.testing.assert_allclose(found["w"].sigma, [rectangular, 2 * rectangular])
    matrix = found.first.derived_covariance.matrix
    assert matrix[0, 3] == pytest.approx(2 * 3 * 0.1**2 + 10 * 10 * rectangular**2)
    assert str(found).splitlines()[-1].startswith("  s ")  # no misfit is spoken of


def test_a_fixed_model_is_judged_by_its_residuals() -> None:
    found = mbm.loads(FIXED.format(sigma="0.1", more="")).solve()
    cost = float(np.square(RESIDUALS / 0.1).sum())
    assert found.first.cost == pytest.approx(cost)
    assert found.first.dof == 4
    slopes = np.arange(1.0, 5.0) * 0.1 / 0.1  # of whitened residuals by the constant, times its standard deviation
    told = np.linalg.solve(np.eye(4) + np.outer(slopes, slopes), RESIDUALS / 0.1)
    assert found.first.chi2_p == pytest.approx(chi2.sf(RESIDUALS / 0.1 @ told, 4))  # generalised least squares
    np.testing.assert_allclose(found.residuals("t")["whitened"], -RESIDUALS / 0.1)
    np.testing.assert_allclose(found["m"].sigma, 0.1 * np.arange(1.0, 5.0))


def test_unknown_noise_of_a_fixed_model_is_the_root_mean_square() -> None:
    text = FIXED.format(sigma="unknown", more="")
    found = mbm.loads(text.replace(":sigma 0.1", "")).solve()
    assert found.first.noise["t"] == pytest.approx(np.sqrt(np.square(RESIDUALS).mean()))
    rows = np.arange(1.0, 5.0)
    moved = rows @ rows * 0.1**2  # the variance that the constant adds along the one direction in which it moves rows
    along = (RESIDUALS @ rows) ** 2 / (rows @ rows)
    rest = RESIDUALS @ RESIDUALS - along
    likelihood = minimize_scalar(
        lambda v: 3 * np.log(v) + np.log(v + moved) + rest / v + along / (v + moved),
        bounds=(1e-3, 1.0), method="bounded", options={"xatol": 1e-12},
    )  # fmt: skip
    # 1e-6: half of a difference of two solves
    assert mbm.loads(text).solve().first.noise["t"] == pytest.approx(np.sqrt(likelihood.x), rel=1e-6)


@pytest.mark.parametrize("backend", ["native", "casadi", "numpy"])
def test_every_backend_evaluates(backend: str) -> None:
    found = mbm.loads(FIXED.format(sigma="0.1", more="")).solve(backend=backend)
    assert found.first.cost == pytest.approx(float(np.square(RESIDUALS / 0.1).sum()))


def test_each_key_has_its_rows() -> None:
    found = mbm.loads(FIXED.format(sigma="0.1", more=" (for-each k)")).solve()
    costs = [solve.cost for solve in found.solves]
    np.testing.assert_allclose(costs, np.square(RESIDUALS / 0.1).reshape(2, 2).sum(axis=1))


def test_many_keys_are_as_one() -> None:
    text = (
        "(problem p (data t external) (constants (a 2)) (observe t (= y (* a x)) :sigma 0.1)"
        " (derive (q (* 2 a))) (for-each k))"
    )
    k = np.repeat(np.arange(40.0), 3)
    y = 2.0 * k + 0.1 * np.random.default_rng(1).standard_normal(k.size)
    found = mbm.loads(text).solve(data={"t": {"k": k, "x": k, "y": y}})
    costs = [solve.cost for solve in found.solves]
    np.testing.assert_allclose(costs, np.square((y - 2.0 * k) / 0.1).reshape(40, 3).sum(axis=1))
    assert {float(solve.derived[0].value.item()) for solve in found.solves} == {4.0}


def test_the_command_line_checks_solves_and_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("b.mbm").write_text(TYPE_B, encoding="utf-8")
    assert run(["check", "b.mbm"]) == 0
    assert run(["explain", "b.mbm"]) == 0
    assert run(["solve", "b.mbm", "--json", "b.json", "--csv", "b.csv", "--set", "b=2.5", "--intervals"]) == 0
    solve = json.loads(Path("b.json").read_text(encoding="utf-8"))["solves"][0]
    assert solve["method"] == "evaluation"
    assert solve["derived"]["q"]["value"] == 25.0
    assert (solve["estimates"], solve["dof"]) == ({}, 0)
    assert Path("b.csv").read_text(encoding="utf-8").splitlines()[1].startswith("converged,0.0,0,,,25.0,")


def test_a_quantity_without_a_value_is_named() -> None:
    found = mbm.loads("(problem p (constants (a 2)) (derive (z (log (- 2 a)))))").solve()
    assert [d.code.name for d in found.first.diagnostics] == ["derived-not-finite"]


def test_a_row_without_a_value_is_named() -> None:
    text = "(problem p (data t (table (y) (1) (2))) (constants (a 2)) (observe t (= y (log (- y a))) :sigma 1))"
    found = mbm.loads(text).solve()
    assert found.status == "attention"
    assert found.first.status == "not-converged"


def test_what_needs_something_to_estimate_says_so() -> None:
    problem = mbm.loads(FIXED.format(sigma="0.1", more="").replace(":sigma 0.1)", ")", 1))
    with pytest.raises(mbm.MbmError, match="a problem with nothing to estimate has no estimator"):
        problem.compile().estimator()
    assert problem.compile().residuals([]).shape == (4,)
    assert problem.compile().jacobian([]).shape == (4, 0)


@pytest.mark.parametrize("target", ["c", "python"])
def test_no_solver_is_generated(
    target: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("b.mbm").write_text("(problem p (constants (a 2)) (derive (q (* 2 a))))", encoding="utf-8")
    assert run(["compile", "b.mbm", "--target", target, "-o", "out"]) == 2
    assert "a problem without unknowns cannot be compiled" in capsys.readouterr().err
