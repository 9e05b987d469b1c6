"""Constants with an uncertainty, against the covariance by NumPy and against brute force."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2, t

import mbm
from mbm.cli.main import run

X, Y = np.array([1.0, 2.0, 3.0, 4.0]), np.array([10.1, 20.3, 29.9, 40.0])
ROWS = " ".join(f"({x} {y})" for x, y in zip(X.tolist(), Y.tolist(), strict=True))
TEXT = """
(problem considered
  (constants (g {g}) (c {c}))
  (data d (table (x y) {rows}))
  (unknowns (a) (b))
  (observe d (= y (+ (* a g x) b c)) :sigma {sigma})
  (derive (ag (* a g)) (w (+ a (* 3 c) g))))
"""


def solved(g: str = "10 :sigma 0.01", c: str = "1 :prior (rectangular 0.9 1.1)", sigma: str = "0.1") -> Any:
    return mbm.loads(TEXT.format(g=g, c=c, rows=ROWS, sigma=sigma)).solve()


def _closed() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Estimates, covariance of the data alone, S u, and the derivatives of the derived quantities, by hand."""
    design = np.column_stack([10 * X, np.ones(4)])
    own = np.linalg.inv(design.T @ design) * 0.1**2
    a, b = np.linalg.lstsq(design, Y - 1, rcond=None)[0]
    sensitivity = np.array([[-a / 10 * 0.01, 0.0], [0.0, -0.2 / np.sqrt(12)]])  # rows a, b; columns g, c
    return np.array([a, b]), own, sensitivity, np.array([[10.0, 0.0], [1.0, 0.0]])


def test_estimates_are_those_of_the_value_and_the_covariance_gains() -> None:
    found, exact = solved(), solved("10", "1")
    values, own, sensitivity, slopes = _closed()
    wanted = own + sensitivity @ sensitivity.T
    assert [float(found[name].value) for name in "ab"] == pytest.approx(values)
    assert found.first.cost == exact.first.cost
    # half of a difference over ± u = 0.001 g: off by a third of that squared
    np.testing.assert_allclose(found.covariance.matrix, wanted, rtol=2e-6)
    np.testing.assert_allclose([float(found[n].sigma) for n in "ab"], np.sqrt(np.diag(wanted)), rtol=1e-6)
    direct = np.array([[values[0] * 0.01, 0.0], [0.01, 3 * 0.2 / np.sqrt(12)]])  # what g and c do beside a
    moves = slopes @ sensitivity + direct
    derived = slopes @ own @ slopes.T + moves @ moves.T
    np.testing.assert_allclose(found.first.derived_covariance.matrix, derived, rtol=2e-6, atol=1e-12)


def test_a_product_that_the_data_fix_does_not_feel_the_constant() -> None:
    assert float(solved()["ag"].sigma) == pytest.approx(float(solved("10", "1")["ag"].sigma), rel=1e-9)


def test_degrees_of_freedom_are_those_of_welch_and_satterthwaite() -> None:
    found, exact = solved("10 :sigma 0.5", "1", "unknown"), solved("10", "1", "unknown")
    own, whole = float(exact["a"].sigma), float(found["a"].sigma)
    assert float(exact["a"].dof) == pytest.approx(2.0)
    dof = 2.0 * (whole / own) ** 4
    assert float(found["a"].dof) == pytest.approx(dof)
    assert float(found["a"].k) == pytest.approx(t.ppf(0.975, dof))
    assert float(found["a"].U) == pytest.approx(t.ppf(0.975, dof) * whole)


def test_one_value_is_shared_by_all_keys() -> None:
    rows = " ".join(f"({k} {x} {y * k})" for k in range(1, 30) for x, y in zip(X.tolist(), Y.tolist(), strict=True))
    text = TEXT.format(g="10 :sigma 0.01", c="1", rows=rows, sigma="0.1").replace("(x y)", "(k x y)")
    many = mbm.loads(text[: text.rindex(")")] + "(for-each k))").solve()
    assert len(many.solves) == 29
    for k in (1, 29):
        part = " ".join(f"({x} {y * k})" for x, y in zip(X.tolist(), Y.tolist(), strict=True))
        one = mbm.loads(TEXT.format(g="10 :sigma 0.01", c="1", rows=part, sigma="0.1")).solve()
        mine = many.document()["solves"][k - 1]["estimates"]["a"]
        assert mine["sigma"] == pytest.approx(float(one["a"].sigma), rel=1e-9)
        assert mine["interval"] == pytest.approx(one["a"].interval(), rel=1e-9)


