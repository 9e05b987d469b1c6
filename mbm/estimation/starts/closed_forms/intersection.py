"""Directions to one point from known places: images by known cameras, bearings from known stations (triangulation).

Rays from known places → the point where they meet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import product

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.starts.closed_forms.rows import finite
from mbm.estimation.starts.closed_forms.types import Candidate, Plan, Situation
from mbm.values import dataclass

ITERATIONS = 30
SMALL = 1e-9
"""Length of the last step, in rad, with which a direction counts as found."""

LEFT_OVER = 1e-6
"""What may be left of the values, beside their size in other directions."""

Function = Callable[[Floats], Floats]
"""From one place for each row (n, d) to values (n, width) or slopes (n, width, d)."""


def directions(values: Function, slopes: Function, count: int, starts: Iterable[Floats]) -> Floats:
    """Unit vectors d (count, dim), one for each row, with ``values(d) = 0``; NaN where Newton finds none.

    The values depend on the direction of their argument alone. From each start (dim,) the search goes on in the plane
    that touches the sphere there, in which an undistorted pinhole camera is linear; the first start that leads all rows
    to a solution decides, otherwise each row takes its first.
    """
    found: Floats | None = None
    for start in starts:
        each = _from(values, slopes, count, start)
        each[~(np.abs(values(each)).max(axis=1) <= LEFT_OVER * _size(values, len(start)))] = np.nan
        found = each if found is None else np.where(np.isfinite(found), found, each)
        if bool(np.isfinite(found).all()):
            break
    if found is None:
        message = "a search for directions needs a start"
        raise ValueError(message)
    return found


def _size(values: Function, dimension: int) -> Floats:
    """The size of the values (n,) in directions that have nothing to do with the axes."""
    some = np.array([0.83, 0.71, 0.94])[:dimension]
    sizes = [np.nan_to_num(np.abs(values(sign * some)).max(axis=1)) for sign in (1.0, -1.0)]
    return np.asarray(np.maximum(*sizes))


def _from(values: Function, slopes: Function, count: int, start: Floats) -> Floats:
    axes = np.linalg.svd(start[None, :])[2][1:]
    offset = np.zeros((count, len(axes)))
    value = values(start + offset @ axes)
    done: Mask = np.zeros(count, dtype=bool)
    with np.errstate(all="ignore"):
        for _ in range(ITERATIONS):
            slope = slopes(start + offset @ axes) @ axes.T
            step = solved(slope, value)
            length = np.linalg.norm(step, axis=1)
            step *= np.minimum(1.0, 0.5 / np.maximum(length, 1e-300))[:, None] if length.max(initial=0.0) > 5 else 1.0
            trial = offset - np.where(np.isfinite(step), step, 0.0)
            trial_value = values(start + trial @ axes)
            worse = ~(np.abs(trial_value).max(axis=1) <= np.abs(value).max(axis=1))
            for _ in range(8):
                if not bool((worse & ~done & np.isfinite(length)).any()):
                    break
                trial = np.where(worse[:, None], (trial + offset) / 2, trial)
                trial_value = values(start + trial @ axes)
                worse = ~(np.abs(trial_value).max(axis=1) <= np.abs(value).max(axis=1))
            done |= np.isfinite(length) & (length <= SMALL * (1 + np.linalg.norm(offset, axis=1)))
            offset = np.where(worse[:, None], offset, trial)
            value = np.where(worse[:, None], value, trial_value)
            if bool((done | ~np.isfinite(length)).all()):
                break
    found = start + offset @ axes
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    return np.where(done[:, None], found, np.nan)


def solved(slope: Floats, value: Floats) -> Floats:
    """Newton's steps (n, width) of square systems, NaN where they are singular."""
    determinant = np.linalg.det(np.where(np.isfinite(slope), slope, 0.0))
    usable = np.isfinite(slope).all(axis=(1, 2)) & np.isfinite(value).all(axis=1) & (determinant != 0)
    safe = np.where(usable[:, None, None], slope, np.eye(value.shape[1]))
    return np.where(
        usable[:, None], np.linalg.solve(safe, np.where(usable[:, None], value, 0.0)[..., None])[..., 0], np.nan
    )


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
        origins = origins_of(rows.slopes, len(rows), d)
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


def origins_of(slopes: Function, count: int, d: int) -> Floats | None:
    """The places (count, d) from which directions are seen: ``∇h(p) (p − c) = 0`` is linear in c. None: there are none.

    ``slopes`` gives those of all rows at one place (d,).
    """
    generator = np.random.default_rng(0)
    middle, size = np.zeros(d), 1.0
    origins = None
    for _ in range(2):
        normal, right = np.zeros((count, d, d)), np.zeros((count, d))
        for _ in range(4):
            probe = middle + size * generator.uniform(-1.0, 1.0, size=d)
            J = slopes(probe)
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
        J = slopes(probe)
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
