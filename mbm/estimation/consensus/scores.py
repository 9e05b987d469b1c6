"""What consensus judges units by: limits of the deviations, and the noise."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats
from mbm.estimation.consensus.units import CUT, Units, by_components, limits, quantile, robust_variance
from mbm.problem.types import Consensus
from mbm.solver.decisions import STATED

STATED_CUT = 3.0
"""Stated standard deviations beyond which a unit is an outlier: 0.3 % of good units, at 1.5 % of the precision."""


def cuts(units: Units, threshold: float | None) -> Floats:
    """Squared limits (U,) for unit variance: at ``threshold`` deviations, else 3 stated or 2.5 robust ones."""
    if threshold is not None:
        return limits(units.components, threshold)
    stated = limits(units.components, STATED_CUT)
    return np.where(units.group == STATED, stated, limits(units.components, CUT))


def limits_of(units: Units, consensus: Consensus) -> Floats:
    """Squared limits (U,) for unit variance, as `:quantile` or `:threshold` state them, else as `cuts` has them."""
    if consensus.quantile is None:
        return cuts(units, consensus.threshold)
    tail = 1.0 - consensus.quantile
    return by_components(units.components, {d: quantile(tail, d) for d in np.unique(units.components).tolist()})


def variances_at(squares: Floats, units: Units, dimension: int) -> Floats:
    """The variance (U,) of each unit's noise at a point: 1 where it is stated, else the robust one of its group.

    It is no smaller than what rounding makes of most of them: that of a unit that is grossly wrong says nothing.
    """
    found = np.ones(units.count)
    for group in np.unique(units.group).tolist():
        if group != STATED:
            mine = units.group == group
            least = float(np.median(units.rounding[mine]))
            found[mine] = max(robust_variance(squares, units, dimension, mine), least, 1e-300)
    return found
