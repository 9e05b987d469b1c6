"""The unknowns without a start in which the equations are affine given the others, and their least squares solution."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group, affine
from mbm.equations.types import Floats, Mask

SINGULAR, PASSES = 1e-13, 2
"""Eigenvalue of the normal equations, beside the largest, below which a combination is not determined; how often they
are solved: the second time makes up for the digits that they cost (corrected seminormal equations, Björck 1987).
"""


def affine_coordinates(equations: Assembled, missing: Mask) -> Mask:
    """The coordinates (M,) among ``missing`` in which all equations together are affine; taken in as they come."""
    layout = equations.layout
    allowed = equations.is_free
    allowed &= missing & (layout.number >= 0)
    if all(affine(group, allowed) for group in equations.groups):
        return allowed
    found = np.zeros(len(allowed), dtype=bool)
    touching: dict[str, list[Group]] = {entry.unknown.name: [] for entry in layout.entries}
    for group in equations.groups:
        # times at which tables are sampled may hold any unknown
        for name in touching if group.sampled else {slot.unknown for slot in group.kernel.tangents}:
            touching[name].append(group)
    for entry in layout.entries:
        for component in range(entry.unknown.freedom):
            places = np.arange(entry.coordinates.start + component, entry.coordinates.stop, entry.unknown.freedom)
            new = places[allowed[places]]
            trial = found.copy()
            trial[new] = True
            # the others are affine in what was found before
            if len(new) and all(affine(group, trial) for group in touching[entry.unknown.name]):
                found = trial
    return found


def solved_linearly(equations: Assembled, numbers: Floats, coordinates: Mask) -> Floats:
    """``numbers`` with the least squares solution for ``coordinates`` (M,), of least norm where it is not unique."""
    return linear_solver(equations, numbers, coordinates)(numbers)


def linear_solver(equations: Assembled, numbers: Floats, coordinates: Mask) -> Callable[[Floats], Floats]:
    """What gives any numbers (N,) the least squares solution for ``coordinates`` (M,); ``numbers`` are some of them."""
    layout = equations.layout
    places = np.flatnonzero(coordinates)
    zero = numbers.copy()
    zero[layout.number[places]] = 0.0
    partial = equations if np.array_equal(places, equations.free) else equations.freed(places, zero)
    positive = layout.positive[places]

    def solved(others: Floats) -> Floats:
        start = others.copy()
        start[layout.number[places]] = 0.0
        residuals, jacobian = partial.plain_linearised(start)
        usable = np.isfinite(residuals) & np.isfinite(jacobian).all(axis=1)
        scale = np.linalg.norm(jacobian[usable], axis=0)
        scale[scale == 0] = 1.0
        solution = np.linalg.lstsq(jacobian[usable] / scale, -residuals[usable], rcond=None)[0] / scale
        solution[positive] = np.where(solution[positive] > 0, solution[positive], 1.0)
        return partial.placed(start, solution)

    return solved


def projected(equations: Assembled, points: Floats, coordinates: Mask, steps: Floats) -> tuple[Floats, Floats]:
    """Points (T, N) with the least squares solutions for ``coordinates`` (M,), and Σ r² without losses (T,) there.

    The columns are differences over ``steps`` (M,), exact but for rounding. Where an equation has no value, the cost is
    infinite.
    """
    layout = equations.layout
    places = np.flatnonzero(coordinates)
    start = points.copy()
    start[:, layout.number[places]] = 0.0
    with np.errstate(all="ignore"):
        residuals = equations.plain_residuals_at(start)
        columns = np.empty((*residuals.shape, len(places)))
        for column, place in enumerate(places):
            moved = start.copy()
            moved[:, layout.number[place]] = steps[place]
            columns[:, :, column] = equations.plain_residuals_at(moved) - residuals
        usable = np.isfinite(residuals).all(axis=1) & np.isfinite(columns).all(axis=(1, 2))
        costs = np.full(len(points), np.inf)
        length = np.linalg.norm(columns[usable], axis=1)
        length[~(length > 0)] = 1.0
        columns[usable] /= length[:, None]
        turned = np.swapaxes(columns[usable], 1, 2)
        inverse = np.linalg.pinv(turned @ columns[usable], rcond=SINGULAR, hermitian=True)
        left, solution = residuals[usable], np.zeros_like(length)
        for _ in range(PASSES):
            step = (inverse @ (turned @ -left[:, :, None]))[:, :, 0]
            solution, left = solution + step, left + (columns[usable] @ step[:, :, None])[:, :, 0]
        solution *= steps[places] / length
        lower = np.where(layout.positive[places], np.maximum(layout.lower[places], 0.0), layout.lower[places])
        inside = np.clip(solution, lower, layout.upper[places])
        inside = np.where(layout.positive[places] & ~(inside > 0), np.abs(steps[places]), inside)
        start[np.ix_(usable, layout.number[places])] = inside
        left += (columns[usable] @ ((inside - solution) * length / steps[places])[:, :, None])[:, :, 0]
        costs[usable] = np.square(left).sum(axis=1)
    return start, np.where(np.isfinite(costs), costs, np.inf)
