"""What the sizes of residuals say of the noise that is stated: uneven, by what is read; one row alone too large."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum
from functools import partial
from math import erfc, sqrt

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import ALL, Group, measured_side
from mbm.equations.solves import Lines
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.trust import faults
from mbm.estimation.trust.fits import Fits, Said
from mbm.estimation.uncertainty.student import beyond
from mbm.problem.factors import factor_groups
from mbm.problem.tables import Table
from mbm.problem.types import BlockRole, Problem
from mbm.values import dataclass

TELLING_ROWS = 20
"""Rows of a clause from which this can be told: with ten, errors that grow twentyfold are found once in seven."""

CHECKED = 0.75
"""Mean share of the residuals' variance that the fit leaves, from which ranks of residuals are as those of errors."""

UNCHECKED = 0.01
"""Share of a residual's variance below which its size is left to the other rows, and tells nothing of its error."""

NO_DIFFERENCE = 1e-9
"""Size of residuals, and differences of model values, beside the latter, that rounding in computation makes."""

BY_CHANCE = 0.01
"""Share of all solves of which it is said by chance that errors are uneven, or that outliers hide among them."""

USUAL = 2.575
"""Standard deviations of a correlation that chance exceeds in more than `BY_CHANCE` of all solves (normal, 2.5758)."""


class With(StrEnum):
    """What errors may grow with."""

    SIZE = "the size of its readings"
    VALUE = "its readings"
    ROW = "the number of the row"


def told_apart(problem: Problem, equations: Assembled) -> tuple[int, ...]:
    """The observations of which errors may be seen to grow: of rows with one reading each, stated as independent."""
    if equations.lossy or equations.likely or equations.rows is not None or problem.sequence is not None:
        return ()
    found: dict[int, bool] = {}
    for group in equations.groups:
        found[group.kernel.owner] = found.get(group.kernel.owner, True) and _single(problem, equations, group)
    return tuple(owner for owner, suits in found.items() if suits)


def _single(problem: Problem, equations: Assembled, group: Group) -> bool:
    """Whether a group is of rows with one reading each."""
    block = problem.blocks[group.kernel.owner]
    measured = all(each.measured is not None for each in block.cases[group.kernel.case].equations)
    alone = group.kernel.outputs == 1 and not equations.eliminated(group) and not block.structure.joins
    stated = len(group.whiteners) == 1 and group.whiteners[0].weights.ndim == 2
    return block.role is BlockRole.OBSERVATION and block.table is not None and measured and alone and stated


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Clauses:
    """T clauses of n rows each: arrays (T, n).

    ``fitted`` are the model's values, which differ by ``errors`` from the readings. The fit takes the share
    ``leverage`` of the variance of each of the whitened ``residuals``; ``rows`` are their numbers in the table.
    """

    fitted: Floats
    errors: Floats
    residuals: Floats
    leverage: Floats
    rows: Indices

    @np.errstate(all="ignore")
    def uneven(self, clauses: int) -> list[tuple[int, With, float]]:
        """Which of them have errors beyond what chance makes of one of so many ``clauses`` of a solve.

        Then what these grow with the most, and the rank correlation.
        """
        n = self.fitted.shape[1]
        largest = np.abs(self.fitted).max(axis=1, keepdims=True)
        steps = np.round(self.fitted / (NO_DIFFERENCE * largest))
        by_value, sized = _ranks(steps), np.abs(steps)
        columns = {With.SIZE: by_value, With.ROW: _ranks(self.rows)}
        if not bool((sized == steps).all()):
            columns = {With.SIZE: _ranks(sized), With.VALUE: by_value, With.ROW: columns[With.ROW]}
        sizes = self._sizes()
        found = np.stack([_products(each, sizes) for each in columns.values()])
        found = np.where(np.isfinite(found) & self._telling(largest), found, 0.0)
        nothing_read = np.ptp(self.fitted - self.errors, axis=1) <= NO_DIFFERENCE * largest[:, 0]
        found[:-1, nothing_read] = 0.0  # the model's values are the errors themselves there
        worst = np.abs(found).argmax(axis=0)
        correlation = found[worst, np.arange(len(worst))]
        seldom = np.flatnonzero(np.abs(correlation) * sqrt(n - 1) > USUAL)
        tests = _different([each[seldom] for each in columns.values()])
        return [
            (place, tuple(columns)[worst[place]], float(correlation[place]))
            for place, count in zip(seldom.tolist(), tests.tolist(), strict=True)
            if erfc(abs(correlation[place]) * sqrt(0.5 * (n - 1))) * count * clauses < BY_CHANCE
        ]

    def _sizes(self) -> Floats:
        """Ranks of the residuals' sizes; those that nothing checks stand in the middle."""
        free = 1.0 - self.leverage
        sizes = np.where(free > UNCHECKED, np.abs(self.residuals) / np.sqrt(np.maximum(free, UNCHECKED)), np.nan)
        unknown = np.isnan(sizes)
        if unknown.any():
            middle = np.isfinite(sizes).sum(axis=1, keepdims=True) // 2  # no np.nanmedian, which loads masked arrays
            sizes = np.where(unknown, np.take_along_axis(np.sort(sizes, axis=1), middle, axis=1), sizes)
        return _ranks(sizes)

    def _telling(self, largest: Floats) -> Mask:
        """Where residuals (T, n) are those of readings with noise, and checked by one another."""
        made = (np.abs(self.errors) > NO_DIFFERENCE * largest).any(axis=1)
        checked = 1.0 - self.leverage.mean(axis=1) >= CHECKED
        return np.asarray(made & checked & np.isfinite(self.fitted).all(axis=1))


