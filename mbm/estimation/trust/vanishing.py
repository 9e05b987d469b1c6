"""Scales of a likelihood that are estimated as zero, or where nothing tells them from zero.

Where readings fit exactly, the likelihood of a scale has no maximum: it grows, or stays as it is, as the scale falls to
zero. A scale beside another one may be zero as well: its information falls with it, and its standard deviation, which
is of the curvature at zero, means nothing.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group, mentioned
from mbm.equations.types import Covariance, Floats, Indices, Mask, Minimum
from mbm.estimation.trust import faults
from mbm.expression.evaluate import evaluate
from mbm.problem.rows import lookup
from mbm.problem.tables import Table
from mbm.problem.types import BlockRole, Problem
from mbm.text.types import Diagnostic

EXACT = 1e-9
"""Size of the residuals, beside that of what is measured, below which readings fit exactly: far below what anything
measures, and above rounding."""

UNTOLD = 10.0
"""Standard deviations of a scale, in scales, from which on it is not told from nothing: what is told by two rows has
one of 0.7, and a scale that falls to nothing loses its information with its square."""

FALL = 0.1
"""Fall of 2 log σ that is one: half a scale that the deviations are proportional to makes 1.4."""


def vanishing_scales(
    problem: Problem, tables: Mapping[str, Table], equations: Assembled, minimum: Minimum, covariance: Covariance
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
        positive = layout.positive[scales]
        untold = scales[positive & (sigma[scales] > UNTOLD * values)]
        raw = np.abs(group.written.values(minimum.point)).max(initial=0.0)
        exact = bool(raw <= EXACT * _size(problem, tables, group)) and _falls(
            group, minimum.point, layout.number[scales], positive
        )
        names = tuple(layout.name(k) for k in (scales if exact else untold))
        if names:
            found.append(faults.vanishing_scale(problem.span, block.name, names, exact=exact))
    return tuple(dict.fromkeys(found))


def _size(problem: Problem, tables: Mapping[str, Table], group: Group) -> float:
    """The largest number on the measured side of a clause; 0 where there is none."""
    block = problem.blocks[group.kernel.owner]
    table = None if block.table is None else tables[block.table]
    largest = 0.0
    for equation in block.cases[group.kernel.case].equations:
        for each in evaluate(equation.measured or (), lookup(table, group.positions, tables)):
            numbers = np.abs(np.asarray(each, dtype=float))
            largest = max(largest, float(numbers[np.isfinite(numbers)].max(initial=0.0)))
    return largest


def _falls(group: Group, point: Floats, places: Indices, positive: Mask) -> bool:
    """Whether the deviations of a clause fall with its scales: half of the positive ones, the others 0.5 less."""
    if group.readings is None:
        return False
    lower = point.copy()
    lower[places] = np.where(positive, 0.5 * point[places], point[places] - 0.5)
    with np.errstate(all="ignore"):
        logs = [np.square(group.values(each)[:, group.readings.shifted]) for each in (point, lower)]
    return bool((logs[0] - logs[1] > FALL).any())