def test_vectors_and_rotations() -> None:
    """A turn by a known angle with an uncertainty: the pose's rotation has it, about the body's axis."""
    text = """
    (problem turned
      (constants (alpha 0.3 :sigma 0.002) (o [1 2 3] :sigma [0.1 0 0.2]))
      (data p (table (x y z u v w) (1 0 0 0 1 0) (0 1 0 -1 0 0) (0 0 1 0 0 1)))
      (unknowns (R (rotation 3) :init (rot-z 80deg)) (m (vector 3)))
      (observe p (= [u v w] (rotate R (rotate (rot-z alpha) [x y z]))) :sigma 1e-6)
      (observe q (= o m) :sigma 1e-6))"""
    found = mbm.loads(text).solve()
    np.testing.assert_allclose(found["R"].sigma, [0.0, 0.0, 0.002], atol=2e-6)
    np.testing.assert_allclose(found["m"].sigma, [0.1, 0.0, 0.2], atol=2e-6)


def test_directions_say_that_they_have_none() -> None:
    text = """(problem p (constants (g 1 :sigma 0.1)) (unknowns (n direction :init [0 0 1]))
      (observe (= [0 0.1 1] n) :sigma 0.01))"""
    entry = mbm.loads(text).solve().document()["solves"][0]["estimates"]["n"]
    assert entry["sigma"] == [None, None]
    assert "directions" in entry["reason"]


def test_setting_a_constant_changes_its_value_only(tmp_path: Path) -> None:
    file, out = tmp_path / "p.mbm", tmp_path / "r.json"
    file.write_text(TEXT.format(g="10 :sigma 0.5", c="1", rows=ROWS, sigma="0.1"), encoding="utf-8")
    assert run(["solve", str(file), "--set", "g=20", "--json", str(out), "-q"]) == 0
    entry = json.loads(out.read_text(encoding="utf-8"))["solves"][0]["estimates"]["a"]
    assert entry["value"] == pytest.approx(_closed()[0][0] / 2)
    assert entry["sigma"] == pytest.approx(
        np.hypot(entry["value"] * 0.5 / 20, np.sqrt(_closed()[1][0, 0]) / 2), rel=1e-3
    )


def test_degrees_of_freedom_follow_welch_and_satterthwaite() -> None:
    """Two constants and a mean of three readings of unknown noise."""
    text = """(problem p (constants (c 1 :sigma 0.2 :dof 4) (e [2 3] :sigma [0.1 0.3] :dof 7))
      (data d (table (y) (1) (1.4) (1.5))) (unknowns (a)) (observe d (= y a)) (derive (f (+ a c (e 1) (e 2)))))"""
    found = mbm.loads(text).solve()["f"]
    own = np.std([1, 1.4, 1.5], ddof=1) ** 2 / 3
    parts = np.array([own, 0.04, 0.01, 0.09])
    assert float(found.sigma) == pytest.approx(np.sqrt(parts.sum()), rel=1e-6)
    assert float(found.dof) == pytest.approx(parts.sum() ** 2 / (parts**2 / [2, 4, 7, 7]).sum(), rel=1e-5)


@pytest.mark.parametrize(
    ("constant", "said"),
    [
        ("10 :sigma -1", "not below 0"),
        ("10 :sigma 1 :prior (normal 10 1)", "stated twice"),
        ("10 :prior 3", "no distribution"),
        ("10 :prior (student 10 1 2)", "no variance"),
        ("1m :sigma 1s", "standard deviation is"),
        ('"text" :sigma 1', "is no number"),
        ("10 11", "a constant is (name form)"),
        ("10 :sigma a", "a"),
        ("10 :dof 5", "and there is none"),
        ("10 :sigma 1 :dof 0", "above 0"),
        ("10 :sigma 1 :dof a", "a"),
    ],
)
def test_what_is_no_uncertainty_says_so(constant: str, said: str) -> None:
    text = f"(problem p (constants (g {constant})) (unknowns (a :init 1)) (observe (= 3 a) :sigma 1))"
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(text).solve()
    assert said in caught.value.diagnostics[0].message


def test_what_solves_once_refuses_them(tmp_path: Path) -> None:
    problem = mbm.loads(TEXT.format(g="10 :sigma 0.5", c="1", rows=ROWS, sigma="0.1"))
    with pytest.raises(mbm.MbmError) as caught:
        problem.compile().estimator()
    assert "constant with an uncertainty" in caught.value.diagnostics[0].message
    file = tmp_path / "p.mbm"
    file.write_text(TEXT.format(g="10 :sigma 0.5", c="1", rows=ROWS, sigma="0.1"), encoding="utf-8")
    assert run(["compile", str(file), "--target", "python", "-o", str(tmp_path / "out")]) == 2
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("u", "i", "wanted", "relative"),
    [("5V :sigma 0.5V", "2A :sigma 0.3A", np.hypot(0.1, 0.15), 1e-5), ("1e6V :sigma 1e-5V", "1A", 1e-11, 1e-3)],
)
def test_what_constants_add_is_the_derivative_times_their_deviation(u, i, wanted, relative):
    """GUM 5.1.6: of a quotient the relative variances add, however large; small ones to what rounding leaves."""
    found = mbm.loads(f"(problem p (constants (u {u}) (i {i})) (derive (r (/ u i))))").solve()["r"]
    assert found.sigma / found.value == pytest.approx(wanted, rel=relative)


