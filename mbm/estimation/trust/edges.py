"""Readings that are all the same value, the least or the largest of a clause: what lies beyond a limit, shown as it.

Instruments show a negative reading as 0 and stop at the end of their scale; laboratories enter a limit of detection, or
half of it, for what is below. Readings of a continuous quantity are seldom alike: one on a grid of steps q, with noise
of the standard deviation s, is a certain value with a probability of q/(s √2π) at most, so that k of n are alike with
less than the power k − 1 of that, C(n, k) times. One that is exactly 0 is told by the same bound, if others near by
might be so, too. How far values are below a limit follows from the model (Tobin 1958, Econometrica 26, 24–36).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import comb, erfc, exp, pi, sqrt

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices, Mask, Minimum
from mbm.estimation.trust import faults
from mbm.estimation.trust.coarse import read_column
from mbm.estimation.trust.uneven import NO_DIFFERENCE, told_apart
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.text.types import Diagnostic

SELDOM = 0.01
"""Probability below which readings are not alike by chance: that of one of six which is 0 is 0.065 with three figures,
and 0.0065 with four."""

SHIFTED = 0.1
"""Standard deviations by which limits shift estimates from which on that matters, as far as the estimates tell, which
are shifted themselves: of six readings about 0 one that is shown as 0 tells 0.17 of 0.3."""

NEAR, BEYOND = 2.0, 5.0
"""Standard deviations from a limit up to which a reading might have been beyond it; and from which on it was not."""

FINEST = 1e-6
"""Steps, as a share of the range of readings, below which they are not told from what changes of units leave."""

LEAST_OTHERS = 2
"""Readings within the limit that tell how fine readings are."""

SIDES = 1.0, -1.0
"""The lower edge, and the upper one."""


@np.errstate(all="ignore")
def at_edge(
    readings: Floats, raw: Floats, deviations: Floats, basis: Floats, sign: float, margin: float = 0.0
) -> tuple[Floats, Mask]:
    """The least (``sign`` 1) or largest (−1) of the readings (…,), and whether it may be a limit that matters (…,).

    ``readings`` (…, m) are NaN for other rows, ``raw`` (…, m) what the model is larger by, ``deviations`` (…, m) the
    standard deviations as estimated, ``basis`` (…, m, k) orthonormal, the directions in which residuals follow
    estimates. Limits are reached nearer by a share ``margin``.
    """
    there = np.isfinite(readings)
    ordered = np.where(there, sign * readings, np.inf)
    least = ordered.min(axis=-1, keepdims=True)
    tied = there & (ordered == least)
    count = tied.sum(axis=-1)
    edge = sign * least[..., 0] + 0.0
    told = (count > 1) | (least[..., 0] == 0.0)
    if not told.any():
        return edge, told
    depth = np.where(there, least - ordered - sign * raw, -np.inf) / deviations
    near = (depth > -NEAR * (1.0 + margin)).sum(axis=-1)
    size = np.where(there, np.abs(readings), 0.0).max(axis=-1, keepdims=True)
    noisy = (there & (np.abs(raw) > NO_DIFFERENCE * size)).any(axis=-1)
    found = noisy & told & ((count > 1) | (near > 1))
    hidden = np.zeros(depth.shape)
    tied &= found[..., None]
    hidden[tied] = [_below(each) for each in depth[tied].tolist()]
    shift = np.sqrt(np.square(np.einsum("...mk,...m->...k", basis, hidden)).sum(axis=-1))
    return edge, np.asarray(found & (shift > SHIFTED * (1.0 - margin)))


def _below(depth: float) -> float:
    """How far a standard normal value is below ``depth`` on average, if it is below."""
    depth = max(depth, -BEYOND)
    return depth + sqrt(2.0 / pi) * exp(-0.5 * depth * depth) / erfc(-depth / sqrt(2.0))


def by_chance(count: int, rows: int, others: Floats, deviation: float) -> float:
    """A bound of the probability that so many readings of some rows are equal to a value by chance.

    ``others`` (n,) are the distances from it of readings of one kind, which tell how fine these are.
    """
    if len(others) < LEAST_OTHERS:
        return 1.0
    once = grid(others) / (deviation * sqrt(2.0 * pi))
    return rows * once if count == 1 else comb(rows, count) * once ** (count - 1)


def grid(distances: Floats) -> float:
    """The largest step of which all ``distances`` (n,) > 0 are whole multiples, by Euclid's algorithm."""
    finest, step = FINEST * float(distances.max()), 0.0
    for each in distances.tolist():
        larger, smaller = each, step
        while smaller > finest:
            larger, smaller = smaller, abs(larger - round(larger / smaller) * smaller)
        step = larger
    return step


def clauses_read(problem: Problem, equations: Assembled) -> dict[int, tuple[str, str]]:
    """The table and the column that hold the readings, of each clause of which such readings may be told."""
    found = {}
    for owner in told_apart(problem, equations):
        column, table = read_column(problem, owner), problem.blocks[owner].table
        if column is not None and table is not None:
            found[owner] = table, column
    return found


@np.errstate(all="ignore")
def readings_at_edges(
    problem: Problem,
    tables: Mapping[str, Table],
    equations: Assembled,
    minimum: Minimum,
    basis: Floats,
    variance: float,
) -> Iterator[Diagnostic]:
    """A warning for each clause some of whose readings stand at a limit that is not stated.

    ``basis`` (m, k) are the directions of the fit, ``variance`` is that of whitened residuals.
    """
    factors = np.ones(equations.count) if equations.factors is None else equations.picked(equations.factors)
    read: dict[int, tuple[Floats, Indices]] = {}
    for owner, (table, column) in clauses_read(problem, equations).items():
        groups = [group for group in equations.groups if group.kernel.owner == owner and group.rows]
        numbers = tables[table].numbers(column)
        if groups:
            places = np.concatenate([group.first + np.arange(group.rows) for group in groups])
            read[owner] = np.concatenate([numbers[np.asarray(group.positions)] for group in groups]), places
    weights = np.ones(equations.count)
    for group in equations.groups:
        if group.kernel.owner in read:
            weights[group.first : group.first + group.rows] = group.whiteners[0].weights[:, 0]
    deviations = factors * np.sqrt(variance) / weights
    for owner, (readings, places) in read.items():
        own, block = deviations[places], problem.blocks[owner]
        alike = [each for other, (each, _) in read.items() if problem.blocks[other].factor_name == block.factor_name]
        for sign in SIDES:
            edge, suspect = at_edge(readings, minimum.residuals[places] * own, own, basis[places], sign)
            if not suspect:
                continue
            away = np.abs(np.concatenate(alike) - edge)
            count = int((readings == edge).sum())
            if by_chance(count, len(readings), away[away > 0.0], float(np.median(own))) < SELDOM:
                yield faults.readings_at_edge(
                    block.span, block.name, (count, len(readings)), float(edge), lower=sign > 0
                )
                break
