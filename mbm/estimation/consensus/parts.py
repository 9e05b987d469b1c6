"""Problems that fall apart: unknowns that no equation connects are brought to agreement one part after the other.

Sixty places from twelve ranges each need sixty clean triples: no trial has them all, but each part has its own at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.excerpt import excerpt
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.consensus.agreeing import agreed
from mbm.estimation.consensus.types import Agreed, Asked
from mbm.estimation.consensus.units import Units, without_losses
from mbm.estimation.minimise.minimise import minimise
from mbm.solver.decisions import STATED
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Coordinates ``columns`` (positions among all), and the residuals ``rows`` (of all) that touch them alone."""

    columns: Indices
    rows: Indices


def parts_of(equations: Assembled) -> tuple[Part, ...]:
    """The parts, in the order of their first coordinate; residuals that touch nothing are in none.

    Measured values with errors connect the rows that share them, as unknowns do.
    """
    place = equations.columns
    touched = [place[group.touched] for group in (*equations.groups, *equations.constraints)]
    joined = any(_touches_all(columns, equations.dimension) for columns in touched)
    label = np.zeros(equations.dimension, dtype=np.int64) if joined else _labels(equations, touched)
    of_row = np.full(equations.whole, -1, dtype=np.int64)
    for group, columns in zip(equations.groups, touched, strict=False):
        lowest = _lowest(label, columns)
        lowest[lowest == equations.dimension] = -1
        every = np.broadcast_to(lowest, group.rows) if len(lowest) == 1 else lowest
        of_row[group.first : group.first + group.count] = np.repeat(every, group.kernel.outputs)
    return tuple(
        Part(columns=equations.free[label == each], rows=np.flatnonzero(of_row == each))
        for each in np.unique(label).tolist()
    )


def _labels(equations: Assembled, touched: Sequence[Indices]) -> Indices:
    """The first coordinate that each (n,) is connected with, where groups have ``touched`` them row by row."""
    count, implicit = equations.dimension, equations.implicit
    if implicit is None:
        return connections(touched, count)
    with_values, measured = list(touched), implicit.measured
    for number, ids in measured.ids.items():
        values = np.where(measured.sigma[ids] > 0.0, count + ids, -1)
        columns = np.broadcast_to(touched[number], (len(ids), touched[number].shape[1]))
        with_values[number] = np.hstack([columns, values])
    return connections(with_values, count + len(measured.sigma))[:count]


def connections(touched: Sequence[Indices], count: int) -> Indices:
    """The first coordinate that each of ``count`` is connected with; ``touched`` (R, k) by each row, -1: nothing."""
    label = np.arange(count)
    while True:
        before = label.copy()
        for columns in touched:
            lowest = _lowest(label, columns)
            inside = columns >= 0
            np.minimum.at(label, columns[inside], np.broadcast_to(lowest[:, None], columns.shape)[inside])
        label = label[label]
        if bool((label == before).all()):
            return label


def _touches_all(columns: Indices, dimension: int) -> bool:
    """Whether rows that are all the same touch every coordinate."""
    return len(columns) == 1 and len(set(columns[0].tolist()) - {-1}) == dimension


def _lowest(label: Indices, columns: Indices) -> Indices:
    """The lowest label that each row (R, k) touches; n where it touches nothing."""
    padded = np.append(label, len(label))
    return np.asarray(padded[columns].min(axis=1, initial=len(label)), dtype=np.int64)


def agree_in_parts(asked: Asked, equations: Assembled, units: Units, parts: tuple[Part, ...], start: Floats) -> Agreed:
    """The units that agree, part by part; noise that parts share is found first, then all parts are judged by it.

    Of that noise those parts tell whose rows are more than their unknowns.
    """
    found, judged = _each(asked, equations, units, parts, start)
    unknown = units.group != STATED
    if not unknown.any():
        return found
    common = np.ones(units.count)
    for group in np.unique(units.group[unknown]).tolist():
        mine = units.group == group
        telling = mine & judged & found.inliers
        common[mine] = float(np.median(found.variances[telling])) if telling.any() else 1.0
    factors = np.ones(equations.whole) if equations.factors is None else equations.factors.copy()
    ruled = units.of_row >= 0
    factors[ruled] *= np.sqrt(common[units.of_row[ruled]])
    again, _ = _each(replace(asked, stated=True), equations.with_factors(factors), units, parts, start)
    return replace(again, variances=again.variances * common, limits=again.limits * common)


def _each(
    asked: Asked, equations: Assembled, units: Units, parts: tuple[Part, ...], start: Floats
) -> tuple[Agreed, Mask]:
    """Consensus of one part after the other, and which units (U,) it judged.

    Parts that nothing contradicts agree: they are fitted as they are, for a loss would hold them where they start.
    """
    inliers, judged = np.ones(units.count, dtype=bool), np.zeros(units.count, dtype=bool)
    limits, variances = np.full(units.count, np.inf), np.ones(units.count)
    point, trials, ambiguous, cut_short = start, 0, False, False
    alone = replace(asked, settings=replace(asked.settings, forms=tuple))  # no closed form is probed for each of them
    for part in parts:
        mine = np.unique(units.of_row[part.rows])
        mine = mine[mine >= 0]
        if not len(mine):
            continue
        own = excerpt(equations, part.columns, np.unique(equations.units[part.rows]))
        if units.components[mine].sum() <= asked.left(own):
            plain = minimise(without_losses(own), point, asked.settings, asked.problem.span)
            point = plain.point if np.isfinite(plain.cost) else point
            continue
        found = agreed(alone, own, point[None], once=True)
        judged[mine] = True
        inliers[mine], limits[mine], variances[mine] = found.inliers, found.limits, found.variances
        point, trials = found.point, trials + found.trials
        ambiguous, cut_short = ambiguous or found.ambiguous, cut_short or found.cut_short
    together = Agreed(
        point=point,
        inliers=inliers,
        limits=limits,
        variances=variances,
        trials=trials,
        ambiguous=ambiguous,
        cut_short=cut_short,
    )
    return together, judged
