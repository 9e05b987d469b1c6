"""Scales of a likelihood that have gone to nothing, or to where nothing tells them from nothing.

Where readings fit exactly, the likelihood of a scale has no maximum: it grows, or stays as it is, as the scale falls to
zero. A scale beside another one may be zero as well: its information falls with it, and its standard deviation, which
is of the curvature at zero, means nothing.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import mentioned
from mbm.equations.types import Covariance, Minimum
from mbm.estimation.trust import faults
from mbm.problem.types import BlockRole, Problem
from mbm.text.types import Diagnostic

EXACT = 1e-9
"""Size of the residuals, beside that of what is measured, below which readings fit exactly: far below what anything
measures, and above rounding."""

UNTOLD = 10.0
"""Standard deviations of a scale, in scales, from which on it is not told from nothing: what is told by two rows has
one of 0.7, and a scale that falls to nothing loses its information with its square."""


def vanishing_scales(
    problem: Problem, equations: Assembled, minimum: Minimum, covariance: Covariance
) -> tuple[Diagnostic, ...]:
    """What is said of scales that have vanished at the minimum, one for each clause and cause."""
    layout = equations.layout
    sigma = np.full(len(layout.number), np.nan)
    if covariance.sigma.size == equations.dimension:
        sigma[equations.free] = covariance.sigma
    found: list[Diagnostic] = []
    for group in equations.groups:
        if group.readings is None or not group.readings.free or group.role is not BlockRole.OBSERVATION:
            continue
        block, count = problem.blocks[group.kernel.owner], len(layout.number)
        scales = np.flatnonzero(mentioned((group,), count) & ~mentioned((group.written,), count))
        scales = scales[np.isin(scales, equations.free) & (layout.number[scales] >= 0)]
        values = np.abs(minimum.point[layout.number[scales]])
        untold = scales[sigma[scales] > UNTOLD * values]
        raw = group.written.values(minimum.point)
        exact = bool(np.abs(raw).max(initial=0.0) <= EXACT * _size(group.parameters))
        names = tuple(layout.name(k) for k in (scales if exact else untold))
        if names and (exact or untold.size):
            found.append(faults.vanishing_scale(problem.span, block.name, names, exact=exact))
    return tuple(dict.fromkeys(found))


def _size(data: np.ndarray) -> float:
    """How large the numbers of a clause are, those that are no numbers left out."""
    finite = np.abs(data[np.isfinite(data)])
    return float(finite.max(initial=0.0))
