"""The desk with constraints (V3, V4 of the reference) against optima found by substitution, and with penalties."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from tests.evidence.material import loaded
from tests.evidence.test_desk_reference import DESK, FREE, LEGS, corners

Floats = NDArray[np.float64]
NAMES = ("psi", "xg", "yg", "x", "y", "h")
START = np.array([0.2, 2.5, 0.0, 0.6, 0.35, 0.7])
PRIOR = "(normal h 0.71m 0.005m)"
V3 = f"(constraints {PRIOR} (uniform y 0.30m 0.345m) (>= (- x (* 1.75 y)) 0m :name ratio))"
V3_B = V3.replace("1.75", "1.80")
V4 = f"(constraints {PRIOR} (= (+ x y) 0.96m :name sum))"


def residuals(v: Floats) -> Floats:
    """The 12 image residuals and the prior on h, whitened: the reference's model in plain NumPy."""
    psi, xg, yg, x, y, h = v
    data = corners()
    foot = {"leg1/origin": (x - 0.03, y - 0.03, 0.0), "leg4/origin": (x - 0.03, -(y - 0.03), 0.0)}
    corner = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    board = {f"board/vertex/{i + 1}": (sx * x, sy * y, h) for i, (sx, sy) in enumerate(corner)}
    points = np.array([{**board, **foot}[str(path)] for path in data["path"]])
    px = np.cos(psi) * points[:, 0] - np.sin(psi) * points[:, 1] + xg
    py = np.sin(psi) * points[:, 0] + np.cos(psi) * points[:, 1] + yg
    pz = points[:, 2] - 1.5
    image = np.concatenate([800 * py / px - np.array(data["X"]), 800 * pz / px - np.array(data["Y"])]) / 2
    return np.append(image, (h - 0.71) / 0.005)


def derivative(function: Callable[[Floats], Floats], z: Floats) -> Floats:
    """The Jacobian by complex steps: exact to rounding."""
    return np.imag([function(z + 1e-30j * e) for e in np.eye(z.size)]).T / 1e-30


def least(function: Callable[[Floats], Floats], start: Floats) -> Floats:
    """Where the sum of squares is least; Gauss-Newton gives the last digits."""
    z = least_squares(function, start, x_scale=0.1, jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    for _ in range(30):
        z = z - np.linalg.lstsq(derivative(function, z), function(z), rcond=None)[0]
    return z


def optimum(surface: Floats, offset: Floats) -> tuple[Floats, float, Floats]:
    """Estimates, cost and projected covariance where ``v = offset + surface @ z``: constraints by substitution."""

    def of(z: Floats) -> Floats:
        return residuals(offset + surface @ z)

    z = least(of, np.linalg.lstsq(surface, START - offset, rcond=None)[0])
    jacobian = derivative(of, z)
    covariance = surface @ np.linalg.inv(jacobian.T @ jacobian) @ surface.T
    return offset + surface @ z, float(of(z) @ of(z)), covariance


EYE = np.eye(6)
Y_FIXED = np.delete(EYE, 4, axis=1), 0.345 * EYE[4]
RATIO_FIXED = np.column_stack([EYE[:, 0], EYE[:, 1], EYE[:, 2], 1.80 * EYE[:, 3] + EYE[:, 4], EYE[:, 5]]), np.zeros(6)
SUM_FIXED = np.column_stack([EYE[:, 0], EYE[:, 1], EYE[:, 2], EYE[:, 3] - EYE[:, 4], EYE[:, 5]]), 0.96 * EYE[4]


def test_the_covariance_without_constraints(tmp_path):
    """All six unknowns from the image alone; problems/desk says the estimates."""
    solved = loaded(tmp_path, DESK % (*LEGS["fixed"], "", FREE, ""), corners=corners()).solve()
    jacobian = derivative(lambda v: residuals(v)[:12], least(lambda v: residuals(v)[:12], START))
    # The condition is 6, and the Jacobian exact.
    expected = np.linalg.inv(jacobian.T @ jacobian)
    np.testing.assert_allclose(solved.covariance.matrix, expected, rtol=1e-8, atol=1e-14)


@pytest.mark.parametrize("method", ["penalty", "exact"])
@pytest.mark.parametrize(
    ("constraints", "surface", "active", "dof"),
    [
        (V3, Y_FIXED, [True, False], 8),
        (V3_B, RATIO_FIXED, [False, True], 8),
        (V4, SUM_FIXED, [True], 8),
    ],
    ids=["V3", "V3_b", "V4"],
)
def test_optimum_on_the_active_surface(constraints, surface, active, dof, method, tmp_path):
    text = DESK % (*LEGS["fixed"], "", FREE, f"{constraints} (solve :constraints {method})")
    solved = loaded(tmp_path, text, corners=corners()).solve()
    expected, cost, covariance = optimum(*surface)
    assert solved.status == "ok"
    np.testing.assert_allclose([float(solved[n].value) for n in NAMES], expected, rtol=1e-8)
    assert solved.first.cost == pytest.approx(cost, rel=1e-8)
    assert solved.first.dof == dof
    np.testing.assert_allclose(solved.covariance.matrix, covariance, rtol=1e-6, atol=1e-6 * covariance.max())
    found = solved.document()["solves"][0]["constraints"]
    assert [c["active"] for c in found] == active
    assert all(c["violation"] == 0 for c in found)


@pytest.mark.parametrize("weight", [1e2, 1e4, 1e6, 1e8])
def test_single_penalty_stated_as_an_observation(weight, tmp_path):
    """A violation that costs μ times its square is an observation of zero: its minimum tends to the exact one."""
    sigma = 1 / np.sqrt(weight)
    penalties = f"""(constraints {PRIOR})
      (observe low (max 0m (- 0.30m y)) :sigma {sigma}m)
      (observe high (max 0m (- y 0.345m)) :sigma {sigma}m)
      (observe ratio (max 0m (- (* 1.75 y) x)) :sigma {sigma}m)"""
    solved = loaded(tmp_path, DESK % (*LEGS["fixed"], "", FREE, penalties), corners=corners()).solve()

    def penalised(v: Floats) -> Floats:
        excess = np.array([0.30 - v[4], v[4] - 0.345, 1.75 * v[4] - v[3]])
        return np.append(residuals(v), np.sqrt(weight) * np.where(excess.real > 0, excess, 0))

    expected = least(penalised, START)
    np.testing.assert_allclose([float(solved[n].value) for n in NAMES], expected, rtol=1e-8, atol=1e-9)
    assert solved.first.cost == pytest.approx(float(np.sum(penalised(expected) ** 2)), rel=1e-8)
    exact, _, _ = optimum(*Y_FIXED)
    multiplier = 4e5  # of the upper limit of y, an upper bound: the distance to the exact optimum is that over μ
    assert float(solved["y"].value) - exact[4] <= multiplier / weight
