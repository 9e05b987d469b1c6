"""The foot of every measured point on its conditions: Newton's method on all components at once, safeguarded.

For fixed unknowns: minimise ``|u|² + |e|²`` subject to ``h(u) = e``. Sequential quadratic programming with the exact
curvature (Nocedal and Wright 2006, ch. 18), an exact penalty as the merit, and Gauss-Helmert's direction where
Newton's does not descend. Plain Newton steps come first: they converge where corrections are small beside the
curvature. It starts at the measured values, so that the feet depend on the unknowns alone.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.corrections.search import Search, begun, swept
from mbm.equations.corrections.steps import curved_up, step
from mbm.equations.corrections.types import Conditions, Feet, Local
from mbm.equations.types import Floats, Mask

SWEEPS = 60
"""Evaluations of the first search; Newton's method needs four or five of them, what takes more is lost."""

FURTHER = 20
"""Evaluations of each further one."""

REACHES = (1.0, 3.0)
"""Distances of further starts where no foot is found, beside that of the first attempt."""

MOST_DIRECTIONS = 6
STATIONARY = 1e-6
"""How far Gauss-Helmert's step may lead from a foot, where it should stay, beside 1 + |u| standard deviations."""


class _Scaled:
    """Conditions with each exact equation divided by its standard deviation at the measured values."""

    def __init__(self, conditions: Conditions) -> None:
        rows, k = conditions.noisy.shape
        self.noisy = conditions.noisy
        self.corrections = conditions.corrections
        self._conditions = conditions
        self.scale = np.ones((rows, k))
        slopes = self.at(np.zeros((rows, self.corrections)), np.zeros((rows, k))).slopes
        sizes = np.sqrt(np.einsum("rkq,rkq->rk", slopes, slopes))
        self.scale = np.where(self.noisy | ~(sizes > 0.0) | ~np.isfinite(sizes), 1.0, sizes)

    def at(self, corrections: Floats, multipliers: Floats) -> Local:
        local = self._conditions.at(corrections, multipliers / self.scale)
        return Local(
            values=local.values / self.scale,
            slopes=local.slopes / self.scale[:, :, None],
            curvature=local.curvature,
        )


@np.errstate(all="ignore")
def feet(conditions: Conditions, near: Feet | None = None) -> Feet:
    """The feet of all components; ``found`` is False where there is none, or none that is a minimum.

    ``near`` are the feet for other unknowns not far off: they save steps, but decide nothing.
    """
    if near is not None and bool(near.found.all()):
        found = calm_feet(conditions, near.corrections, near.multipliers)
        if found is not None:
            return found
    rows, k = conditions.noisy.shape
    found = calm_feet(conditions, np.zeros((rows, conditions.corrections)), np.zeros((rows, k)))
    return found if found is not None else searched_feet(conditions)


def first_feet(conditions: Conditions) -> Feet:
    """The measured values themselves, as feet to first order: the misclosures are those of the equations there."""
    rows, k = conditions.noisy.shape
    here = np.zeros((rows, conditions.corrections))
    local = conditions.at(here, np.zeros((rows, k)))
    finite = np.isfinite(local.values).all(axis=1) & np.isfinite(local.slopes).all(axis=(1, 2))
    return Feet(
        corrections=here,
        multipliers=np.zeros((rows, k)),
        slopes=local.slopes,
        misclosures=local.values,
        found=np.asarray(finite, dtype=bool),
    )


def searched_feet(conditions: Conditions) -> Feet:
    """The feet by the safeguarded search."""
    scaled = _Scaled(conditions)
    search = _searched(scaled, np.zeros((len(scaled.scale), scaled.corrections)), SWEEPS)
    found = search.done & is_minimum(search)
    if not bool(found.all()):
        search, found = _elsewhere(scaled, search, found)
    slopes = search.slopes * scaled.scale[:, :, None]
    values = search.values * scaled.scale
    return Feet(
        corrections=search.corrections,
        multipliers=search.multipliers / scaled.scale,
        slopes=slopes,
        misclosures=values - np.einsum("rkq,rq->rk", slopes, search.corrections),
        found=found,
    )


def _searched(conditions: Conditions, start: Floats, sweeps: int) -> Search:
    search = begun(conditions, start)
    for _ in range(sweeps):
        if bool((search.done | search.lost).all()):
            break
        search = swept(conditions, search)
    return search


def is_minimum(search: Search) -> Mask:
    """Whether each point (R,) is stationary, and a nearest one rather than a farthest."""
    target, _ = step(search.slopes, None, search.noisy, search.values, search.corrections)
    size = 1.0 + np.abs(search.corrections).max(axis=1, initial=0.0)
    stays = np.abs(target - search.corrections).max(axis=1, initial=0.0) <= STATIONARY * size
    return np.asarray(stays & curved_up(search.slopes, search.curvature, search.noisy, stays), dtype=bool)


def _elsewhere(conditions: Conditions, search: Search, found: Mask) -> tuple[Search, Mask]:
    """Components without a foot, again from points around the measured one; the smallest corrections win."""
    best, sizes = search, np.where(found, 0.0, np.inf)
    rows, q = search.corrections.shape
    first = search.corrections
    reach = np.maximum(np.sqrt(np.where(np.isfinite(first), first, 0.0) ** 2).sum(axis=1), 1.0)
    for size in REACHES:
        for direction in range(2 * min(q, MOST_DIRECTIONS)):
            start = np.zeros((rows, q))
            start[:, direction // 2] = size * reach * (1.0 if direction % 2 == 0 else -1.0)
            start = np.where(found[:, None], best.corrections, start)
            trial = _searched(conditions, start, FURTHER)
            good = trial.done & is_minimum(trial) & ~found
            length = np.where(good, (trial.corrections**2).sum(axis=1) + (trial.noises**2).sum(axis=1), np.inf)
            better = length < sizes
            best = best.with_rows(better, trial)
            sizes = np.where(better, length, sizes)
    return best, found | np.isfinite(sizes)


MOST = 8
"""Steps; where Newton's method goes well it needs three or four from the measured values."""

SHORT = 0.01
"""… if the last one was as short as this at least."""

LAST = 1e-10
"""The search is over where the next step would be shorter than this, beside 1 + |u| standard deviations."""


def calm_feet(conditions: Conditions, start: Floats, multipliers: Floats) -> Feet | None:
    """The feet that full steps from ``start`` (R, q) lead to, or None where the search needs care.

    Each step must be shorter than half of the one before, and each end a nearest point, not a farthest.
    """
    here, last = start, np.inf
    local = conditions.at(here, multipliers)
    for _ in range(MOST):
        target, multipliers = step(local.slopes, local.curvature, conditions.noisy, local.values, here)
        size = float(np.abs(target - here).max(initial=0.0))
        if not size < 0.5 * last:
            return None
        coming = size * (size / last) ** 2 if last < np.inf else size  # Newton's method converges quadratically
        here, last = target, size
        local = conditions.at(here, multipliers)
        if coming <= LAST * (1.0 + float(np.abs(here).max(initial=0.0))) and size < SHORT:
            break
    else:
        return None
    misclosures = local.values - np.einsum("rkq,rq->rk", local.slopes, here)
    everywhere = np.ones(len(here), dtype=bool)
    if not np.isfinite(misclosures).all():
        return None
    if not curved_up(local.slopes, local.curvature, conditions.noisy, everywhere).all():
        return None
    return Feet(
        corrections=here,
        multipliers=multipliers,
        slopes=local.slopes,
        misclosures=misclosures,
        found=everywhere,
    )
