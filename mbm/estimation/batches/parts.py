"""Many solves in parts that are bound together: those of one shape each."""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import EvaluationCache
from mbm.equations.types import Floats, Indices
from mbm.estimation.batches.arranged import Arranged, arranged
from mbm.estimation.batches.sets import Sets
from mbm.estimation.batches.shapes import by_use, shapes
from mbm.estimation.batches.stack import Stack, stack
from mbm.estimation.batches.starts import starting_points
from mbm.estimation.batches.types import Begun
from mbm.estimation.solve.estimate import assemble
from mbm.kernels.types import KernelSet
from mbm.problem.requests import Window
from mbm.problem.types import Problem
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
