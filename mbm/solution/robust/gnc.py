"""Graduated non-convexity: from least squares to the truncated loss by degrees.

Yang, Antonante, Tzoumas and Carlone (2020). Deterministic, and without subsets, so for any number of unknowns; it needs
a least squares fit that is not too far off.
"""

from __future__ import annotations

import numpy as np

from mbm.solution.robust.refine import weighted_step
from mbm.solution.robust.trials import Trials
from mbm.solution.robust.units import Units, robust_variance
from mbm.solution.types import Floats, Mask
from mbm.target.decisions import ABSOLUTE_ROUNDS, CONTROL_GROWTH, GRADUATED_FITS, GRADUATED_ROUNDS


@np.errstate(all="ignore")
def graduated(trials: Trials, units: Units, start: Floats, limits: Floats, unknown: Mask) -> Floats:
    """Points (2, N) where the weights have become 0 or 1, begun at least squares and at least absolute deviations.

    ``limits`` (U,) are those of the truncated loss. The noise of the ``unknown`` units (U,) is taken from the median of
    their residuals, anew in each round.
    """
    squared = _fit(trials, start[None], np.ones((1, units.count)), units, GRADUATED_FITS)
    absolute = squared
    for _ in range(ABSOLUTE_ROUNDS):
        norms = np.sqrt(units.squares(trials.residuals(absolute)))
        absolute = _fit(trials, absolute, 1.0 / np.maximum(norms, 1e-3 * np.median(norms) + 1e-300), units, 1)
    return np.concatenate([_narrowed(trials, units, point, limits, unknown) for point in (squared, absolute)])


def _narrowed(trials: Trials, units: Units, point: Floats, limits: Floats, unknown: Mask) -> Floats:
    """The point (1, N) where the weights that begin at ``point`` have become 0 or 1."""
    squares = units.squares(trials.residuals(point))[0]
    wide = limits * _variances(squares, units, trials.dimension, unknown)
    control = float(np.min(wide / np.maximum(2.0 * squares - wide, 1e-300), where=np.isfinite(squares), initial=np.inf))
    if not 0.0 < control < np.inf:
        return point
    for _ in range(GRADUATED_ROUNDS):
        weights = _weights(squares, wide, control)
        point = _fit(trials, point, weights[None], units, 1)
        squares = units.squares(trials.residuals(point))[0]
        wide = np.minimum(wide, limits * _variances(squares, units, trials.dimension, unknown))
        if bool(((weights < 1e-6) | (weights > 1.0 - 1e-6)).all()):
            break
        control *= CONTROL_GROWTH
    return point


def _variances(squares: Floats, units: Units, dimension: int, unknown: Mask) -> Floats:
    """The variance of each unit (U,): 1 where it is stated."""
    found = np.ones(units.count)
    for group in np.unique(units.group[unknown]).tolist():
        mine = units.group == group
        found[mine] = robust_variance(squares, units, dimension, mine)
    return found


def _weights(squares: Floats, limits: Floats, control: float) -> Floats:
    """Weights of the truncated loss made smooth (eq. 14 of the paper)."""
    inner = control / (control + 1.0) * limits
    outer = (control + 1.0) / control * limits
    between = np.sqrt(limits * control * (control + 1.0) / np.maximum(squares, 1e-300)) - control
    return np.where(squares <= inner, 1.0, np.where(squares >= outer, 0.0, np.clip(between, 0.0, 1.0)))


def _fit(trials: Trials, point: Floats, weights: Floats, units: Units, steps: int) -> Floats:
    """Weighted least squares from a point (1, N): at most so many Marquardt steps that lower the sum of squares."""
    by_row = units.expanded(weights)
    residuals, jacobian = trials.linearised(point)
    damping = np.full(1, 1e-4)
    cost = _cost(residuals, by_row)
    for _ in range(steps):
        step, promise = weighted_step(trials, residuals, jacobian, by_row, damping)
        if not promise[0] > 1e-12 * cost:
            break
        there = trials.moved(point, step)
        new_residuals, new_jacobian = trials.linearised(there)
        new_cost = _cost(new_residuals, by_row)
        if new_cost < cost:
            point, residuals, jacobian, cost = there, new_residuals, new_jacobian, new_cost
            damping = damping * 0.1
        else:
            damping = damping * 10.0
    return point


def _cost(residuals: Floats, weights: Floats) -> float:
    return float((weights * np.square(np.where(weights > 0.0, residuals, 0.0))).sum())
