"""The foot of every measured point on its conditions: Newton's method on all components at once, safeguarded.

For fixed unknowns: minimise ``|u|² + |e|²`` subject to ``h(u) = e``. Sequential quadratic programming with the exact
curvature (Nocedal and Wright 2006, ch. 18), an exact penalty as the merit, and Gauss-Helmert's direction where
Newton's does not descend. Plain Newton steps come first: they converge where corrections are small beside the
curvature. It starts at the measured values, so that the feet depend on the unknowns alone.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.corrections.search import Search, begun, curved_up, step, swept
from mbm.equations.corrections.types import Conditions, Feet, Local, entered
from mbm.equations.types import Floats, Indices, Mask

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

    def __init__(self, conditions: Conditions, scale: Floats) -> None:
        self.noisy = conditions.noisy
        self.corrections = conditions.corrections
        self.scale = scale
        self._conditions = conditions

    def some(self, components: Indices) -> _Scaled:
        return _Scaled(self._conditions.some(components), self.scale[components])

    def at(self, corrections: Floats, multipliers: Floats) -> Local:
        local = self._conditions.at(corrections, multipliers / self.scale)
        return Local(
            values=local.values / self.scale,
            slopes=local.slopes / self.scale[:, :, None],
            curvature=local.curvature,
        )


def _scaled(conditions: Conditions) -> _Scaled:
    rows, k = conditions.noisy.shape
    slopes = conditions.at(np.zeros((rows, conditions.corrections)), np.zeros((rows, k))).slopes
    sizes = np.sqrt(np.einsum("rkq,rkq->rk", slopes, slopes))
    return _Scaled(conditions, np.where(conditions.noisy | ~(sizes > 0.0) | ~np.isfinite(sizes), 1.0, sizes))


@np.errstate(all="ignore")
def feet(conditions: Conditions, near: Feet | None = None) -> Feet:
    """The feet of all components; ``found`` is False where there is none, or none that is a minimum.

    ``near`` are the feet for other unknowns not far off: they save steps, but decide nothing.
    """
    rows, k = conditions.noisy.shape
    begun_near = near is not None and bool(near.found.all())
    if near is not None and begun_near:
        found = calm_feet(conditions, near.corrections, near.multipliers)
    else:
        found = calm_feet(conditions, np.zeros((rows, conditions.corrections)), np.zeros((rows, k)))
    left = np.flatnonzero(~found.found)
    if not len(left):
        return found
    others = conditions.some(left)
    return entered(found, left, feet(others) if begun_near else searched_feet(others))


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
    scaled = _scaled(conditions)
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
    """The search from ``start`` (R, q); components that have stopped are taken out once they are the half."""
    whole = search = begun(conditions, start)
    rows = np.arange(len(start))
    for _ in range(sweeps):
        going = np.flatnonzero(~(search.done | search.lost))
        if not len(going):
            break
        if len(going) <= len(rows) // 2:
            whole = entered(whole, rows, search)
            rows, search, conditions = rows[going], search.some(going), conditions.some(going)
        search = swept(conditions, search)
    return entered(whole, rows, search)


def is_minimum(search: Search) -> Mask:
    """Whether each point (R,) is stationary, and a nearest one rather than a farthest."""
    target, _ = step(search.slopes, None, search.noisy, search.values, search.corrections)
    size = 1.0 + np.abs(search.corrections).max(axis=1, initial=0.0)
    stays = np.abs(target - search.corrections).max(axis=1, initial=0.0) <= STATIONARY * size
    return np.asarray(stays & curved_up(search.slopes, search.curvature, search.noisy, stays), dtype=bool)


def _elsewhere(conditions: Conditions, search: Search, found: Mask) -> tuple[Search, Mask]:
    """Components without a foot, again from points around the measured one; the smallest corrections win."""
    left = np.flatnonzero(~found)
    whole, best, conditions = search, search.some(left), conditions.some(left)
    (rows, q), sizes = best.corrections.shape, np.full(len(left), np.inf)
    first = best.corrections
    reach = np.maximum(np.sqrt(np.where(np.isfinite(first), first, 0.0) ** 2).sum(axis=1), 1.0)
    for size in REACHES:
        for direction in range(2 * min(q, MOST_DIRECTIONS)):
            start = np.zeros((rows, q))
            start[:, direction // 2] = size * reach * (1.0 if direction % 2 == 0 else -1.0)
            trial = _searched(conditions, start, FURTHER)
            good = trial.done & is_minimum(trial)
            length = np.where(good, (trial.corrections**2).sum(axis=1) + (trial.noises**2).sum(axis=1), np.inf)
            better = length < sizes
            best = best.with_rows(better, trial)
            sizes = np.where(better, length, sizes)
    found = found.copy()
    found[left] = np.isfinite(sizes)
    return entered(whole, left, best), found


MOST = 8
"""Steps; where Newton's method goes well it needs three or four from the measured values."""

SHORT = 0.01
"""… if the last one was as short as this at least."""

LAST = 1e-10
"""The search is over where the next step would be shorter than this, beside 1 + |u| standard deviations."""


def calm_feet(conditions: Conditions, start: Floats, multipliers: Floats) -> Feet:
    """The feet that full steps from ``start`` (R, q) lead to, not ``found`` where the search needs care.

    Each step must be shorter than half of the one before, and the end a nearest point, not a farthest.
    """
    here, last = start, np.full(len(start), np.inf)
    calm, done = np.ones(len(start), dtype=bool), np.zeros(len(start), dtype=bool)
    local = conditions.at(here, multipliers)
    for _ in range(MOST):
        target, aim = step(local.slopes, local.curvature, conditions.noisy, local.values, here)
        size = np.abs(target - here).max(axis=1, initial=0.0)
        calm &= done | (size < 0.5 * last)
        if not calm.any():
            break
        coming = np.where(last < np.inf, size * (size / last) ** 2, size)  # Newton's method converges quadratically
        here, multipliers = np.where(calm[:, None], target, here), np.where(calm[:, None], aim, multipliers)
        last = size
        local = conditions.at(here, multipliers)
        done |= (coming <= LAST * (1.0 + np.abs(here).max(axis=1, initial=0.0))) & (size < SHORT)
        if bool((done | ~calm).all()):
            break
    calm &= done
    misclosures = local.values - np.einsum("rkq,rq->rk", local.slopes, here)
    calm &= np.isfinite(misclosures).all(axis=1)
    return Feet(
        corrections=here,
        multipliers=multipliers,
        slopes=local.slopes,
        misclosures=misclosures,
        found=calm & curved_up(local.slopes, local.curvature, conditions.noisy, calm),
    )
