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
from mbm.estimation.consensus.truncated import Way, agree_by_truncation
from mbm.estimation.consensus.types import Agreed, Asked
from mbm.estimation.consensus.units import Units
from mbm.estimation.search.starting import blank_numbers
from mbm.estimation.settings import Settings
from mbm.estimation.starts.closed_forms.completion import completions
from mbm.estimation.starts.closed_forms.numerics.consistency import RIVALS
from mbm.estimation.starts.closed_forms.relative_poses import agreeing, measured_motions, relates
from mbm.estimation.starts.closed_forms.rows import ENOUGH
from mbm.estimation.starts.closed_forms.trees import behind_one_another, foremost_edges, ranks, related
from mbm.estimation.starts.closed_forms.types import Situation
from mbm.problem.naming import key_text
from mbm.problem.types import UnknownKind

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


def agree_foremost(asked: Asked, equations: Assembled, units: Units) -> list[Agreed]:
    """The units that agree by the best of the ways over foremost rows, if there is one."""
    trusted = trusted_units(equations, units)
    ways = foremost_ways(equations, units, trusted, asked.settings)
    return [agree_by_truncation(asked, equations, units, ways, trusted)] if ways else []


def foremost_ways(equations: Assembled, units: Units, trusted: Mask, settings: Settings) -> list[Way]:
    """From where closed forms of the foremost rows put all unknowns; none where they do not reach some.

    The second way goes over loops, too, that agree with one another, and not over steps that these contradict. What
    rules do not touch (priors) counts among these rows.
    """
    tree, early = _joining(equations, units, trusted)
    if not (trusted | tree).any():
        return []
    sought = blank_numbers(equations)[0]
    agree = _agreeing(Situation(layout=equations.layout, groups=equations.groups, numbers=sought, most=ENOUGH), units)
    foremost = trusted | tree | (early & agree if agree.any() else early)
    others = np.setdiff1d(np.unique(equations.every_unit), units.number)
    ways = []
    better = agree | foremost & ~(early & ~agree & ~trusted)
    for held in (foremost, better)[: 2 if bool((agree & ~foremost).any()) else 1]:
        part = excerpt(equations, equations.free, np.union1d(units.number[held], others))
        situation = Situation(layout=equations.layout, groups=part.groups, numbers=sought, most=ENOUGH)
        start = completions(situation, settings.closed_forms)[0].numbers
        if bool(np.isnan(start).any()):
            break
        ways.append(Way(start=start, origin=ORIGIN, held=held, whole=held is not foremost))
    return ways


def denied_step(equations: Assembled, units: Units, trusted: Mask, inliers: Mask) -> tuple[str, str, str, int] | None:
    """The first trusted step of a chain that loops deny: its family and ends, and how many that are no ``inliers`` do.

    These agree with one another, and with the rest of the chain.
    """
    if not trusted.any() or int((~inliers).sum()) < RIVALS:
        return None
    sought = blank_numbers(equations)[0]
    agree = _agreeing(Situation(layout=equations.layout, groups=equations.groups, numbers=sought, most=ENOUGH), units)
    left = int((agree & ~inliers).sum())
    if left < RIVALS:
        return None
    for entry in equations.layout.entries:
        edges = [_edges(group, entry) for group in equations.groups if relates(group, entry)]
        rank = ranks(entry) if edges else None
        if rank is None or entry.keys is None:
            continue
        first, second, unit = (np.concatenate(each) for each in zip(*edges, strict=True))
        early = behind_one_another(entry, first, second)
        step, unit = np.minimum(rank[first], rank[second])[early], unit[early]
        borne = np.isin(step, step[np.isin(unit, units.number[agree])])
        denied = step[~borne & np.isin(unit, units.number[trusted])]
        if len(denied):
            last, then = (key_text(entry.keys[end]) for end in np.argsort(rank)[denied.min() :][:2])
            return entry.unknown.name, last, then, left
    return None


def _agreeing(situation: Situation, units: Units) -> Mask:
    """Which units (U,) are chains of poses, or loops that agree with these and one another."""
    chosen = [np.empty(0, dtype=np.int64)]
    for entry in situation.layout.entries:
        edges = measured_motions(situation, entry) if entry.unknown.kind is UnknownKind.POSE else None
        agree = None if edges is None else agreeing(entry, edges)
        if edges is not None and agree is not None:
            chosen.append(np.concatenate([pairs.group.units[pairs.lines, 0] for pairs in edges.pairs])[agree])
    return _at(units, np.concatenate(chosen))


def _joining(equations: Assembled, units: Units, trusted: Mask) -> tuple[Mask, Mask]:
    """Which units (U,) join all poses of a family before others, and which else join neighbours, if none is trusted."""
    chosen, more = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)]
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
            more.append(unit[early])
    return _at(units, np.concatenate(chosen)), _at(units, np.concatenate(more))


def _edges(group: Group, entry: Entry) -> tuple[Indices, Indices, Indices]:
    """The members that each row of a group joins, and its unit."""
    first, second = related(group, entry)
    apart = first != second
    return first[apart], second[apart], group.units[apart, 0]
