"""Minimal subsets: as few units as determine all unknowns, drawn at random, for any kind of equation.

Units are taken in random order as long as they raise the rank of the Jacobian at a generic point; so each subset draws
from a family's member just as much as the member needs, and units that say the same again are passed over.
"""

from __future__ import annotations

from itertools import combinations
from math import ceil, comb, log, log1p

import numpy as np

from mbm.solution.robust.units import Units
from mbm.solution.types import Floats, Indices

GOOD_SHARE = 0.6
"""Share of good units that the default number of trials is made for: 40 % outliers."""

MISSED = 1e-6
"""Probability that, with so many outliers, no trial is free of them."""

LEAST_TRIALS, MOST_TRIALS = 100, 3000

INDEPENDENT = 1e-5
"""A row whose part outside the rows before it is below this share of it says nothing new."""

MEMORY = 4_000_000
"""Numbers in the orders, and in the bases, of the trials that are drawn together."""

WHOLE_ORDER = 1000
"""Up to so many units they are shuffled; more are drawn with replacement (one drawn again says nothing new)."""


def trials_for(units: int, size: int, asked: int | None) -> int:
    """How many trials: what is asked for, or enough for 40 % outliers; never more than there are subsets."""
    if asked is None:
        hit = GOOD_SHARE**size
        needed = ceil(log(MISSED) / log1p(-hit)) if 0.0 < hit < 1.0 else LEAST_TRIALS
        asked = min(max(needed, LEAST_TRIALS), MOST_TRIALS)
    return min(asked, comb(units, size)) if size <= units else 1


def minimal_subsets(jacobian: Floats, units: Units, asked: int | None, seed: int) -> Indices:
    """Subsets (T, k) of units, each of full rank as far as all units together have it; -1 fills shorter ones up.

    ``jacobian`` (m, n) of the whitened residuals at a generic point. All subsets, in lexical order, where they are no
    more than the trials; else drawn with the generator PCG64 of ``seed``.
    """
    rows = unit_rows(jacobian, units)
    rank = int(np.linalg.matrix_rank(_scaled(jacobian[units.of_row >= 0]), tol=INDEPENDENT)) if units.count else 0
    if rank == 0:
        return np.empty((0, 0), dtype=np.int64)
    generator = np.random.Generator(np.random.PCG64(seed))
    first = _drawn(rows, _orders(generator, 1, units.count), rank)
    size = int((first[0] >= 0).sum())
    trials = trials_for(units.count, size, asked)
    if trials == comb(units.count, size) and bool((units.components == units.components[0]).all()):
        every = np.array(list(combinations(range(units.count), size)), dtype=np.int64)
        found = _drawn(rows, every, rank)
        return np.asarray(found[_ranks(rows, found) == rank])
    together = max(MEMORY // max(min(units.count, WHOLE_ORDER), rank * rank), 1)
    sizes = [min(together, trials - first) for first in range(0, trials, together)]
    parts = [_drawn(rows, _orders(generator, count, units.count), rank) for count in sizes]
    width = max(part.shape[1] for part in parts)
    return np.concatenate([np.pad(p, ((0, 0), (0, width - p.shape[1])), constant_values=-1) for p in parts])


def unit_rows(jacobian: Floats, units: Units) -> Floats:
    """Rows of the column-scaled Jacobian by unit, each unit's with norm 1: (U, d, n), zero rows where d differs."""
    ruled = np.flatnonzero(units.of_row >= 0)
    scaled = _scaled(jacobian[ruled])
    of_row = units.of_row[ruled]
    starts = np.searchsorted(of_row, np.arange(units.count))
    place = np.arange(len(ruled)) - starts[of_row]
    found = np.zeros((units.count, int(units.components.max(initial=1)), jacobian.shape[1]))
    found[of_row, place] = scaled
    return found


def _scaled(jacobian: Floats) -> Floats:
    finite = np.where(np.isfinite(jacobian), jacobian, 0.0)
    norms = np.linalg.norm(finite, axis=0)
    found = finite / np.where(norms > 0.0, norms, 1.0)
    lengths = np.linalg.norm(found, axis=1)
    return np.asarray(found / np.where(lengths > 0.0, lengths, 1.0)[:, None])


def _orders(generator: np.random.Generator, trials: int, units: int) -> Indices:
    """The order (trials, L) in which each trial looks at the units."""
    if units <= WHOLE_ORDER:
        return np.asarray(generator.permuted(np.tile(np.arange(units), (trials, 1)), axis=1), dtype=np.int64)
    return np.asarray(generator.integers(units, size=(trials, WHOLE_ORDER)), dtype=np.int64)


def _drawn(rows: Floats, orders: Indices, rank: int) -> Indices:
    """The units (T, k) that each order takes until the rank is full; -1 beyond."""
    trials, width = len(orders), rows.shape[2]
    basis = np.zeros((trials, rank, width))
    ranks = np.zeros(trials, dtype=np.int64)
    chosen = np.full((trials, rank), -1, dtype=np.int64)
    counts = np.zeros(trials, dtype=np.int64)
    active = np.arange(trials)
    for position in range(orders.shape[1]):
        unit = orders[active, position]
        before = ranks[active]
        for component in range(rows.shape[1]):
            _extend(basis, ranks, active, rows[unit, component])
        raised = active[ranks[active] > before]
        chosen[raised, counts[raised]] = orders[raised, position]
        counts[raised] += 1
        active = active[ranks[active] < rank]
        if not active.size:
            break
    return chosen[:, : int(counts.max(initial=0))]


def _extend(basis: Floats, ranks: Indices, active: Indices, rows: Floats) -> None:
    """Add what the rows (A, n) have outside the bases of the active trials, where that is anything."""
    mine = basis[active]
    left = rows
    for _ in range(2):  # the second pass takes out what rounding left of the first
        left = left - np.einsum("ak,akn->an", np.einsum("akn,an->ak", mine, left), mine)
    length = np.linalg.norm(left, axis=1)
    new = (length > INDEPENDENT) & (ranks[active] < basis.shape[1])
    who = active[new]
    basis[who, ranks[who]] = left[new] / length[new, None]
    ranks[who] += 1


def _ranks(rows: Floats, subsets: Indices) -> Indices:
    picked = np.where((subsets >= 0)[:, :, None, None], rows[np.maximum(subsets, 0)], 0.0)
    flat = picked.reshape(len(subsets), -1, rows.shape[2])
    return np.asarray(np.linalg.matrix_rank(flat, tol=INDEPENDENT), dtype=np.int64)
