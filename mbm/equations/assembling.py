"""Tables and kernels → the equations of one data set; what they share with the last ones is not made again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.assembly import DENSE, Assembled
from mbm.equations.binder import Binder
from mbm.equations.binding import Group, mentioned
from mbm.equations.layout import Layout, free_positions
from mbm.equations.types import Mask
from mbm.kernels.types import KernelSet
from mbm.problem.kinds import Relation
from mbm.problem.rows import refuse_empty
from mbm.problem.types import Problem
from mbm.values import dataclass, replace

if TYPE_CHECKING:
    from mbm.equations.corrections.elimination import Elimination
    from mbm.equations.structure import Structure
    from mbm.problem.tables import Table


@dataclass(frozen=True, slots=True, eq=False)
class Last:
    """The equations that were made last, and the tables that they are of."""

    tables: Mapping[str, Table]
    equations: Assembled


def blank(binder: Binder, kernels: KernelSet, *, corrected: bool = True) -> Assembled:
    """The equations of one data set; coordinates without a start have NaN in ``numbers``.

    ``corrected``: measured values with errors are, else they are taken as exact.

    Raises:
        MbmError: weights that are none, keys that are no members, an aggregate in a constraint over no rows.

    """
    last = binder.cache.last if isinstance(binder.cache.last, Last) else None
    if last is not None and last.tables is binder.tables and last.equations.layout is binder.layout:
        return last.equations
    found = _assembled(binder, kernels, None if last is None else last.equations, corrected=corrected)
    if all(group.kernel.corrections is None for group in found.groups):  # eliminations remember what they found
        binder.cache.last = Last(binder.tables, found)
    return found


def _assembled(binder: Binder, kernels: KernelSet, last: Assembled | None, *, corrected: bool) -> Assembled:
    """The equations anew; what they have in common with the ``last`` ones is taken from these."""
    refuse_empty(binder.problem.written_out, binder.tables)
    groups, constraints = binder.equations(kernels), binder.constraints(kernels)
    places = binder.layout
    if last is not None and _alike(last, places, groups, constraints):
        equality = equality_mask(binder.problem, constraints)
        structure = _structure(binder, groups)
        return replace(last, groups=groups, constraints=constraints, equality=equality, structure=structure)
    used = mentioned((*groups, *constraints), len(places.number))
    free = free_positions(places, used)
    found = Assembled(
        layout=places,
        groups=groups,
        constraints=constraints,
        equality=equality_mask(binder.problem, constraints),
        numbers=places.start,
        used=used,
        free=free,
        implicit=_eliminated(binder, groups) if corrected else None,
        structure=_structure(binder, groups),
    )
    return found.freed(free, places.start)


def _alike(last: Assembled, places: Layout, groups: tuple[Group, ...], constraints: tuple[Group, ...]) -> bool:
    """Whether the equations estimate the same coordinates as the ``last`` ones, and depend on them in the same places.

    They do where the rows of each kernel take the same numbers, however many they are: if there are any.
    """
    now, before = (*groups, *constraints), (*last.groups, *last.constraints)
    return (
        last.layout is places
        and len(last._scatters) == len(groups)
        and sum(group.count for group in groups) * last.dimension <= DENSE
        and [(g.number, g.rows > 0) for g in now] == [(g.number, g.rows > 0) for g in before]
        and all(all(g.shared) and all(g.shared_columns) and not g.sampled for g in now)
        and all(g.kernel.corrections is None for g in groups)
    )


def _eliminated(binder: Binder, groups: tuple[Group, ...]) -> Elimination | None:
    """The elimination of corrections, where a group has some."""
    if all(group.kernel.corrections is None for group in groups):
        return None
    # Loaded by the problems that need it only, so that the others start at once.
    from mbm.equations.corrections.elimination import elimination

    return elimination(binder.problem, binder.tables, groups, binder.cache)


def _structure(binder: Binder, groups: tuple[Group, ...]) -> Structure | None:
    """What residuals share, where a clause says that they do."""
    if not any(block.structure.joins for block in binder.problem.blocks):
        return None
    # Loaded by the problems that need it only, so that the others start at once.
    from mbm.equations.structuring import structure_of

    return structure_of(binder.problem, binder.tables, groups)


def equality_mask(problem: Problem, constraints: tuple[Group, ...]) -> Mask:
    """Which constraint values (k,) are to be zero; the others are not to be above zero."""
    parts = []
    for group in constraints:
        case = problem.blocks[group.kernel.owner].cases[group.kernel.case]
        row = [e.relation is Relation.ZERO for e in case.equations for _ in e.components]
        parts.append(np.tile(np.asarray(row, dtype=bool), group.rows))
    return np.concatenate(parts) if parts else np.zeros(0, dtype=bool)
