"""Random subsets of units for consensus: which units a trial takes, for all targets the same.

The numbers are those of L'Ecuyer's combined generator (1988, CACM 31 (6), fig. 3), whose products stay below 2⁴⁷: the
same in 64-bit integers and in Python. Trial t starts ``t · 2¹⁶`` numbers after the first one, so each trial depends on
the seed and its own number alone.
"""

from __future__ import annotations

from math import inf, log, sqrt

from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals
from mbm.solver.consensus_records import Units
from mbm.solver.linear_algebra import add_multiple, copied, dot, multiplied, numbered

FIRST_FACTOR = 40014
FIRST_MODULUS = 2147483563
SECOND_FACTOR = 40692
SECOND_MODULUS = 2147483399

FIRST_JUMP = pow(FIRST_FACTOR, 2**16, FIRST_MODULUS)
SECOND_JUMP = pow(SECOND_FACTOR, 2**16, SECOND_MODULUS)
"""Factors that take the state of one trial to that of the next."""

INDEPENDENT = 1e-5
"""A row whose part outside the rows before it is below this share of it says nothing new."""

FEWEST_TRIALS = 20
"""So many trials are made before what they explain may end them: what explains all rows may have a rival that does."""

LOG_MISSED = log(1e-6)
"""Probability, as a logarithm, that a solution is missed for no trial was free of its outliers."""

WHOLE_ORDER = 1000
"""Up to so many units they are shuffled; more are drawn with replacement (one drawn again says nothing new)."""


def drawn_below(state: Integers, limit: Integer) -> Integer:
    """The next number of the generator, one of 0 … limit − 1; ``state`` (2,) goes on by one."""
    state[0] = FIRST_FACTOR * state[0] % FIRST_MODULUS
    state[1] = SECOND_FACTOR * state[1] % SECOND_MODULUS
    return (state[0] - state[1] + SECOND_MODULUS) % (FIRST_MODULUS - 1) % limit


def jump_to_next_trial(state: Integers) -> None:
    """From the state (2,) at the start of a trial to that of the next one."""
    state[0] = FIRST_JUMP * state[0] % FIRST_MODULUS
    state[1] = SECOND_JUMP * state[1] % SECOND_MODULUS


def extended(rank: Integer, n: Integer, row: ConstantReals, basis: Reals) -> Integer:
    """The rank with one more row (n,) of norm 1 or 0: what it has outside the ``basis`` (rank, n) is added to that."""
    left = basis[rank * n :]
    copied(n, row, left)
    before = 1.0
    square = 0.0
    for _ in range(2):  # the second pass takes out what rounding left of the first
        for k in range(rank):
            add_multiple(n, -dot(n, basis[k * n :], left), basis[k * n :], left)
        square = dot(n, left, left)
        if square >= 0.25 * before:  # little was taken out, and little rounding with it
            break
        before = square
    length = sqrt(square)
    if not length > INDEPENDENT:
        return rank
    multiplied(n, 1.0 / length, left)
    return rank + 1


def unit_added(
    unit: Integer,
    rank: Integer,
    n: Integer,
    first: ConstantIntegers,
    rows: ConstantReals,
    basis: Reals,
) -> Integer:
    """The rank with all rows of a unit: ``first`` (U + 1,) says which of the ``rows`` (scalars, n) are a unit's."""
    for k in range(first[unit], first[unit + 1]):
        if rank < n:
            rank = extended(rank, n, rows[k * n :], basis)
    return rank


def subset_sampled(
    state: Integers,
    units: Units,
    enough: Integer,
    n: Integer,
    rows: ConstantReals,
    order: Integers,
    basis: Reals,
    chosen: Integers,
) -> Integer:
    """Units in random order as long as they raise the rank, until it is ``enough``: the rank they have.

    They are ``chosen`` (n + 1,), -1 behind the last. ``state`` (2,) is that of the trial and is used up; ``order`` (U,)
    and ``basis`` (n + 1, n) are scratch.
    """
    rank = 0
    count = 0
    tries = units.count
    if units.count > WHOLE_ORDER:
        tries = WHOLE_ORDER
    else:
        numbered(units.count, order)
    for position in range(tries):
        if units.count > WHOLE_ORDER:
            unit = drawn_below(state, units.count)
        else:
            other = position + drawn_below(state, units.count - position)
            unit = order[other]
            order[other] = order[position]
            order[position] = unit
        before = rank
        rank = unit_added(unit, rank, n, units.first, rows, basis)
        if rank > before:
            chosen[count] = unit
            count += 1
        if rank == enough:
            break
    chosen[count] = -1
    return rank


def count_chosen(chosen: ConstantIntegers) -> Integer:
    """How many units stand before the -1."""
    count = 0
    while chosen[count] >= 0:
        count += 1
    return count


def subset_taken(
    size: Integer,
    n: Integer,
    combination: ConstantIntegers,
    first: ConstantIntegers,
    rows: ConstantReals,
    basis: Reals,
    chosen: Integers,
) -> Integer:
    """Those of a combination's units (size,) that raise the rank are ``chosen``, -1 behind the last: the rank."""
    rank = 0
    count = 0
    for i in range(size):
        before = rank
        rank = unit_added(combination[i], rank, n, first, rows, basis)
        if rank > before:
            chosen[count] = combination[i]
            count += 1
    chosen[count] = -1
    return rank


def next_combination(units: Integer, size: Integer, combination: Integers) -> Integer:
    """The next of the ascending combinations (size,) of units in lexical order, in place; 0 after the last one."""
    place = size - 1
    while place >= 0 and combination[place] == units - size + place:
        place = place - 1
    if place < 0:
        return 0
    combination[place] += 1
    for i in range(place + 1, size):
        combination[i] = combination[i - 1] + 1
    return 1


def combinations_of(units: Integer, size: Integer, most: Integer) -> Integer:
    """How many subsets of ``size`` units there are, but no more than ``most`` + 1; 0 where there are too few units."""
    if size > units:
        return 0
    taken = size
    if units - size < size:
        taken = units - size
    found = 1
    for i in range(taken):
        found = found * (units - i) // (i + 1)
        if found > most:
            return most + 1
    return found


def trials_for_share(inside: Integer, units: Integer, size: Integer) -> Real:
    """Trials of ``size`` units until one is inside of a solution that explains ``inside`` of all units.

    But for `LOG_MISSED`; infinite where that is hopeless (Fischler and Bolles 1981, II.B, without replacement).
    """
    hit = 1.0
    for i in range(size):
        hit *= max(float(inside - i), 0.0) / float(units - i)
    if hit >= 1.0:
        return 0.0
    if hit < 1e-12:
        return inf
    return LOG_MISSED / log(1.0 - hit)
