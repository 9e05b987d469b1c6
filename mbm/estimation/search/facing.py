"""Whether a minimum sees behind its cameras what another one sees before them: no observation can be meant so."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.at_rows import pinholes, rows_at
from mbm.equations.types import Floats, Mask, Minimum
from mbm.estimation.search.basins import equal_costs
from mbm.estimation.search.search import Alternative, Found, other_minimum
from mbm.problem.tables import Table
from mbm.problem.types import Problem


def facing(
    problem: Problem, tables: Mapping[str, Table], equations: Assembled, minimum: Minimum, others: Iterable[Alternative]
) -> tuple[Alternative, ...]:
    """The ``others`` that see no rows behind a camera but those that are behind it at the ``minimum``, too.

    Of a plane in front of a camera its mirror image behind the camera has the same image.
    """
    every = tuple(others)
    if not every:
        return ()
    own = _behind(problem, tables, equations, minimum.point)
    return tuple(each for each in every if not (_behind(problem, tables, equations, each.minimum.point) & ~own).any())


def before_cameras(problem: Problem, tables: Mapping[str, Table], equations: Assembled, found: Found) -> Found:
    """``found`` with that one of its equally low minima as the answer which sees the fewest rows behind a camera."""
    own = found.minimum
    alike = [each for each in found.alternatives if equal_costs(each.minimum.cost, own.cost)]
    if not alike or not any(map(pinholes, equations.groups)):
        return found
    behind = [int(_behind(problem, tables, equations, each.point).sum()) for each in (own, *(a.minimum for a in alike))]
    best = int(np.argmin(behind))
    if not best:
        return found
    answer, former = alike[best - 1], other_minimum(equations, own, 1)
    rest = tuple(former if each is answer else each for each in found.alternatives)
    return replace(found, minimum=answer.minimum, alternatives=tuple(sorted(rest, key=lambda a: a.minimum.cost)))


@np.errstate(all="ignore")
def _behind(problem: Problem, tables: Mapping[str, Table], equations: Assembled, numbers: Floats) -> Mask:
    """Which rows of all groups, one group after another, see a point behind a camera; False where nothing tells."""
    found = []
    for group in equations.groups:
        rows = rows_at(problem, group, equations.layout, tables, numbers)
        behind = rows.behind()
        found.append(np.zeros(group.rows, dtype=bool) if behind is None else behind)
    return np.concatenate(found) if found else np.zeros(0, dtype=bool)
