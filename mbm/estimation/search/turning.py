"""A fit to measured contours that a start from silhouettes led to → the lower minima around it.

A point follows the nearest edge of the outline, be it the wrong one, and a descent may end there, some degrees from the
truth. Then neighbouring points are off alike. From poses that are turned by some degrees other edges are nearest.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.metric import rounding_at
from mbm.equations.types import Floats, Minimum
from mbm.estimation.search.agreement import Agreement
from mbm.estimation.search.basins import equal_costs
from mbm.estimation.search.search import Found, Tally, search
from mbm.estimation.search.starting import Beginning
from mbm.estimation.settings import Settings
from mbm.expression.nodes import Outlined
from mbm.problem.manifold import Piece
from mbm.problem.types import Problem
from mbm.solver.decisions import takes_over

TURN = np.radians(5.0)
"""Of a bracket that went astray, two in three turns by 2° to 10° about an axis led to the truth."""

ASTRAY = 0.2
"""Correlation of residuals along a contour from which they may be no noise: a hundred of these have ± 0.1."""

FAR = 2.2
"""Root mean square of residuals over the median of their sizes from which some may be no noise: of that it is 1.48."""

LEAST_ROWS = 3
"""Rows of a contour below which residuals have no neighbours that could be alike."""

ROUNDS = 3


def with_turns(equations: Assembled, found: Found, settings: Settings, problem: Problem, agrees: Agreement) -> Found:
    """``found``, or the lowest of the minima that turned poses lead to."""
    for _ in range(ROUNDS):
        asked = settings.starts is not None or settings.robust is not None or settings.stopped()
        if asked or not _astray(equations, found.minimum):
            break
        alike = [each.minimum for each in found.alternatives if equal_costs(each.minimum.cost, found.minimum.cost)]
        points = np.concatenate([_turned(equations, each.point) for each in (found.minimum, *alike)])
        if not len(points):
            break
        starts = tuple(Beginning(point=point, origin=found.origin) for point in points)
        other = search(equations, starts, settings, problem, agrees)
        if not other.minimum.reason.converged:
            break
        lower = takes_over(found.minimum.cost, other.minimum.cost, rounding_at(equations, found.minimum))
        best = other if lower else found
        found = replace(
            best,
            tally=_together(found, other, best),
            iterations=found.iterations + other.iterations,
            evaluations=found.evaluations + other.evaluations,
        )
        if not lower:
            break
    return found


def _astray(equations: Assembled, minimum: Minimum) -> bool:
    """Whether residuals along a contour are no noise: neighbouring ones are alike, or some far beyond the others."""
    if not minimum.reason.converged or len(minimum.residuals) != equations.count:
        return False
    if np.sqrt(minimum.cost) <= rounding_at(equations, minimum):
        return False
    for own in _along_contours(equations, minimum.residuals):
        if len(own) < LEAST_ROWS:
            continue
        squares = np.square(own)
        alike = float(np.square(np.diff(own)).sum()) < 2 * (1 - ASTRAY) * float(squares.sum())
        if alike or float(squares.mean()) > FAR**2 * float(np.median(squares)):
            return True
    return False


def _along_contours(equations: Assembled, residuals: Floats) -> Iterator[Floats]:
    for group in equations.groups:
        calls = (call.external for call in group.kernel.calls)
        if any(isinstance(each, Outlined) and each.function == "contour-distance" for each in calls):
            yield residuals[group.first : group.first + group.count]


def _turned(equations: Assembled, point: Floats) -> Floats:
    """The point (N,) after turns both ways of each rotation about its axes, and of each angle (T, N)."""
    layout = equations.layout
    turning = layout.angle.copy()
    for curved in layout.curved:
        if curved.piece is Piece.QUATERNION:
            turning[curved.coordinates] = True
    free = np.zeros(len(turning), dtype=bool)
    free[equations.free] = True
    steps = np.eye(len(turning))[turning & free] * TURN
    steps = np.concatenate([steps, -steps])
    return layout.retract(np.tile(point, (len(steps), 1)), steps)


def _together(first: Found, second: Found, best: Found) -> Tally:
    """What was tried in both searches, and how many of them all reached the cost of the best."""
    tallies = [each.tally or Tally(tried=1, converged=1, best_found=1) for each in (first, second)]
    lowest = [equal_costs(each.minimum.cost, best.minimum.cost) for each in (first, second)]
    return Tally(
        tried=sum(each.tried for each in tallies),
        converged=sum(each.converged for each in tallies),
        best_found=sum(each.best_found for each, low in zip(tallies, lowest, strict=True) if low),
    )
