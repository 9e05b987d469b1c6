"""Unknown noise beside uncertain constants: by the restricted likelihood of residuals that these move, with SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

import mbm

X = np.arange(7.0) - 2.0
Y = 1.0 + 2.0 * X + 0.1 * X**2 + 0.3 * np.random.default_rng(3).normal(size=7)
LINE = "(problem p (data d external) (constants (h 0 :sigma {s})) (unknowns (a) (b)) {each} {observed})"
ONE = "(observe d (= y (+ a (* b x) (* h x x))) :sigma unknown)"
DESIGN = np.column_stack([np.ones(7), X])


def restricted(logs: np.ndarray, rows: np.ndarray, y: np.ndarray, design: np.ndarray, moves: np.ndarray) -> float:
    """−2 log of the restricted likelihood, but for a constant; ``rows`` (m,) are the numbers of the rows' noise."""
    covariance = np.diag(np.exp(logs)[rows]) + np.outer(moves, moves)
    weights = np.linalg.inv(covariance)
    normal = design.T @ weights @ design
    residuals = y - design @ np.linalg.solve(normal, design.T @ weights @ y)
    return float(sum(np.linalg.slogdet(each)[1] for each in (covariance, normal)) + residuals @ weights @ residuals)


@pytest.mark.parametrize("each", ["", "(for-each k)"])
@pytest.mark.parametrize("s", [0.02, 0.1, 1.0])
def test_noise_is_that_of_residuals_which_constants_move(s: float, each: str) -> None:
    moves, rows = s * X**2, np.zeros(7, dtype=int)
    variance = np.exp(
        minimize(restricted, [-2.0], (rows, Y, DESIGN, moves), method="Nelder-Mead", options={"xatol": 1e-9}).x[0]
    )
    found = mbm.loads(LINE.format(s=s, each=each, observed=ONE)).solve(data={"d": {"x": X, "y": Y, "k": 0 * X}})
    own, along = np.linalg.inv(DESIGN.T @ DESIGN), np.linalg.lstsq(DESIGN, moves)[0]
    wanted = variance * own + np.outer(along, along)
    # 1e-5: half of a difference of two solves, and the search of a minimum that is as flat
    np.testing.assert_allclose(found.solves[0].covariance.matrix, wanted, rtol=1e-5)
    weights = np.linalg.inv(variance * np.eye(7) + np.outer(moves, moves))
    left = weights - weights @ DESIGN @ np.linalg.inv(DESIGN.T @ weights @ DESIGN) @ DESIGN.T @ weights
    dof, shares = variance**2 * np.trace(left @ left), np.diag(variance * own) / np.diag(wanted)
    assert 4.0 < dof < 5.0
    assert found.solves[0]["a"].dof == pytest.approx(dof / shares[0] ** 2, rel=1e-4)
    assert found.solves[0]["b"].dof == pytest.approx(dof / shares[1] ** 2, rel=1e-4)


def test_noise_of_several_clauses_is_that_of_residuals_which_constants_move() -> None:
    rng, x = np.random.default_rng(5), np.linspace(-1.0, 1.0, 12)
    y, z = 1.0 + 2.0 * x + 0.3 * rng.normal(size=12), 1.4 + 2.0 * x + 0.05 * rng.normal(size=12)
    observed = "(observe d (= y (+ a (* b x))) :sigma unknown) (observe e (= z (+ a h (* b x))) :sigma unknown)"
    text = LINE.format(s=0.4, each="", observed=observed).replace("external)", "external) (data e external)", 1)
    found = mbm.loads(text).solve(data={"d": {"x": x, "y": y}, "e": {"x": x, "z": z}})
    moves, rows = 0.4 * np.repeat([0.0, 1.0], 12), np.repeat([0, 1], 12)
    design = np.column_stack([np.ones(24), np.tile(x, 2)])
    logs = minimize(restricted, [-2.0, -4.0], (rows, np.append(y, z), design, moves), method="Nelder-Mead").x
    factors = [found.solves[0].record.noise[name] for name in ("d", "e")]
    assert factors == pytest.approx(np.exp(0.5 * logs), rel=1e-4)


