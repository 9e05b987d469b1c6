"""Directions to one point from known places: images by known cameras, bearings from known stations (triangulation).

Rays from known places → the point where they meet.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.lines_of_sight import directions
from mbm.estimation.starts.closed_forms.rows import Rows, finite
from mbm.estimation.starts.closed_forms.situation import Candidate, Situation
from mbm.estimation.starts.closed_forms.types import Plan
from mbm.values import dataclass

AGREEMENT = 1e-7
"""Change of an equation when the point moves along its ray, beside that when it moves across."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rays:
    """The rays (n, d) on which the point lies."""

    origins: Floats
    directions: Floats


@dataclass(frozen=True, slots=True)
class Intersection:
    """The point nearest to all rays."""

    name: str = "intersection"
    joint: bool = False

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Rows that know only the direction of the point from a place of their own."""
        del situation
        d = candidate.places.shape[1]
        if not candidate.flat or d not in (2, 3) or bool(candidate.angles.any()):
            return None
        rows = candidate.rows(d - 1)
        if len(rows) < 2:
            return None
        origins = _origins(rows, d)
        if origins is None:
            return None
        starts = [np.array(s) / np.linalg.norm(s) for s in product((0.0, 1.0, -1.0), repeat=d) if any(s)]
        found = directions(lambda x: rows.values(origins + x), lambda x: rows.slopes(origins + x), len(rows), starts)
        seen = finite(found, 1)
        if int(seen.sum()) < 2:
            return None
        rays = Rays(origins=origins[seen], directions=found[seen])
        return Plan(form=self, candidate=candidate, rows=rows.picked(seen), minimal=2, data=rays)

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """One point for each subset."""
        rays: Rays = plan.data
        found = meeting_points(rays.origins[subsets], rays.directions[subsets], plan.rows.weight[subsets])
        return found[:, None, :]


def _origins(rows: Rows, d: int) -> Floats | None:
    """The places from which the directions are seen: ``∇h(p) (p − c) = 0`` is linear in c. None if there are none."""
    generator = np.random.default_rng(0)
    middle, size = np.zeros(d), 1.0
    origins = None
    for _ in range(2):
        normal, right = np.zeros((len(rows), d, d)), np.zeros((len(rows), d))
        for _ in range(4):
            probe = middle + size * generator.uniform(-1.0, 1.0, size=d)
            J = rows.slopes(probe)
            if not bool(np.isfinite(J).all()):
                return None
            J = J / np.maximum(np.linalg.norm(J, axis=(1, 2), keepdims=True), 1e-300)
            normal += np.einsum("nwi,nwj->nij", J, J)
            right += np.einsum("nwi,nw->ni", J, J @ probe)
        values = np.linalg.eigvalsh(normal)
        if bool((values[:, 0] <= 1e-12 * values[:, -1]).any()):
            return None
        origins = np.linalg.solve(normal, right[..., None])[..., 0]
        middle = origins.mean(axis=0)
        size = 1.0 + float(np.abs(origins - middle).max())
    if origins is None:
        return None
    for _ in range(2):
        probe = middle + size * generator.uniform(-2.0, 2.0, size=d)
        J = rows.slopes(probe)
        along = np.abs(np.einsum("nwi,ni->nw", J, probe - origins)).max(axis=1)
        if not bool((along <= AGREEMENT * size * np.abs(J).max(axis=(1, 2))).all()):
            return None
    return np.asarray(origins)


INTERSECTION = Intersection()


PARALLEL_RAYS = 1e-12
"""Reciprocal condition of the normal equations below which all rays have one direction."""


def meeting_points(origins: Floats, directions: Floats, weights: Floats | None = None) -> Floats:
    """The points (…, d) that are nearest to all lines ``origins + s · directions`` (…, n, d), directions of length 1.

    Minimises ``Σ w |(1 − d dᵀ)(p − c)|²``; NaN where all lines are parallel.
    """
    d = directions.shape[-1]
    w = np.ones(directions.shape[:-1]) if weights is None else weights
    Q = w[..., None, None] * (np.eye(d) - directions[..., :, None] * directions[..., None, :])
    normal = Q.sum(axis=-3)
    right = np.einsum("...nij,...nj->...i", Q, origins)
    finite = np.isfinite(normal).all(axis=(-2, -1)) & np.isfinite(right).all(axis=-1)
    values = np.linalg.eigvalsh(np.where(finite[..., None, None], normal, 0.0))
    usable = finite & (values[..., 0] > PARALLEL_RAYS * values[..., -1])
    safe = np.where(usable[..., None, None], normal, np.eye(d))
    return np.where(usable[..., None], np.linalg.solve(safe, np.nan_to_num(right)[..., None])[..., 0], np.nan)