def _products(ranks: Floats, others: Floats) -> Floats:
    """Rank correlations (T,): ranks (T, n) are of length 1."""
    return np.asarray(np.einsum("tn,tn->t", ranks, others))


def _different(columns: Sequence[Floats]) -> Indices:
    """How many (T,) of several columns (T, n) of ranks are not the same as one before, or its mirror image."""
    found = np.zeros(len(columns[0]), dtype=np.int64)
    for k, column in enumerate(columns):
        same = np.zeros(len(found), dtype=bool)
        for before in columns[:k]:
            same |= np.abs(_products(before, column)) > 1.0 - NO_DIFFERENCE
        found += ~same
    return found


def _ranks(values: Floats | Indices) -> Floats:
    """Ranks (T, n) along each row, about their mean and of length 1; equal values share one."""
    count, n = values.shape
    middle = 0.5 * (n - 1)
    plain = np.arange(n) - middle
    plain /= np.sqrt(np.square(plain).sum())
    if bool((values[:, 1:] > values[:, :-1]).all()):
        return np.broadcast_to(plain, values.shape)
    order = np.argsort(values, axis=1) + n * np.arange(count)[:, None]
    ordered = values.ravel()[order]
    differs = ordered[:, 1:] != ordered[:, :-1]
    ranks = np.broadcast_to(plain, values.shape)
    if not bool(differs.all()):
        ends = np.ones((count, 1), dtype=bool)
        first, last = np.hstack([ends, differs]), np.hstack([differs, ends])
        low = np.maximum.accumulate(np.where(first, np.arange(n), 0), axis=1)
        high = np.minimum.accumulate(np.where(last, np.arange(n), n)[:, ::-1], axis=1)[:, ::-1]
        shared = 0.5 * (low + high) - middle
        ranks = shared / np.sqrt(np.square(shared).sum(axis=1, keepdims=True))
    result = np.empty(values.size)
    result[order] = ranks
    return result.reshape(values.shape)


