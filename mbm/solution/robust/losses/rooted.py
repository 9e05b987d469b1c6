"""Losses in square-root form: residuals whose squares sum to ρ, so that least squares minimises it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mbm.solution.types import Floats
from mbm.target.decisions import NEARLY_ZERO

if TYPE_CHECKING:
    from mbm.solution.robust.losses.function import LossFunction


def root_factors(loss: LossFunction, squares: Floats) -> tuple[Floats, Floats]:
    """``q = √(ρ(s)/s)`` and dq/ds, so that ``r̃ = q r`` has ``|r̃|² = ρ(s)``; shapes as ``squares``."""
    rho = loss.rho(squares)
    weight = loss.weight(squares)
    tiny = squares <= NEARLY_ZERO * loss.scale * loss.scale
    safe = np.where(squares > 0.0, squares, 1.0)
    factor = np.where(squares > 0.0, np.sqrt(rho / safe), 1.0)
    # ρ's − ρ = s²ρ''/2 − s³ρ'''/6 …; the slope at 2s/3 holds the two terms: ∫₀ˢ u ρ''(u) du with one Gauss point.
    difference = np.where(tiny, 0.5 * loss.slope(squares * (2.0 / 3.0)), (weight - rho / safe) / safe)
    return factor, np.asarray(0.5 * difference / factor)


def rooted(loss: LossFunction, residuals: Floats) -> Floats:
    """``r̃ = r √(ρ(s)/s)`` for each unit; ``residuals`` (units, components), whitened."""
    factor, _ = root_factors(loss, np.square(residuals).sum(axis=1))
    return np.asarray(residuals * factor[:, None])


def rooted_jacobian(loss: LossFunction, residuals: Floats, jacobian: Floats) -> Floats:
    """dr̃/dx = q J + 2 q' r (rᵀJ), exact; ``jacobian`` (units, components, n) belongs to the plain ``residuals``."""
    factor, change = root_factors(loss, np.square(residuals).sum(axis=1))
    along = np.einsum("uk,ukn->un", residuals, jacobian)
    bent = (2.0 * change[:, None] * residuals)[:, :, None] * along[:, None, :]
    return np.asarray(factor[:, None, None] * jacobian + bent)
