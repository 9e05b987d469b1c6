"""One row whose residual is alone the reason why unknown noise is estimated large: an outlier, with known chances.

The residual from the fit without the row, over its standard deviation there, has Student's t distribution with one
degree of freedom less than the noise has (the externally studentised residual: Beckman and Trussell 1974; Cook and
Weisberg 1982, Residuals and Influence in Regression, 2.2). The largest of n is beyond t with less than n times the
probability of one (Bonferroni), so that an unknown factor is taken account of. Such a row widens all intervals: of
eight results of which one is eight standard deviations off, the interval of the mean is three times as wide as without.
Where several rows are far off, the noise has long tails; intervals of the mean then hold as often as they say.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import measured_side
from mbm.equations.types import Floats, Indices, Mask, Minimum
from mbm.estimation.trust import faults
from mbm.estimation.trust.uneven import NO_DIFFERENCE, table_rows, told_apart
from mbm.estimation.uncertainty.student import beyond
from mbm.problem.factors import factor_groups
from mbm.problem.tables import Table
from mbm.problem.types import BlockRole, Problem
from mbm.text.types import Diagnostic
from mbm.values import dataclass

BY_CHANCE = 0.03
"""Share of all solves with normal noise in which a row is said to be outlying, at most."""

SECOND = 0.01
"""The same of the rows that are left without it: where one of them is outlying as well, the noise has long tails."""

WIDENED = 1.5
"""How much larger than without the row the noise is estimated at least: an interval of 95 % then holds the truth in
99.7 %."""

LEAST_FREEDOM, MOST_FREEDOM = 3.0, 30.0
"""Degrees of freedom of the noise: fewer tell no outlier; among more, one row that widens intervals so much is more
often one of several, as outliers in one of ten rows are, with which intervals hold the truth as often as they say."""

CHECKED = 0.01
"""Share of a residual's variance below which the other rows say nothing of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outlier:
    """The row at ``place``: its residual without it is ``distance`` standard deviations, with the ``probability`` of
    one as far among all rows; with it, noise is ``widened`` so many times.
    """

    place: int
    distance: float
    probability: float
    widened: float


@np.errstate(all="ignore")
def widening(residuals: Floats, leverage: Floats, pool: Mask) -> tuple[Floats, Floats, Indices]:
    """How much larger noise is estimated (…,) than without the row that widens it most; its dof (…,); that row (…,).

    ``residuals`` (…, m) are whitened, of whose variance the fit takes the share ``leverage`` (…, m); those of the
    ``pool`` (…, m) have one unknown factor.
    """
    free = np.where(pool, 1.0 - leverage, 0.0)
    dof = free.sum(axis=-1)
    squares = np.where(free > CHECKED, np.square(residuals) / free, 0.0)
    place = squares.argmax(axis=-1)
    largest = np.take_along_axis(squares, place[..., None], axis=-1)[..., 0]
    left = np.where(pool, np.square(residuals), 0.0).sum(axis=-1) - largest
    return np.sqrt((left + largest) / dof * (dof - 1.0) / np.maximum(left, 0.0)), dof, place


def suspects(residuals: Floats, leverage: Floats, pool: Mask) -> Mask:
    """Where one row may be outlying (…,); arguments as for `widening`."""
    widened, dof, _ = widening(residuals, leverage, pool)
    return np.asarray((widened >= WIDENED) & (dof >= LEAST_FREEDOM) & (dof <= MOST_FREEDOM))


@np.errstate(all="ignore")
def outlier(residuals: Floats, basis: Floats) -> Outlier | None:
    """The row of a pool of noise that is outlying alone; ``residuals`` (n,) whitened, ``basis`` (n, k) orthonormal."""
    leverage, pool = np.square(basis).sum(axis=1), np.ones(len(residuals), dtype=bool)
    if not bool(suspects(residuals, leverage, pool)):
        return None
    found = _largest(residuals, leverage, pool)
    if not found.probability < BY_CHANCE:
        return None
    across = basis @ basis[found.place]
    free = 1.0 - leverage[found.place]
    pool[found.place] = False
    without = _largest(residuals + across * residuals[found.place] / free, leverage + np.square(across) / free, pool)
    return None if without.probability < SECOND else found


def _largest(residuals: Floats, leverage: Floats, pool: Mask) -> Outlier:
    widened, dof, place = widening(residuals, leverage, pool)
    # s/s_without is the root of (ν − e²)/(ν − 1), where t² is e² (ν − 1)/(ν − e²)
    distance = float(np.sqrt(np.maximum(dof * np.square(widened) - dof + 1.0, 0.0)))
    probability = int(pool.sum()) * beyond(distance, float(dof) - 1.0)
    return Outlier(place=int(place), distance=distance, probability=probability, widened=float(widened))


def pool(problem: Problem, equations: Assembled) -> tuple[int, ...]:
    """The blocks of which this can be told: of rows with one reading each and one unknown factor; none if not all are.

    Where there are several noises the weights follow the residuals as well, and an outlier is told too often.
    """
    read = [number for number, block in enumerate(problem.blocks) if block.role is BlockRole.OBSERVATION]
    unknown = [number for number in read if problem.blocks[number].unknown_factor]
    alone = unknown == read and len(factor_groups(problem.blocks, unknown)) == 1
    return tuple(read) if alone and set(read) <= set(told_apart(problem, equations)) else ()


def outlying_rows(
    problem: Problem, tables: Mapping[str, Table], equations: Assembled, minimum: Minimum, basis: Floats
) -> Iterator[Diagnostic]:
    """A warning if one row makes unknown noise large; ``basis`` (m, k) are the directions of the fit."""
    blocks = pool(problem, equations)
    groups = [group for group in equations.groups if group.kernel.owner in blocks and group.rows]
    if not groups:
        return
    places = np.concatenate([group.first + np.arange(group.rows) for group in groups])
    found = outlier(minimum.residuals[places], basis[places])
    if found is None:
        return
    errors = np.concatenate([group.values(minimum.point)[:, 0] for group in groups])
    sides = [measured_side(problem, group, tables) for group in groups]
    measured = np.concatenate([side[:, 0] for side in sides if side is not None])
    if has_noise(measured, errors):
        numbers = np.concatenate([table_rows(problem, group, tables) for group in groups])
        owners = np.repeat([group.kernel.owner for group in groups], [group.rows for group in groups])
        yield outlying_row(problem, int(owners[found.place]), int(numbers[found.place]), found)


def has_noise(measured: Floats, errors: Floats) -> bool:
    """Whether readings differ from the model's values by more than rounding."""
    return bool(np.abs(errors).max() > NO_DIFFERENCE * np.abs(measured + errors).max())


def outlying_row(problem: Problem, owner: int, row: int, found: Outlier) -> Diagnostic:
    """The warning about a row of a clause."""
    block = problem.blocks[owner]
    return faults.outlying_row(block.span, block.name, row, found.distance, found.probability, found.widened)
