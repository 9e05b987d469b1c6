"""Newton's last steps where Gauss-Newton's converge slowly: the part of the Hessian that ``JᵀJ`` leaves out.

With large residuals the term ``Σ r_i ∇²r_i`` makes Gauss-Newton converge linearly, or not at all (Dennis, Gay and
Welsch 1981). It is taken once from differences of the Jacobian, near the minimum, and kept.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from mbm.solution.solvers.scaled import Scaled
from mbm.solution.types import Equations, Floats, Profiled
from mbm.target.decisions import DIFFERENCE, LEAST_DIFFERENCE


def residual_curvature(
    equations: Equations, x: Floats, residuals: Floats, jacobian: Floats, scale: Floats, spread: float
) -> Floats | None:
    """``Σ r_i ∇²r_i / ‖r‖``, shape (n, n), by forward differences; None where one is not finite.

    Per unit of ‖r‖, so that the term fades where the residuals do. ``spread`` is the standard deviation of a residual,
    so that ``spread / scale`` is one of a coordinate.
    """
    if isinstance(equations, Profiled) and equations.profiled:
        return _profiled_curvature(equations, x, residuals, jacobian, scale, spread)
    n = equations.dimension
    size = np.abs(equations.coordinates(x))
    gradient = residuals @ jacobian
    result = np.empty((n, n))
    for j in range(n):
        step = np.zeros(n)
        step[j] = max(DIFFERENCE * spread / scale[j], LEAST_DIFFERENCE * float(size[j]))
        gradient_there = residuals @ equations.jacobian(equations.retract(x, step))
        result[j] = (gradient_there - gradient) / step[j]
    if not np.isfinite(result).all():
        return None
    return (0.5 / sqrt(float(residuals @ residuals))) * (result + result.T)


def _profiled_curvature(
    equations: Equations, x: Floats, residuals: Floats, jacobian: Floats, scale: Floats, spread: float
) -> Floats | None:
    """The same where the Jacobian is not the derivative of the residuals: the Hessian, by central differences of the
    gradient, without ``JᵀJ``.
    """
    n = equations.dimension
    size = np.abs(equations.coordinates(x))
    hessian = np.empty((n, n))
    for j in range(n):
        step = np.zeros(n)
        step[j] = max(DIFFERENCE * spread / scale[j], LEAST_DIFFERENCE * float(size[j]))
        ends = (equations.retract(x, step), equations.retract(x, -step))
        sides = [equations.residuals(there) @ equations.jacobian(there) for there in ends]
        hessian[j] = (sides[0] - sides[1]) / (2.0 * step[j])
    result = 0.5 * (hessian + hessian.T) - jacobian.T @ jacobian
    return result / sqrt(float(residuals @ residuals)) if np.isfinite(result).all() else None


def newton_step(parts: Scaled, curvature: Floats) -> tuple[Floats, float] | None:
    """Newton's step in scaled coordinates (n,) and the gain it promises; None where the Hessian is indefinite.

    The Hessian is never formed: in the basis of the singular vectors it is ``S (I + C) S`` with ``C`` small.
    """
    k = parts.rank
    basis = parts.right[:k] / parts.singular[:k, None]
    inner = np.eye(k) + basis @ curvature @ basis.T
    try:
        lower = np.linalg.cholesky(inner)
    except np.linalg.LinAlgError:
        return None
    half = np.linalg.solve(lower, parts.projected[:k])
    step: Floats = -(np.linalg.solve(lower.T, half) @ basis)
    return (step, float(half @ half)) if np.isfinite(step).all() else None


def spread_of(cost: float, freedom: int) -> float:
    """Standard deviation of one residual."""
    return sqrt(cost / max(freedom, 1))
