"""The Hessian of the Lagrange function on the surface of the constraints: quadratic convergence at the end."""

from __future__ import annotations

import numpy as np

from mbm.solution.constrained.types import ConstrainedEquations, Linearised
from mbm.solution.types import Floats
from mbm.target.decisions import DIFFERENCE, LEAST_DIFFERENCE

MOST_DIFFERENCED = 300
"""Each takes a Jacobian of its own: with more of them Gauss-Newton's slower end is cheaper."""

STIFFNESS = (0.0, 1.0, 1e2, 1e4)
"""Multiples of the active constraints' own square that are tried until the Hessian is positive definite: on the active
surface they change nothing (Hestenes 1969)."""


def lagrangian_model(
    equations: ConstrainedEquations, here: Linearised, multipliers: Floats, bounds: Floats
) -> tuple[Floats, Floats] | None:
    """``J`` (n, n) and ``r`` (n,): ``JᵀJ`` is the Hessian of ``‖r‖²/2 + Σ λ c``, ``Jᵀr`` the gradient of ``‖r‖²/2``.

    None where it is not positive definite whatever is done.
    """
    curvature = _curvature(equations, here, multipliers)
    if curvature is None:
        return None
    scale = here.scale
    scaled = here.jacobian / scale
    gradient = here.residuals @ scaled
    hessian = scaled.T @ scaled + curvature / np.multiply.outer(scale, scale)
    hessian = 0.5 * (hessian + hessian.T)
    holding = equations.equality | (multipliers > 0.0)
    rows = here.slopes[holding] / scale / here.unit[holding, None]
    held = np.eye(scale.size)[bounds != 0.0]
    stiff = rows.T @ rows + held.T @ held
    for weight in STIFFNESS:
        try:
            lower = np.linalg.cholesky(hessian + weight * stiff)
        except np.linalg.LinAlgError:
            continue
        residuals = np.asarray(np.linalg.solve(lower, gradient), dtype=np.float64)
        if bool(np.isfinite(residuals).all()):
            return lower.T * scale, residuals
    return None


def _curvature(equations: ConstrainedEquations, here: Linearised, multipliers: Floats) -> Floats | None:
    """``Σ r_i ∇²r_i + Σ λ_i ∇²c_i`` (n, n) by forward differences of the Jacobians; None where one is not finite."""
    n = here.scale.size
    if n > MOST_DIFFERENCED:
        return None
    gradient = here.residuals @ here.jacobian + multipliers @ here.slopes
    size = np.abs(equations.coordinates(here.point))
    spread = max(float(np.sqrt(here.cost / max(equations.count - n, 1))), 1e-3)
    result = np.empty((n, n))
    for j in range(n):
        step = np.zeros(n)
        step[j] = max(DIFFERENCE * spread / here.scale[j], LEAST_DIFFERENCE * float(size[j]))
        point = equations.retract(here.point, step)
        there = here.residuals @ equations.jacobian(point) + multipliers @ equations.constraint_jacobian(point)
        result[j] = (there - gradient) / step[j]
    return 0.5 * (result + result.T) if bool(np.isfinite(result).all()) else None
