"""Marquardt's method on the support function, for many points at once."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats
from mbm.estimation.starts.silhouettes.hulls import Hulls


def best(points: Floats, costs: Floats, count: int) -> tuple[Floats, Floats]:
    """The points (S, N) of the least finite ``costs`` (S,), in their order, and these."""
    order = np.argsort(costs, kind="stable")[:count]
    order = order[np.isfinite(costs[order])]
    return points[order], costs[order]


def refined(hulls: Hulls, points: Floats, steps: int) -> tuple[Floats, Floats]:
    """The points after steps of Marquardt's method, and their mean square misfits."""
    damping = np.full(len(points), 1e-2)
    misfits, slopes = hulls.linearised(points)
    costs = np.square(misfits).mean(axis=1)
    for _ in range(steps):
        normal = np.einsum("sdi,sdj->sij", slopes, slopes)
        right = np.einsum("sdi,sd->si", slopes, misfits)
        usable = np.isfinite(normal).all(axis=(1, 2)) & np.isfinite(right).all(axis=1)
        scale = np.einsum("sii->si", normal)
        scale = scale + 1e-9 * scale.max(axis=1, keepdims=True) + 1e-30
        normal += (damping[:, None] * scale)[:, None] * np.eye(scale.shape[1])
        step = np.zeros(right.shape)
        step[usable] = -np.linalg.solve(normal[usable], right[usable][..., None])[..., 0]
        moved = _moved(hulls, points, step)
        new_misfits, new_slopes = hulls.linearised(moved)
        new_costs = np.square(new_misfits).mean(axis=1)
        better = new_costs < costs
        points = np.where(better[:, None], moved, points)
        costs = np.where(better, new_costs, costs)
        misfits = np.where(better[:, None], new_misfits, misfits)
        slopes = np.where(better[:, None, None], new_slopes, slopes)
        damping = np.where(better, damping / 5, damping * 5)
    return points, costs


def _moved(hulls: Hulls, points: Floats, step: Floats) -> Floats:
    """The points after steps of the open coordinates, within the ranges where starts lie, and hard bounds."""
    layout = hulls.layout
    every = np.zeros((len(points), len(layout.number)))
    every[:, hulls.open_ones] = step
    moved = layout.retract(points, every)
    plain = hulls.open_ones[layout.number[hulls.open_ones] >= 0]
    numbers = layout.number[plain]
    low = np.fmax(layout.start_lower[plain], layout.lower[plain])
    high = np.fmin(layout.start_upper[plain], layout.upper[plain])
    moved[:, numbers] = np.fmin(np.fmax(moved[:, numbers], low), high)
    return moved