NOISE, UNSURE, RUNS = 0.1, 1.0, 1000


@lru_cache
def _parabolas(sigma: str = str(NOISE), runs: int = RUNS) -> tuple[np.ndarray, np.ndarray, Any]:
    """Lines beside a parabola, whose factor is ten times as uncertain as a reading: x, y, the answers."""
    generator = np.random.default_rng(5)
    x = np.linspace(0.0, 1.0, 12)
    constants = 1.0 + UNSURE * generator.standard_normal((runs, 1))
    y = 2.0 - x + constants * x**2 + NOISE * generator.standard_normal((runs, 12))
    text = f"""(problem p (constants (c 1 :sigma {UNSURE})) (data d external) (unknowns (a) (b))
      (observe d (= y (+ a (* b x) (* c (^ x 2)))) :sigma {sigma}) (for-each k))"""
    data = {"k": np.repeat(np.arange(runs), 12), "x": np.tile(x, runs), "y": y.ravel()}
    return x, y, mbm.loads(text).solve(data={"d": data})


def test_the_chi_square_test_minds_what_constants_do() -> None:
    """The p-values are those of generalised least squares with the constant's part in the covariance of readings."""
    x, y, found = _parabolas()
    design = np.column_stack([np.ones(12), x])
    inverse = np.linalg.inv(NOISE**2 * np.eye(12) + UNSURE**2 * np.outer(x**2, x**2))
    left = (y - x**2).T
    fitted = design @ np.linalg.solve(design.T @ inverse @ design, design.T @ inverse @ left)
    squares = ((left - fitted) * (inverse @ (left - fitted))).sum(axis=0)
    tails = np.array([each.chi2_p for each in found.solves])
    np.testing.assert_allclose(tails, chi2.sf(squares, 10), rtol=1e-6)  # halves of differences over ± u/100, linear
    doubted = [{each.code.name for each in solve.diagnostics} for solve in found.solves]
    assert not any("noise-against-data" in each for each in doubted)
    share = np.mean(["improbable-noise" in each for each in doubted])
    assert share == pytest.approx(0.02, abs=0.014)  # a percent at each end, three deviations of a thousand runs


@pytest.mark.parametrize("given", [(), ("unknown", 400)])
def test_what_constants_do_to_residuals_is_no_correlation_of_rows(given: tuple[Any, ...]) -> None:
    """A constant ten times as uncertain as a reading bends all residuals of a solve alike."""
    doubted = [{each.code.name for each in solve.diagnostics} for solve in _parabolas(*given)[2].solves]
    share = np.mean(["autocorrelated-residuals" in each for each in doubted])
    assert share == pytest.approx(0.05, abs=3 * np.sqrt(0.05 * 0.95 / len(doubted)))  # by chance, three deviations


def test_readings_at_an_edge_are_said_once_beside_constants() -> None:
    rows = " ".join(f"({y})" for y in (0.0, 0.0, 0.083, 0.0317, 0.1121, 0.0, 0.0542, 0.0139, 0.0903, 0.0))
    found = mbm.loads(f"""(problem p (constants (c 0 :sigma 0.01)) (data d (table (y) {rows})) (unknowns (a))
      (observe d (= y (+ a c)) :sigma 0.06))""").solve()
    assert [each.code.name for each in found.diagnostics].count("readings-at-edge") == 1


def test_one_solve_says_the_same_of_chi_square() -> None:
    """And the cost stays that of the value."""
    x, y, many = _parabolas()
    worst = int(np.argmax([each.cost for each in many.solves]))
    rows = " ".join(f"({u} {v})" for u, v in zip(x.tolist(), y[worst].tolist(), strict=True))
    one = mbm.loads(f"""(problem p (constants (c 1 :sigma {UNSURE})) (data d (table (x y) {rows})) (unknowns (a) (b))
      (observe d (= y (+ a (* b x) (* c (^ x 2)))) :sigma {NOISE}))""").solve()
    assert one.first.chi2_p == pytest.approx(many.solves[worst].chi2_p, rel=1e-6)
    assert chi2.sf(one.first.cost, 10) < 1e-6 < one.first.chi2_p
    assert "noise-against-data" not in [each.code.name for each in one.diagnostics]


def test_noise_that_no_constant_explains_is_still_doubted() -> None:
    text = TEXT.format(g="10 :sigma 0.5", c="1 :sigma 0.1", rows=ROWS, sigma="0.001")
    found = mbm.loads(text).solve()
    assert "noise-against-data" in [each.code.name for each in found.diagnostics]
