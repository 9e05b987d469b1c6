"""A tree of poses that nothing ties to the world → where in the world it lies, by what else was measured from it.

Odometry places a whole drive but for one motion, and ranges to known stations, fixes or bearings tell that motion.
Given it, unknowns that enter linearly (the scale and offset of a radio) are solved for. There may be several: a nearly
straight drive past stations that stand nearly in a line has a mirror image on their other side. So what a start has led
to is laid elsewhere, too: which of the places is right, only a solve from each can tell.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.affine_part import affine_coordinates
from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.excerpt import excerpt
from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices
from mbm.estimation.search.laying import Tree
from mbm.estimation.settings import Settings
from mbm.estimation.starts.closed_forms.completion import completions
from mbm.estimation.starts.closed_forms.relative_poses import RELATIVE_POSES, relates
from mbm.estimation.starts.closed_forms.situation import Situation
from mbm.problem.types import UnknownKind

ENOUGH_UNITS = 600
"""Equations in rows that the motion is judged by."""

MOST_OTHERS = 100
"""Coordinates beside the poses that are solved for with each motion."""

LEAST_FELT = 3
"""Poses that more than one motion may suit: two are brought where they should be in one way."""

ORIGIN = "aligned"


def aligned(equations: Assembled, numbers: Floats, settings: Settings) -> tuple[tuple[Floats, str], ...]:
    """All numbers (N,), from those that are known (NaN: open), and how, in words; none where there is nothing to align.

    There is where the motions between all members of one family of poses are measured, none of which is known, other
    equations speak of them, and what else is open enters these linearly. The first fits best.
    """
    entry = _loose_family(equations, numbers)
    if entry is None:
        return ()
    apart = [group for group in equations.groups if group.rows and not relates(group, entry)]
    others = [group for group in apart if any(slot.unknown == entry.unknown.name for slot in group.kernel.variables)]
    graph = tuple(group for group in equations.groups if group.rows and relates(group, entry))
    if not others or not graph:
        return ()
    situation = Situation(layout=equations.layout, groups=graph, numbers=numbers)
    found = completions(situation, (RELATIVE_POSES,))[0]
    if bool(np.isnan(found.numbers[entry.range]).any()):
        return ()
    missing = replace(equations.layout, start=found.numbers).missing()
    part = excerpt(equations, np.flatnonzero(missing), _some_units(apart, settings.seed))
    linear = affine_coordinates(part, missing)
    if not bool((linear == missing).all()):
        return ()
    origin_of = "; ".join((*found.used, ORIGIN))
    return tuple((each, origin_of) for each in Tree(part, entry, found.numbers, linear).laid(settings))


def laid_elsewhere(equations: Assembled, point: Floats, settings: Settings) -> tuple[Floats, ...]:
    """All numbers (N,) with the family of poses moved as one to where it fits nearly as well as at a point (N,).

    None where no motions between members are measured, fewer than three of them are felt by other equations, or more
    than `MOST_OTHERS` coordinates stand in these beside them: they are solved for with each motion that is tried.
    """
    families = [
        e
        for e in equations.layout.entries
        if e.unknown.kind is UnknownKind.POSE and e.members >= LEAST_FELT and not e.steps
    ]
    entry = max(families, key=lambda e: e.members, default=None)
    if entry is None:
        return ()
    graph = [group for group in equations.groups if group.rows and relates(group, entry)]
    apart = [group for group in equations.groups if group.rows and not relates(group, entry)]
    own, of_others = (np.zeros(len(equations.layout.number), dtype=bool) for _ in range(2))
    own[entry.coordinates] = True
    beside = [group for group in apart if own[group.columns].any()]
    if not graph or not beside:
        return ()
    of_others[np.concatenate([np.unique(group.columns) for group in beside])] = True
    of_others[np.concatenate([np.unique(group.columns) for group in graph])] = False
    of_others[entry.coordinates] = False
    of_others &= np.isin(np.arange(len(of_others)), equations.free)
    if of_others.sum() > MOST_OTHERS:
        return ()
    apart = [group for group in apart if (own | of_others)[group.columns].any()]
    part = excerpt(equations, np.flatnonzero(of_others), _some_units(apart, settings.seed))
    tree = Tree(part, entry, point, affine_coordinates(part, of_others))
    return tree.elsewhere(settings) if tree.felt >= LEAST_FELT else ()


def _loose_family(equations: Assembled, numbers: Floats) -> Entry | None:
    """The one family of poses of which nothing is known."""
    loose = [
        entry
        for entry in equations.layout.entries
        if entry.unknown.kind is UnknownKind.POSE and entry.members > 1 and bool(np.isnan(numbers[entry.range]).all())
    ]
    return loose[0] if len(loose) == 1 else None


def _some_units(groups: list[Group], seed: int) -> Indices:
    """Units of the groups, at most so many of each, drawn at random."""
    generator = np.random.default_rng(seed)
    found = []
    for group in groups:
        units = np.unique(group.units)
        found.append(units if len(units) <= ENOUGH_UNITS else generator.choice(units, ENOUGH_UNITS, replace=False))
    return np.sort(np.concatenate(found))
