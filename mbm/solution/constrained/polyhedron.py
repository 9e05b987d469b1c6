"""The point of a polyhedron that is nearest to the origin: the core of every quadratic subproblem.

The dual method of Goldfarb and Idnani (1983) with the Hessian made the identity: one constraint after the other is
added, the most violated first, and those whose multiplier would change its sign leave. It needs no feasible start,
says where there is no feasible point, and takes no harm from rows that depend on others.
"""

from __future__ import annotations

import numpy as np

from mbm.solution.types import Floats
from mbm.values import dataclass

DEPENDENT = 1e-10
"""A unit normal of which less than this part is left beside the active ones depends on them."""

FEASIBLE = 1e-13
"""Violations below this share of the point and the limits are rounding."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Nearest:
    """The nearest point (q,), the multipliers (k,) >= 0, the active rows; ``feasible`` False: there is no point."""

    point: Floats
    multipliers: Floats
    active: tuple[int, ...]
    feasible: bool


def nearest(normals: Floats, limits: Floats) -> Nearest:
    """The ``w`` of least ``‖w‖`` with ``normals @ w <= limits``; rows (k, q) of unit length.

    ``w + normalsᵀ multipliers = 0`` holds at the answer.
    """
    count, size = normals.shape
    point = np.zeros(size)
    active: list[int] = []
    multipliers: list[float] = []
    for _ in range(20 * (count + size) + 50):
        violations = normals @ point - limits
        violations[active] = -np.inf
        worst = int(np.argmax(violations)) if count else -1
        allowed = FEASIBLE * (1.0 + float(np.abs(point).max(initial=0.0)) + abs(float(limits[worst]))) if count else 0.0
        if worst < 0 or violations[worst] <= allowed:
            return _answer(normals, limits, active, multipliers, point)
        added = 0.0
        while True:
            normal = normals[worst]
            onward, change = _directions(normals, active, normal)
            violation = float(normal @ point - limits[worst])
            room = float(onward @ onward)
            full = violation / room if room > DEPENDENT * DEPENDENT else np.inf
            blocks = [(u / d, j) for j, (u, d) in enumerate(zip(multipliers, change, strict=True)) if d > DEPENDENT]
            block, leaving = min(blocks, default=(np.inf, -1))
            length = min(full, block)
            if not np.isfinite(length):
                return Nearest(point=point, multipliers=np.zeros(count), active=tuple(active), feasible=False)
            point = point - length * onward if np.isfinite(full) else point
            multipliers = [u - length * float(d) for u, d in zip(multipliers, change, strict=True)]
            added += length
            if full <= block:
                active.append(worst)
                multipliers.append(added)
                break
            del active[leaving], multipliers[leaving]
    return Nearest(point=point, multipliers=np.zeros(count), active=tuple(active), feasible=False)


def _directions(normals: Floats, active: list[int], normal: Floats) -> tuple[Floats, Floats]:
    """The part of ``normal`` that leaves the active rows as they are, and what its multiplier does to theirs."""
    if not active:
        return normal, np.zeros(0)
    basis, triangle = np.linalg.qr(normals[active].T)
    along = basis.T @ normal
    onward = normal - basis @ along
    onward -= basis @ (basis.T @ onward)
    return onward, np.linalg.solve(triangle, along)


def _answer(normals: Floats, limits: Floats, active: list[int], multipliers: list[float], point: Floats) -> Nearest:
    """The answer, with the point computed once more from its active rows: no error of the way there stays."""
    full = np.zeros(len(limits))
    if active:
        basis, triangle = np.linalg.qr(normals[active].T)
        point = basis @ np.linalg.solve(triangle.T, limits[active])
        exact = -np.linalg.solve(triangle, basis.T @ point)
        full[active] = np.maximum(exact, 0.0)
    return Nearest(point=point, multipliers=full, active=tuple(active), feasible=True)
