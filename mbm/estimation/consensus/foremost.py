"""Rows that come first: those that are trusted, and what else joins the members of families of poses.

No start goes over rows that may be rejected while trusted ones connect all unknowns; where none is trusted, rows that
join neighbours of an ordered key come before all others, as odometry does before loop closures.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.excerpt import excerpt
from mbm.equations.layout import Entry
from mbm.equations.types import Indices, Mask
from mbm.estimation.consensus.truncated import Way
from mbm.estimation.consensus.units import Units
from mbm.estimation.search.starting import blank_numbers
from mbm.estimation.settings import Settings
from mbm.estimation.starts.closed_forms.completion import completions
from mbm.estimation.starts.closed_forms.relative_poses import related, relates
from mbm.estimation.starts.closed_forms.rows import ENOUGH
from mbm.estimation.starts.closed_forms.trees import behind_one_another, foremost_edges
from mbm.estimation.starts.closed_forms.types import Situation

ORIGIN = "the foremost rows"

TRUSTED, EARLY, OTHERS = 0.0, 1.0, 2.0
"""In which order rows join members."""


def trusted_units(equations: Assembled, units: Units) -> Mask:
    """Which units (U,) no rule may reject."""
    return _at(units, np.concatenate([np.empty(0, dtype=np.int64), *map(_trusted_of, equations.groups)]))


def _trusted_of(group: Group) -> Indices:
    if group.trusted is None or not group.whiteners:
        return np.empty(0, dtype=np.int64)
    return np.unique(group.units[group.trusted])


def _at(units: Units, numbers: Indices) -> Mask:
    return np.asarray(np.isin(units.number, numbers))


def foremost_way(equations: Assembled, units: Units, trusted: Mask, settings: Settings) -> Way | None:
    """From where closed forms of the foremost rows put all unknowns; None where they do not reach some.

    What rules do not touch (priors) counts among these rows.
    """
    foremost = trusted | _joining(equations, units, trusted)
    if not foremost.any():
        return None
    others = np.setdiff1d(np.unique(equations.every_unit), units.number)
    part = excerpt(equations, equations.free, np.union1d(units.number[foremost], others))
    sought = blank_numbers(equations)[0]
    situation = Situation(layout=equations.layout, groups=part.groups, numbers=sought, most=ENOUGH)
    found = completions(situation, settings.closed_forms)[0].numbers
    return None if bool(np.isnan(found).any()) else Way(start=found, origin=ORIGIN, held=foremost)


def _joining(equations: Assembled, units: Units, trusted: Mask) -> Mask:
    """Which units (U,) join members of families of poses before all others."""
    chosen = [np.empty(0, dtype=np.int64)]
    for entry in equations.layout.entries:
        edges = [_edges(group, entry) for group in equations.groups if relates(group, entry)]
        if not edges:
            continue
        first, second, unit = (np.concatenate(each) for each in zip(*edges, strict=True))
        early = behind_one_another(entry, first, second)
        later = np.where(early, EARLY, OTHERS)
        if trusted.any():
            later = np.where(np.isin(unit, units.number[trusted]), TRUSTED, later)
        tree = foremost_edges(entry.members, first, second, later)
        chosen.append(unit[tree])
        if not trusted.any():
            chosen.append(unit[early])
    return _at(units, np.concatenate(chosen))


def _edges(group: Group, entry: Entry) -> tuple[Indices, Indices, Indices]:
    """The members that each row of a group joins, and its unit."""
    first, second = related(group, entry)
    apart = first != second
    return first[apart], second[apart], group.units[apart, 0]
