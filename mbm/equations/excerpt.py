"""Some of the equations over some of the coordinates: the rows of some units alone, to be solved by themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.types import Floats, Indices


def excerpt(equations: Assembled, columns: Indices, units: Indices) -> Assembled:
    """The equations with the ``units`` (k,) alone, numbered as in `Assembled.units`, over the coordinates ``columns``.

    All groups stay, some of them without rows, so that kernels keep their numbers; residuals stand in the order of the
    units. Constraints are left out. Measured values that only other rows use are not corrected,
    and residuals are independent.
    """
    chosen = np.unique(units)
    groups, lines, kept, taken = [], [], [], []
    first = first_unit = 0
    for group in equations.groups:
        per_row = len(group.whiteners)
        inside = chosen[(chosen >= group.first_unit) & (chosen < group.first_unit + per_row * group.rows)]
        rows = np.unique((inside - group.first_unit) // per_row) if per_row else np.empty(0, dtype=np.int64)
        own = replace(with_rows(group, rows), first=first, first_unit=first_unit)
        kept.append(np.isin(group.units[rows], inside).ravel())
        lines.append((group.first + rows[:, None] * group.kernel.outputs + np.arange(group.kernel.outputs)).ravel())
        groups.append(own)
        taken.append(rows)
        first += own.count
        first_unit += own.rows * per_row
    wanted = np.concatenate(kept) if kept else np.empty(0, dtype=bool)
    factors: Floats | None = None if equations.factors is None else equations.factors[np.concatenate(lines)]
    found = replace(
        equations,
        groups=tuple(groups),
        constraints=(),
        equality=np.zeros(0, dtype=bool),
        factors=factors,
        rows=None,
        structure=None,
        implicit=None if equations.implicit is None else equations.implicit.some(tuple(groups), taken),
    ).freed(columns, equations.numbers)
    if wanted.all():
        return found
    picked = np.zeros(first_unit, dtype=bool)
    picked[found.every_unit[wanted]] = True
    return found.kept(picked)


def with_rows(group: Group, rows: Indices) -> Group:
    """The group with some of its rows."""
    return replace(
        group,
        evaluation=group.cache.evaluation(group.number, group.kernel, len(rows)),
        positions=None if group.positions is None else group.positions[rows],
        index=group.index[rows],
        columns=group.columns[rows],
        parameters=group.parameters[rows],
        whiteners=tuple(whitener.some(rows) for whitener in group.whiteners),
        sampled=tuple(each.some(rows) for each in group.sampled),
        trusted=None if group.trusted is None else group.trusted[rows],
    )
