"""Where each of many solves starts, as `layout` has it for one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.equations.binding import EvaluationCache
from mbm.equations.layout import Layout, stated_start, stated_values, within_turns
from mbm.equations.layouts import columns_of
from mbm.equations.types import Floats
from mbm.estimation.batches.arranged import Arranged
from mbm.estimation.batches.sets import Sets
from mbm.estimation.batches.types import Begun
from mbm.problem.tables import Table
from mbm.problem.types import Problem


def starting_points(
    problem: Problem, layout: Layout, sets: Sets, tables: Arranged, cache: EvaluationCache, starts: Begun
) -> Floats:
    """The point (T, N) where each solve starts; NaN where a number has none.

    ``layout`` is that of any of the solves, which are alike but for the starts of members that the problem states;
    ``starts`` override these.

    Raises:
        MbmError: a start of the wrong shape, or that is none.

    """
    if not tables.families:
        return _of_one_layout(problem, sets, tables.tables, cache, starts)
    if callable(starts) or starts:
        found = []
        for number, cells in enumerate(sets.keys):
            given = starts(dict(zip(sets.names, cells, strict=True))) if callable(starts) else starts
            found.append(cache.layouts.of(problem, sets.selection(number).tables, given).start)
        return np.stack(found)
    points = np.tile(layout.start, (sets.count, 1))
    for entry in layout.entries:
        unknown = entry.unknown
        varies = unknown.family is not None and unknown.family.rows in tables.families
        values = stated_values(unknown)
        if varies and values is not None and columns_of(values):
            numbers, known = stated_start(unknown, values, tables.tables)
            points[:, entry.range] = np.where(known, numbers, np.nan).reshape(sets.count, entry.count)
    return within_turns(points, layout.number, layout.angle, layout.lower, layout.upper)


def _of_one_layout(
    problem: Problem, sets: Sets, tables: Mapping[str, Table], cache: EvaluationCache, starts: Begun
) -> Floats:
    """The points where members are the same in all solves."""
    if not callable(starts):
        return np.tile(cache.layouts.of(problem, tables, starts).start, (sets.count, 1))
    found: list[Floats] = []
    last: Mapping[str, Floats] | None = None
    for cells in sets.keys:
        given = starts(dict(zip(sets.names, cells, strict=True)))
        # most often all solves are given the same
        found.append(found[-1] if given is last else cache.layouts.of(problem, tables, given).start)
        last = given
    return np.stack(found)
