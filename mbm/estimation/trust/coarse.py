"""Readings in steps that are coarse beside their scatter: rounding errors of successive rows are not independent.

A reading that is rounded to steps h is off by up to h/2. Where the scatter before rounding is above about h/2 these
errors are like noise of the variance h²/12 (Sheppard 1898; Widrow and Kollár 2008, Quantization Noise). Below, readings
of one value are alike, the residuals tell next to nothing of the noise, and the mean keeps an error that no number of
readings averages out, unless the model goes through many steps from row to row.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Covariance, Floats, Mask, Minimum
from mbm.estimation.trust import faults
from mbm.estimation.trust.lags import directions
from mbm.expression.nodes import Column
from mbm.expression.rows import RowChoice
from mbm.problem.tables import Table
from mbm.problem.types import BlockRole, Problem
from mbm.text.types import Diagnostic

COARSE = 0.55
"""Standard deviation of the readings about the model, in steps, below which the steps are coarse: 0.29 is that of
rounding alone; where the scatter before rounding is half a step, it is 0.58."""

SHIFTED = 0.5
"""Standard deviations by which rounding may shift estimates from which on that matters."""

LEAST_ROWS = 4
"""Readings that tell their steps: two of them have to be alike, and two to differ."""

WHOLE = 1e-6
"""Distance from whole numbers of steps up to which readings are such: what changes of units leave."""


def rounded_column(problem: Problem, owner: int) -> str | None:
    """The column that holds the readings of a block of scalar equations whose unknown noise their residuals tell."""
    block = problem.blocks[owner]
    return read_column(problem, owner) if block.unknown_factor and len(block.cases) == 1 else None


def read_column(problem: Problem, owner: int) -> str | None:
    """The column that holds the readings of a block of scalar equations."""
    block = problem.blocks[owner]
    if block.role is not BlockRole.OBSERVATION or block.table is None:
        return None
    sides = {each.measured for case in block.cases for each in case.equations}
    if len(sides) != 1 or any(len(case.equations) != 1 for case in block.cases):
        return None
    (measured,) = sides
    if measured is None or len(measured) != 1 or not isinstance(measured[0], Column):
        return None
    column = measured[0]
    simple = column.row is RowChoice.EACH and column.table == block.table and column.sampling is None
    return column.name if simple and column.member is None else None


@np.errstate(all="ignore")
def steps(readings: Floats) -> Floats:
    """The steps (…,) of readings (…, m), NaN where there is none; NaN where they are in no steps, or all are alike.

    Readings of a continuous quantity are never alike, and no whole numbers of their smallest difference.
    """
    ordered = np.sort(readings, axis=-1)
    apart = np.diff(ordered, axis=-1)
    step = np.min(np.where(apart > 0.0, apart, np.inf), axis=-1, initial=np.inf)
    counted = (ordered - ordered[..., :1]) / step[..., None]
    whole = (np.isnan(counted) | (np.abs(counted - np.rint(counted)) <= WHOLE)).all(axis=-1)
    alike = (apart == 0.0).any(axis=-1) & (np.isfinite(readings).sum(axis=-1) >= LEAST_ROWS)
    return np.where(whole & alike & np.isfinite(step), step, np.nan)


@np.errstate(all="ignore")
def coarse(readings: Floats, raw: Floats, deviations: Floats, basis: Floats, share: float = 0.0) -> Mask:
    """Where the steps of readings are coarse, or nearly: nearer to that than by a ``share``.

    ``readings`` (…, m) are NaN for other rows, ``raw`` (…, m) what the model is larger by, ``deviations`` (…, m) the
    standard deviations as estimated, ``basis`` (…, m, k) orthonormal, the directions in which residuals follow
    estimates. The rounding error of the reading of y has the first harmonic h/π sin(2π y/h).
    """
    there = np.isfinite(readings)
    step = steps(readings)
    known, scatter = np.where(there, deviations, np.nan), np.full(step.shape, np.nan)
    some = np.isfinite(known).any(axis=-1)
    scatter[some] = np.nanmedian(known[some], axis=-1)
    wave = np.exp(2j * np.pi * (readings + raw) / step[..., None]) / deviations
    along = np.einsum("...mk,...m->...k", basis, np.where(there, wave, 0.0))
    shift = step / np.pi * np.sqrt(np.square(np.abs(along)).sum(axis=-1))
    return np.asarray((scatter < COARSE * step * (1.0 + share)) & (shift > SHIFTED * (1.0 - share)))


def coarse_readings(
    problem: Problem, tables: Mapping[str, Table], equations: Assembled, minimum: Minimum, estimated: Covariance
) -> tuple[Diagnostic, ...]:
    """A warning for each clause whose readings have coarse steps at a minimum."""
    if minimum.blocks is not None or equations.rows is not None or equations.likely or equations.lossy:
        return ()
    stepped = dict(_stepped(problem, tables, equations))
    if not stepped or not bool(np.isfinite(estimated.factor).all()):
        return ()
    basis = directions(equations, minimum, estimated)
    factors = np.ones(equations.count) if equations.factors is None else equations.picked(equations.factors)
    redundancy = max(equations.count - basis.shape[1], 1)
    common = float(np.sqrt(minimum.cost / redundancy)) if equations.factors is None else 1.0
    told = []
    for number, readings in stepped.items():
        group = equations.groups[number]
        block = problem.blocks[group.kernel.owner]
        own = slice(group.first, group.first + group.count)
        unit = factors[own] / group.whiteners[0].weights[:, 0]
        if bool(coarse(readings, minimum.residuals[own] * unit, common * unit, basis[own])):
            scatter = common * float(np.median(unit)) / float(steps(readings))
            counts = bool((readings >= 0.0).all() and (readings == np.rint(readings)).all())
            told.append(faults.coarse_readings(block.span, block.name, scatter, counts=counts))
    return tuple(told)


def _stepped(problem: Problem, tables: Mapping[str, Table], equations: Assembled) -> Iterator[tuple[int, Floats]]:
    """The groups, by number, whose readings are in steps, and these readings (rows,)."""
    for number, group in enumerate(equations.groups):
        owner = group.kernel.owner
        name, table = rounded_column(problem, owner), problem.blocks[owner].table
        if name is None or table is None or group.positions is None or group.rows < LEAST_ROWS:
            continue
        readings = tables[table].numbers(name)[np.asarray(group.positions)]
        if bool(np.isfinite(steps(readings))):
            yield number, readings
