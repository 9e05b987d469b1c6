"""Fits to self-chosen units at a few points at once: the local search behind consensus.

A rule says which units count at a point, and an objective that a fit to those units lowers: the truncated sum of
squares ``Σ min(s, L)`` where the noise is stated (the fit majorises it), the trimmed one where it is not (the
concentration steps of Rousseeuw and Van Driessen 2006). So every accepted step lowers the objective.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from mbm.solution.robust.trials import Trials
from mbm.solution.robust.units import Units, medians
from mbm.solution.types import Floats, Indices
from mbm.target.decisions import CANDIDATE_DAMPING, CANDIDATE_REGULARISATION, SAME_OBJECTIVE, STATED, STILL
from mbm.values import dataclass


class Rule(Protocol):
    """Which units count at points with squared norms (K, U), and what is lowered by fitting them."""

    def weights(self, squares: Floats) -> Floats:
        """Weights (K, U), 0 for units that do not count."""
        ...

    def objective(self, squares: Floats, rest: Floats) -> Floats:
        """The objective (K,); ``rest`` (K,) are the squares that no rule touches."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Truncated:
    """Units inside ``limits`` (U,) or (K, U) count with the inverse of their ``variances`` (U,)."""

    limits: Floats
    variances: Floats

    def weights(self, squares: Floats) -> Floats:
        """1/variance inside, 0 outside."""
        return np.where(squares <= self.limits, 1.0 / self.variances, 0.0)

    def objective(self, squares: Floats, rest: Floats) -> Floats:
        """``Σ min(s, L)/variance + rest``."""
        return np.asarray((np.minimum(squares, self.limits) / self.variances).sum(axis=-1) + rest)


@dataclass(frozen=True, slots=True, eq=False)
class Trimmed:
    """The better half of each group of unknown noise counts, and units of stated noise inside ``limits`` (U,).

    The half has ``⌊n/2⌋ + ⌊(k + 1)/2⌋`` units with subsets of k, which breaks down last. The objective is −2 times the
    logarithm of a likelihood: ``Σ n log(mean of the half)`` over the groups, ``Σ min(s, L)`` over stated ones.
    """

    units: Units
    limits: Floats
    size: int

    def weights(self, squares: Floats) -> Floats:
        """1 over the mean of the half for its units, 0 for the others."""
        stated = self.units.group == STATED
        found = np.where(stated & (squares <= self.limits), 1.0, 0.0)
        for mine, best, mean in self._halves(squares):
            half = np.zeros((len(squares), mine.size))
            np.put_along_axis(half, best, 1.0, axis=1)
            found[:, mine] = half / mean[:, None]
        return found

    def objective(self, squares: Floats, rest: Floats) -> Floats:
        """The sum over the groups and the stated units."""
        stated = self.units.group == STATED
        total = np.minimum(squares, self.limits)[:, stated].sum(axis=1) + rest
        for mine, _, mean in self._halves(squares):
            total = total + mine.size * np.log(mean)
        return np.where(np.isfinite(total), total, np.inf)

    def _halves(self, squares: Floats) -> list[tuple[Indices, Indices, Floats]]:
        """For each group its units, the places (K, h) of the better half in them, and its mean (K,)."""
        normed = squares / medians(self.units.components)
        found = []
        for group in np.unique(self.units.group[self.units.group != STATED]).tolist():
            mine = np.flatnonzero(self.units.group == group)
            half = max(min(mine.size // 2 + (self.size + 1) // 2, mine.size), 1)
            best = np.argpartition(normed[:, mine], half - 1, axis=1)[:, :half]
            mean = np.take_along_axis(normed[:, mine], best, axis=1).mean(axis=1)
            found.append((mine, best, np.maximum(mean, 1e-300)))
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Refined:
    """Points (K, N), their squared unit norms (K, U), and objectives (K,), infinite where there is no value."""

    points: Floats
    squares: Floats
    objective: Floats

    def best(self, distance: Floats) -> int:
        """The point with the lowest objective; of equals (mirrored ones, say) that at the least ``distance`` (K,)."""
        lowest = float(self.objective.min())
        equal = self.objective <= lowest + SAME_OBJECTIVE * max(abs(lowest), 1.0)
        return int(np.argmin(np.where(equal, distance, np.inf))) if equal.any() else 0


def rest_of(residuals: Floats, units: Units) -> Floats:
    """Sum of squares (K,) of the residuals (K, m) that no rule touches."""
    outside = residuals[..., units.of_row < 0]
    total = np.square(outside).sum(axis=-1)
    return np.where(np.isfinite(total), total, np.inf)


def weighted_step(
    trials: Trials, residuals: Floats, jacobian: Floats, weights: Floats, damping: Floats
) -> tuple[Floats, Floats]:
    """Marquardt steps (K, n) and the decrease (K,) of the weighted sum of squares that they promise."""
    usable = weights > 0.0
    plain = np.where(usable, residuals, 0.0)
    slope = np.where(usable[:, :, None], jacobian, 0.0)
    weighted = slope * weights[:, :, None]
    normal = slope.transpose(0, 2, 1) @ weighted
    gradient = np.einsum("kmn,km->kn", weighted, plain)
    diagonal = np.einsum("knn->kn", normal)
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    unit = normal / scale[:, :, None] / scale[:, None, :]
    unit[:, np.arange(trials.dimension), np.arange(trials.dimension)] += damping[:, None] + CANDIDATE_REGULARISATION
    good = np.isfinite(unit).all(axis=(1, 2)) & np.isfinite(gradient).all(axis=1)
    unit[~good] = np.eye(trials.dimension)
    scaled = np.linalg.solve(unit, (gradient / scale)[:, :, None])[:, :, 0]
    steps = np.where(good[:, None], -scaled / scale, 0.0)
    lowered = np.einsum("kn,kn->k", gradient, -steps) + np.square(scaled).sum(axis=1) * damping
    return steps, np.where(good, lowered, 0.0)


@np.errstate(all="ignore")
def refined(trials: Trials, units: Units, points: Floats, rule: Rule, *, iterations: int) -> Refined:
    """The points (K, N) after fits to the units that the rule picks, anew at every step; never a higher objective."""
    points = points.copy()
    residuals, jacobian = (each.copy() for each in trials.linearised(points))
    squares = units.squares(residuals)
    objective = rule.objective(squares, rest_of(residuals, units))
    weights = rule.weights(squares)
    damping = np.full(len(points), CANDIDATE_DAMPING)
    moving = np.isfinite(objective)
    for _ in range(iterations):
        if not moving.any():
            break
        steps, promise = weighted_step(trials, residuals, jacobian, units.expanded(weights), damping)
        there = trials.moved(points, np.where(moving[:, None], steps, 0.0))
        trial, slope = trials.linearised(there)
        trial_squares = units.squares(trial)
        lower = rule.objective(trial_squares, rest_of(trial, units))
        taken = moving & (lower < objective)
        points[taken], residuals[taken], jacobian[taken] = there[taken], trial[taken], slope[taken]
        squares[taken], objective[taken] = trial_squares[taken], lower[taken]
        weights = rule.weights(squares)
        damping = np.where(taken, np.maximum(damping * 0.1, 1e-12), np.maximum(damping * 30.0, 1e-4))
        moving &= (promise > STILL) & (damping < 1e6)
    return Refined(points=points, squares=squares, objective=objective)
