"""How well points agree with the units: medians, counts, truncated sums; lower is better."""

from __future__ import annotations

import numpy as np

from mbm.problem.types import ConsensusKind
from mbm.solution.robust.units import CUT, STATED, Units, limits, medians, robust_variance
from mbm.solution.types import Floats

STATED_CUT = 3.0
"""Stated standard deviations beyond which a unit is an outlier: 0.3 % of good units, at 1.5 % of the precision."""


def median_scores(squares: Floats, units: Units, size: int) -> Floats:
    """Least median of squares of trials (T, U): ``Σ n log q`` over the noise groups with their order statistic q.

    q is the squared norm (over its median under the law) of rank ``⌊n/2⌋ + ⌊(k + 1)/2⌋``, with subsets of ``size`` k
    units, which breaks down last (Rousseeuw and Leroy 1987, 3.4). With one group this orders the trials as q does.
    """
    normed = squares / medians(units.components)
    total = np.zeros(len(squares))
    for group in np.unique(units.group).tolist():
        mine = normed[:, units.group == group]
        count = mine.shape[1]
        place = min(count // 2 + (size + 1) // 2, count) - 1
        middle = np.partition(mine, place, axis=1)[:, place]
        total += count * np.log(np.maximum(middle, 1e-30))
    return np.where(np.isfinite(total), total, np.inf)


def scores(kind: ConsensusKind, squares: Floats, units: Units, size: int, cut: Floats, variances: Floats) -> Floats:
    """The score (T,) of the trials by the estimator's own rule, with limits ``cut · variances`` (U,)."""
    if kind is ConsensusKind.LMEDS:
        return median_scores(squares, units, size)
    limit = cut * variances
    sums = np.minimum(squares / limit, 1.0).sum(axis=1)
    if kind is ConsensusKind.RANSAC:
        return np.asarray((squares > limit).sum(axis=1) + sums / (units.count + 1.0))
    return np.asarray(sums)


def cuts(units: Units, threshold: float | None) -> Floats:
    """Squared limits (U,) for unit variance: at ``threshold`` deviations, else 3 stated or 2.5 robust ones."""
    if threshold is not None:
        return limits(units.components, threshold)
    stated = limits(units.components, STATED_CUT)
    return np.where(units.group == STATED, stated, limits(units.components, CUT))


def variances_at(squares: Floats, units: Units, dimension: int) -> Floats:
    """The variance (U,) of each unit's noise at a point: 1 where it is stated, else the robust one of its group."""
    found = np.ones(units.count)
    for group in np.unique(units.group).tolist():
        if group != STATED:
            mine = units.group == group
            least = float(units.rounding[mine].max())
            found[mine] = max(robust_variance(squares, units, dimension, mine), least, 1e-300)
    return found
