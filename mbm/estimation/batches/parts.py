"""Many solves in parts that are bound together: those of one shape each, and where each of them starts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import EvaluationCache
from mbm.equations.layout import Layout, stated_start, stated_values, within_turns
from mbm.equations.layouts import limits, varies
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.sets import Sets
from mbm.estimation.batches.stack import Arranged, Stack, arranged, stack
from mbm.estimation.batches.types import Begun
from mbm.estimation.solve.estimate import assemble
from mbm.kernels.types import KernelSet
from mbm.problem.requests import Window
from mbm.problem.rows import decided, row_values
from mbm.problem.tables import Table
from mbm.problem.types import Problem, RowValues, Unknown, UnknownKind
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """Some solves, of the numbers ``which`` (K,), with their equations and starts ``points`` (K, N).

    ``first`` are the equations of one of them.
    """

    which: Indices
    sets: Sets
    bound: Stack
    points: Floats
    first: Assembled


def bound_parts(
    problem: Problem, kernels: KernelSet, sets: Sets, cache: EvaluationCache, starts: Begun, few: int
) -> tuple[list[Part], Indices]:
    """All solves by their shapes, and the numbers of those of which there are but a ``few``, or without good starts.

    Raises:
        MbmError: something that is stated is at fault in some solve.

    """
    whole = arranged(problem, sets)
    every = np.arange(sets.count)
    window = problem.request.window
    todo, left = [every], [every[:0]]
    if any(unknown.family is not None for unknown in problem.unknowns):
        solved = every if window is None or sets.used is None else np.flatnonzero(sets.used >= window.min_rows)
        own = whole if len(solved) == sets.count else arranged(problem, sets.some(solved))
        alike, odd = shapes(problem, own, len(solved))
        todo = _stretches([solved[part] for part in alike], solved, window)
        left = [np.setdiff1d(every, solved), solved[odd]]
    found = []
    while todo:
        which = todo.pop(0)
        if len(which) <= few:
            left.append(which)
            continue
        all_of_them = len(which) == sets.count
        some = sets if all_of_them else sets.some(which)
        tables = whole if all_of_them else arranged(problem, some)
        part = _part(problem, kernels, which, some, tables, cache, starts)
        if part is None:
            left.append(which)
        elif isinstance(part, Part):
            found.append(part)
        else:
            todo[:0] = _stretches([which[each] for each in part], which, window)
    return found, np.concatenate(left)


def _stretches(parts: list[Indices], solved: Indices, window: Window | None) -> list[Indices]:
    """The parts of the solves ``solved``; of windows, which begin where the ones before end, parts without gaps."""
    if window is None:
        return parts
    found = []
    for part in parts:
        gaps = np.flatnonzero(np.diff(np.searchsorted(solved, part)) > 1) + 1
        found += np.split(part, gaps)
    return sorted(found, key=lambda each: int(each[0]) if len(each) else 0)


def _part(
    problem: Problem,
    kernels: KernelSet,
    which: Indices,
    sets: Sets,
    tables: Arranged,
    cache: EvaluationCache,
    starts: Begun,
) -> Part | list[Indices] | None:
    """The solves of one shape; where they mention other members of undivided families, those that mention the same.

    None where rows of a solve share measured values with errors.
    """
    one = sets.selection(0).tables if tables.families else tables.tables
    bound = stack(problem, kernels, sets.count, tables, cache.layouts.of(problem, one, {}), cache)
    alike = by_use(bound)
    if len(alike) > 1:
        return alike
    if any(block.errors for block in problem.blocks):
        # Loaded by problems with such errors only, so that the others start at once.
        from mbm.estimation.batches.corrected import straightened

        corrected = straightened(problem, bound)
        if corrected is None:
            return None
        bound = corrected
    points = starting_points(problem, bound.equations.layout, sets, tables, cache, starts)
    number = int(np.argmax(bound.rows.sum(axis=0)))
    first, _ = assemble(problem, kernels, sets.selection(number).tables, {}, cache)
    return Part(which=which, sets=sets, bound=bound, points=points, first=first)


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
        own = unknown.family is not None and unknown.family.rows in tables.families
        values = stated_values(unknown)
        if own and values is not None and varies(values):
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


def shapes(problem: Problem, tables: Arranged, solves: int) -> tuple[list[Indices], Indices]:
    """The numbers (from 0, ascending) of solves whose layouts are alike but for names and starts, and of those apart.

    The latter have members whose start is none, of which the general path speaks.
    """
    sizes = [np.diff(each.first) for each in tables.families.values()]
    marks = np.column_stack([np.zeros(solves, dtype=np.int64), *sizes])
    good = np.ones(solves, dtype=bool)
    for unknown in problem.unknowns:
        if unknown.family is None or unknown.family.rows not in tables.families:
            continue
        owner = tables.owners[unknown.family.rows]
        for option in _limits(unknown):
            cells = [cell.tobytes() for cell in option_cells(option, tables, fixed=option is unknown.fixed)]
            marks = np.column_stack([marks, _together(cells, owner, solves)])
        stated = stated_values(unknown)
        if stated is not None and varies(stated):
            values, known = stated_start(unknown, stated, tables.tables)
            wrong = np.isnan(values) & known
            if unknown.kind is UnknownKind.POSITIVE:
                wrong |= (values <= 0) & known
            good[owner[wrong.any(axis=1)]] = False
    return [part[good[part]] for part in _alike(marks)], np.flatnonzero(~good)


def by_use(bound: Stack) -> list[Indices]:
    """The numbers (from 0, ascending) of solves in which the same members are mentioned."""
    used = mentioned(bound)
    return _alike(used) if used.shape[1] else [np.arange(bound.solves)]


def mentioned(bound: Stack) -> Mask:
    """Which coordinates of families (T, k) some equation of each solve depends on."""
    layout = bound.equations.layout
    family = np.zeros(len(layout.number), dtype=bool)
    for entry in layout.entries:
        family[entry.coordinates] = entry.keys is not None
    used = np.zeros((bound.solves, len(family)), dtype=bool)
    if not family.any():
        return used[:, :0]
    for number, group in enumerate((*bound.equations.groups, *bound.equations.constraints)):
        solve, lines = bound.lines(number, range(bound.solves))
        for tangent in np.unique(group.kernel.jacobian_columns).tolist():
            used[solve, group.columns[lines, tangent]] = True
    return used[:, family]


def option_cells(option: RowValues, tables: Arranged, *, fixed: bool) -> np.ndarray:
    """The numbers (rows, components) of an option, row by row, of all solves."""
    return np.ascontiguousarray(decided(option, tables.tables) if fixed else row_values(option, tables.tables))


def _limits(unknown: Unknown) -> Iterator[RowValues]:
    """The options that solves which are made together have in common, where they may vary."""
    return filter(varies, limits(unknown))


def _together(cells: list[bytes], owner: Indices, solves: int) -> Indices:
    """One number for each solve (T,), equal where all its rows' cells are."""
    lines: list[list[bytes]] = [[] for _ in range(solves)]
    for cell, solve in zip(cells, owner.tolist(), strict=True):
        lines[solve].append(cell)
    known: dict[bytes, int] = {}
    return np.array([known.setdefault(b"".join(line), len(known)) for line in lines], dtype=np.int64)


def _alike(marks: np.ndarray) -> list[Indices]:
    """The lines of a table that are the same, in the order in which they first occur."""
    _, first, which = np.unique(marks, axis=0, return_index=True, return_inverse=True)
    parts = np.split(np.argsort(which.ravel(), kind="stable"), np.cumsum(np.bincount(which.ravel()))[:-1])
    return [parts[place] for place in np.argsort(first).tolist()]