def uneven_noise(fits: Fits) -> Said:
    """Observations whose errors are uneven."""
    solves, equations = fits.solves, fits.solves.equations
    owners = () if solves.consensus or solves.most < TELLING_ROWS else told_apart(fits.problem, equations)
    if not owners:
        return
    leverage, errors = np.einsum("kmn,kmn->km", fits.basis, fits.basis), fits.errors()
    for owner in owners:
        fitted, rows = _read(fits, (owner,))
        fitted += errors
        counts = (rows >= 0).sum(axis=1)
        for count in np.unique(counts[counts >= TELLING_ROWS]).tolist():
            which = np.flatnonzero(counts == count)
            there = None if count == solves.most else np.nonzero(rows[which] >= 0)[1].reshape(-1, count)
            at = which if there is None else (which[:, None], there)
            alike = Clauses(
                fitted=fitted[at],
                errors=errors[at],
                residuals=fits.residuals[at],
                leverage=leverage[at],
                rows=rows[at],
            )
            block = fits.problem.blocks[owner]
            for place, grown, correlation in alike.uneven(len(owners)):
                yield int(which[place]), partial(faults.uneven_noise, block.span, block.name, grown, correlation)


def _read(fits: Fits, owners: tuple[int, ...]) -> tuple[Floats, Indices]:
    """Readings (K, m) of some blocks with one a row, and the numbers of the rows, -1 elsewhere."""
    problem, tables = fits.problem, fits.tables

    def readings(each: Lines) -> Floats | None:
        return measured_side(problem, each.group, tables, each.place) if each.group.kernel.owner in owners else None

    def rows(each: Lines) -> Indices | None:
        mine = each.group.kernel.owner in owners
        return table_rows(problem, each.group, tables, each.place)[:, None] if mine else None

    return fits.of_rows(readings), fits.of_rows(rows, -1)


def table_rows(problem: Problem, group: Group, tables: Mapping[str, Table], lines: Indices | slice = ALL) -> Indices:
    """The numbers (rows,) in their table of some rows of a group; 0 without one."""
    table = problem.blocks[group.kernel.owner].table
    if table is None or group.positions is None:
        return np.zeros(group.rows, dtype=np.int64)
    return np.asarray(tables[table].rows[group.positions[lines]])


OUTLYING_BY_CHANCE = 0.03
"""Share of all solves with normal noise in which a row is said to be outlying, at most."""

SECOND = 0.01
"""The same of the rows that are left without it: where one of them is outlying as well, the noise has long tails."""

WIDENED = 1.5
"""How much larger than without the row the noise is estimated at least: an interval of 95 % then holds the truth in
99.7 %."""

LEAST_FREEDOM, MOST_FREEDOM = 3.0, 30.0
"""Degrees of freedom of the noise: fewer tell no outlier; among more, one row that widens intervals so much is more
often one of several, as outliers in one of ten rows are, with which intervals hold the truth as often as they say."""

OUTLYING_CHECKED = 0.01
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
    squares = np.where(free > OUTLYING_CHECKED, np.square(residuals) / free, 0.0)
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
    if not found.probability < OUTLYING_BY_CHANCE:
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


def outlying_rows(fits: Fits) -> Said:
    """Solves in which one row makes unknown noise large."""
    blocks = () if fits.solves.consensus else pool(fits.problem, fits.solves.equations)
    if not blocks:
        return
    residuals, basis, own = fits.residuals, fits.basis, fits.solves.of_blocks(blocks)
    suspected = np.flatnonzero(suspects(residuals, np.square(basis).sum(axis=2), own))
    if not len(suspected):
        return
    measured, rows = _read(fits, blocks)
    owners, errors = fits.of_rows(lambda each: np.array([[each.group.kernel.owner]]), -1), fits.errors()
    for place in suspected.tolist():
        at = np.flatnonzero(own[place])
        found = outlier(residuals[place, at], basis[place, at])
        if found is not None and has_noise(measured[place, at], errors[place, at]):
            slot = place, at[found.place]
            block = fits.problem.blocks[int(owners[slot])]
            told = int(rows[slot]), found.distance, found.probability, found.widened
            yield place, partial(faults.outlying_row, block.span, block.name, *told)


def has_noise(measured: Floats, errors: Floats) -> bool:
    """Whether readings differ from the model's values by more than rounding."""
    return bool(np.abs(errors).max() > NO_DIFFERENCE * np.abs(measured + errors).max())