def test_as_many_constants_as_degrees_of_freedom_leave_the_noise_as_it_is() -> None:
    text = LINE.format(s=1.0, each="", observed=ONE)
    found = mbm.loads(text).solve(data={"d": {"x": X[:3], "y": Y[:3]}})
    exact = mbm.loads(text.replace(":sigma 1.0", "")).solve(data={"d": {"x": X[:3], "y": Y[:3]}})
    assert found["a"].sigma > exact["a"].sigma


def test_constants_that_move_no_residuals_take_none_of_them() -> None:
    text = LINE.format(s=0.1, each="", observed=ONE)
    idle = text.replace("(constants", "(constants " + " ".join(f"(g{k} 0 :sigma 0.3)" for k in range(6)))
    idle = idle.replace("(unknowns", "(derive (q (+ a " + " ".join(f"g{k}" for k in range(6)) + "))) (unknowns")
    plain, beside = (mbm.loads(each).solve(data={"d": {"x": X, "y": Y}}) for each in (text, idle))
    # 1e-5: the derivatives of constants are halves of differences of two solves
    assert beside["a"].sigma == pytest.approx(plain["a"].sigma, rel=1e-5)
    assert beside["a"].dof == pytest.approx(plain["a"].dof, rel=1e-4)


@pytest.mark.parametrize("s", [0.05, 0.2])
def test_a_constant_in_the_form_of_unknown_noise_scales_the_weights_alone(s: float) -> None:
    text = LINE.format(s=s, each="", observed=ONE).replace("(h 0 ", "(h 0.5 ").replace("(* h x x)", "0")
    plain, scaled = (
        mbm.loads(text.replace(":sigma unknown", each)).solve(data={"d": {"x": X, "y": Y}})
        for each in (":sigma unknown", ":sigma (unknown h)")
    )
    # 1e-9: two solves of a linear problem
    np.testing.assert_allclose(scaled.solves[0].covariance.matrix, plain.solves[0].covariance.matrix, rtol=1e-9)
    assert scaled["b"].dof == pytest.approx(5.0)
    assert [d.code for d in scaled.diagnostics] == [d.code for d in plain.diagnostics]


def test_a_constant_in_stated_noise_beside_unknown_noise_moves_no_residuals() -> None:
    other = " (observe d (= z (* 2 b)) :sigma unknown)"
    text = LINE.format(s=0.05, each="", observed=ONE + other).replace("(h 0 ", "(h 0.3 ").replace("(* h x x)", "0")
    data = {"d": {"x": X, "y": Y, "z": 4.0 + 0.2 * np.random.default_rng(1).normal(size=7)}}
    kinds = (":sigma 0.3", ":sigma h", ":covariance [[(* h h)]]")
    plain, *beside = (mbm.loads(text.replace(":sigma unknown", kind, 1)).solve(data=data) for kind in kinds)
    for each in beside:
        assert each.noise["d-2"] == pytest.approx(plain.noise["d-2"], rel=1e-6)  # rounds end when factors settle


@pytest.mark.parametrize("k", [0.1, 0.3, 0.7])
@pytest.mark.parametrize("rows", [6, 7, 8, 9])
def test_readings_that_a_constant_alone_explains_tell_nothing_of_their_noise(rows: int, k: float) -> None:
    x = np.arange(float(rows))
    text = LINE.format(s=0.3, each="", observed=ONE).replace("(* b x) (* h x x)", "(* h (+ x 1))").replace(" (b)", "")
    found = mbm.loads(text).solve(data={"d": {"x": x, "y": 1.0 + k * (x + 1.0)}})
    assert found.solves[0].record.noise == {"d": None}
    assert [each.code.name for each in found.diagnostics] == ["noise-not-estimated"]
    assert found["a"].sigma == pytest.approx(0.3 * (x.mean() + 1.0), rel=1e-9)
