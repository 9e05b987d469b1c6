"""Minimal subsets: as few units as determine all unknowns, drawn at random, for any kind of equation.

Units are taken in random order as long as they raise the rank of the Jacobian at a generic point; so each subset draws
from a family's member just as much as the member needs, and units that say the same again are passed over.
"""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import sha256
from itertools import combinations
from math import ceil, comb, log, log1p

import numpy as np

from mbm.solution.robust.units import Units
from mbm.solution.types import Floats, Indices
from mbm.target.decisions import MEMORY
from mbm.target.solver.consensus_sample import (
    FIRST_FACTOR,
    FIRST_JUMP,
    FIRST_MODULUS,
    INDEPENDENT,
    SECOND_FACTOR,
    SECOND_JUMP,
    SECOND_MODULUS,
    WHOLE_ORDER,
)

GOOD_SHARE = 0.6
"""Share of good units that the default number of trials is made for: 40 % outliers."""

MISSED = 1e-6
"""Probability that, with so many outliers, no trial is free of them."""

LEAST_TRIALS, MOST_TRIALS = 100, 3000


def needed_trials(size: int, asked: int | None) -> int:
    """How many trials with subsets of ``size`` units: what is asked for, or enough for 40 % outliers."""
    if asked is not None:
        return asked
    hit = GOOD_SHARE**size
    needed = ceil(log(MISSED) / log1p(-hit)) if 0.0 < hit < 1.0 else LEAST_TRIALS
    return min(max(needed, LEAST_TRIALS), MOST_TRIALS)


def trials_for(units: int, size: int, asked: int | None) -> int:
    """How many trials: what is asked for or needed, never more than there are subsets."""
    return min(needed_trials(size, asked), comb(units, size)) if size <= units else 1


def minimal_subsets(jacobian: Floats, units: Units, asked: int | None, seed: int) -> Indices:
    """Subsets (T, k) of units, each of full rank as far as all units together have it; -1 fills shorter ones up.

    ``jacobian`` (m, n) of the whitened residuals at a generic point. All subsets, in lexical order, where they are no
    more than the trials; else drawn with the generator of `mbm.target.solver.consensus_sample`, started by ``seed``.
    """
    rows = unit_rows(jacobian, units)
    rank = independent_columns(jacobian[units.of_row >= 0]) if units.count else 0
    if rank == 0:
        return np.empty((0, 0), dtype=np.int64)
    states = _states(seed, 1)
    first = _drawn(rows, _orders(states, units.count), 1, rank)
    size = int((first[0] >= 0).sum())
    trials = trials_for(units.count, size, asked)
    if trials == comb(units.count, size) and bool((units.components == units.components[0]).all()):
        every = np.array(list(combinations(range(units.count), size)), dtype=np.int64)
        found = _drawn(rows, iter(every.T), len(every), rank)
        return np.asarray(found[_ranks(rows, found) == rank])
    together = max(MEMORY // max(min(units.count, WHOLE_ORDER), rank * rank), 1)
    states = _states(seed, trials)
    chunks = [states[:, begin : begin + together] for begin in range(0, trials, together)]
    parts = [_drawn(rows, _orders(chunk, units.count), chunk.shape[1], rank) for chunk in chunks]
    width = max(part.shape[1] for part in parts)
    return np.concatenate([np.pad(p, ((0, 0), (0, width - p.shape[1])), constant_values=-1) for p in parts])


def independent_columns(jacobian: Floats) -> int:
    """How many combinations of the unknowns the rows (m, n) tell apart; what is not finite tells nothing."""
    return int(np.linalg.matrix_rank(_scaled(jacobian), tol=INDEPENDENT)) if jacobian.size else 0


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


def first_states(seed: int) -> tuple[int, int]:
    """The two states of the generator at the start of the first trial."""
    digest = sha256(repr(seed).encode()).digest()
    first, second = (int.from_bytes(part, "big") for part in (digest[:16], digest[16:]))
    return 1 + first % (FIRST_MODULUS - 1), 1 + second % (SECOND_MODULUS - 1)


def _states(seed: int, trials: int) -> Indices:
    """The states (2, trials) of the generator at the start of each trial."""
    first, second = first_states(seed)
    found = []
    for _ in range(trials):
        found.append((first, second))
        first, second = FIRST_JUMP * first % FIRST_MODULUS, SECOND_JUMP * second % SECOND_MODULUS
    return np.array(found, dtype=np.int64).T


def _orders(states: Indices, units: int) -> Iterator[Indices]:
    """The unit (trials,) that each trial looks at first, second, …; as `consensus_draw.subset_sampled` draws them."""
    first, second = states
    whole = units <= WHOLE_ORDER
    order = np.tile(np.arange(units), (len(first), 1)) if whole else np.empty((0, 0), dtype=np.int64)
    trials = np.arange(len(first))
    for position in range(min(units, WHOLE_ORDER)):
        first = FIRST_FACTOR * first % FIRST_MODULUS
        second = SECOND_FACTOR * second % SECOND_MODULUS
        number = (first - second + SECOND_MODULUS) % (FIRST_MODULUS - 1)
        if not whole:
            yield number % units
            continue
        other = position + number % (units - position)
        unit = order[trials, other]
        order[trials, other] = order[:, position]
        order[:, position] = unit
        yield unit


def _drawn(rows: Floats, orders: Iterator[Indices], trials: int, rank: int) -> Indices:
    """The units (T, k) that each trial takes in its order until the rank is full; -1 beyond."""
    width = rows.shape[2]
    basis = np.zeros((trials, rank, width))
    ranks = np.zeros(trials, dtype=np.int64)
    chosen = np.full((trials, rank), -1, dtype=np.int64)
    counts = np.zeros(trials, dtype=np.int64)
    active = np.arange(trials)
    for next_unit in orders:
        unit = next_unit[active]
        before = ranks[active]
        for component in range(rows.shape[1]):
            _extend(basis, ranks, active, rows[unit, component])
        raised = active[ranks[active] > before]
        chosen[raised, counts[raised]] = next_unit[raised]
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
