"""States of all steps from those of the first: carried on by the transitions, without their noise or with some."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.layout import Entry, Layout, places_in
from mbm.equations.manifolds import Curved, moved
from mbm.equations.types import Floats, Indices
from mbm.kernels.types import KernelSet
from mbm.problem.rows import rows_of
from mbm.problem.sequence.types import Sequence
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.symbolic.types import Purpose

NEWTON_STEPS = 10
"""Newton steps to the value at the next step at most: one where the transition is affine in it."""

NO_FURTHER = 1e-9
"""Length of a step, beside that of the numbers, from which on it is not worth another."""


@np.errstate(all="ignore")  # what is no value ends the walk
def carried_starts(
    problem: Problem,
    kernels: KernelSet,
    tables: Mapping[str, Table],
    starts: Mapping[str, Floats],
    cache: EvaluationCache,
) -> dict[str, Floats]:
    """The numbers (members · size) of each state that changes: at the first step ``starts``, else ``:init``.

    From the step on at which a transition has no value, or does not determine the next one, they are ``:init``. States
    with ``starts`` are left out.
    """
    found = cache.layouts.of(problem, tables, starts)
    changing = [entry for entry in found.entries if entry.unknown.is_state and entry.steps is None]
    if all(e.unknown.name in starts for e in changing):
        return {}
    if any(found.guessed[e.offset : e.offset + e.unknown.size].any() for e in changing):
        return {}  # better starts are looked for than the middle of a range
    binder = Binder(problem=problem, layout=found, tables=tables, cache=cache)
    point, _ = carried(binder, kernels, found.start, nothing)
    return {e.unknown.name: point[e.range] for e in changing if e.unknown.name not in starts}


def carried(
    binder: Binder, kernels: KernelSet, start: Floats, left: Callable[[Group], Floats]
) -> tuple[Floats, int | None]:
    """The point (N,) with the states of all steps, and the first step (from 0) that could not be reached (None: all).

    ``start`` (N,) has those of the first step and all constants; ``left`` gives what the equations of transitions
    (rows, outputs) are to leave: zeros, or draws from their noise.
    """
    walk = walk_of(binder, kernels, left)
    if walk is None:
        return start, None
    point = start.copy()
    for step in range(1, walk.count):
        if not walk.next(point, step):
            return point, step
    return point, None


def walk_of(binder: Binder, kernels: KernelSet, left: Callable[[Group], Floats]) -> Walk | None:
    """What carries states on; None where none changes. ``left`` is that of `carried`."""
    problem, layout = binder.problem, binder.layout
    entries = [entry for entry in layout.entries if entry.unknown.is_state and entry.steps is None]
    if problem.sequence is None or not entries:
        return None
    groups = _groups(problem, problem.sequence, kernels, binder)
    return Walk(layout, entries, [(group, left(group)) for group in groups])


def nothing(group: Group) -> Floats:
    """What is left by transitions without noise (rows, outputs)."""
    return np.zeros((group.rows, group.kernel.outputs))


def _groups(problem: Problem, sequence: Sequence, kernels: KernelSet, binder: Binder) -> list[Group]:
    """The equations of all transitions, bound to their rows."""
    names = {name for t in sequence.transitions for name in (t.block, t.exact) if name is not None}
    table = binder.tables[sequence.reached]
    found = []
    for number, kernel in enumerate(kernels.kernels):
        if kernel.purpose is Purpose.EQUATION and problem.blocks[kernel.owner].name in names:
            rows = rows_of(problem.blocks[kernel.owner].cases[kernel.case].static, table)
            found.append(binder.bind(number, kernel, table, rows))
    return [group for group in found if group.rows]


class Walk:
    """From step to step, ``count`` of them: which rows reach each, and where its numbers and coordinates stand."""

    def __init__(self, layout: Layout, entries: list[Entry], groups: list[tuple[Group, Floats]]) -> None:
        """``groups`` with what their rows are to leave (rows, outputs)."""
        self._layout = layout
        self._entries = entries
        self.count = entries[0].members
        self._rows: list[list[tuple[Group, int, Floats]]] = [[] for _ in range(self.count - 1)]
        for group, left in groups:
            for row, position in enumerate(np.asarray(group.positions).tolist()):
                self._rows[position].append((group, row, left[row]))
        self._change = np.zeros(len(layout.number))
        self._pieces: list[tuple[Curved, Indices]] = []
        for curved in layout.curved:
            self._pieces.append((curved, places_in(curved.coordinates[:, 0], len(layout.number))))

    def next(self, point: Floats, step: int) -> bool:
        """Let a point (N,) have the values at a step (from 1) that follow from those at the step before, if any do.

        In place: what a step takes does not grow with the number of steps.
        """
        numbers = self._numbers(step)
        before = point[numbers]
        if self._reached(point, step):
            return True
        point[numbers] = before
        return False

    def _reached(self, point: Floats, step: int) -> bool:
        for entry in self._entries:
            here = entry.offset + step * entry.unknown.size
            point[here : here + entry.unknown.size] = point[here - entry.unknown.size : here]
        coordinates = np.concatenate([e.first + step * e.unknown.freedom + _range(e) for e in self._entries])
        for _ in range(NEWTON_STEPS):
            residuals, slopes = self._linearised(point, step, coordinates)
            if slopes.shape[0] != slopes.shape[1] or not np.isfinite(slopes).all() or not np.isfinite(residuals).all():
                return False
            try:
                change: Floats = np.asarray(np.linalg.solve(slopes, -residuals), dtype=np.float64)
            except np.linalg.LinAlgError:
                return False
            self._move(point, coordinates, change)
            if np.linalg.norm(change) <= NO_FURTHER * (1.0 + np.linalg.norm(point[self._numbers(step)])):
                break
        self._keep_inside(point, coordinates)
        return True

    def _move(self, point: Floats, coordinates: Indices, change: Floats) -> None:
        """As `Layout.retract` of some coordinates alone, in place."""
        places = self._layout.number[coordinates]
        point[places[places >= 0]] += change[places >= 0]
        self._change[coordinates] = change
        for curved, piece in self._pieces:
            which = piece[coordinates]
            which = which[which >= 0]
            own = curved.numbers[which]
            point[own] = moved(curved.piece, point[own], self._change[curved.coordinates[which]])

    def _linearised(self, point: Floats, step: int, coordinates: Indices) -> tuple[Floats, Floats]:
        """What the transitions to a step leave too much (m,), and its derivative by the coordinates there (m, n)."""
        residuals, slopes = [], []
        for group, row, left in self._rows[step - 1]:
            kernel = group.kernel
            stream = group.cache.stream(group.number, kernel)
            values, nonzeros = stream.values_and_jacobian(group.inputs_at(point[None], slice(row, row + 1)))
            dense = np.zeros((kernel.outputs, len(coordinates)))
            places = np.searchsorted(coordinates, group.columns[row])
            known = places < len(coordinates)
            known[known] = coordinates[places[known]] == group.columns[row][known]
            for output, column, slope in zip(kernel.jacobian_rows, kernel.jacobian_columns, nonzeros[0], strict=True):
                if known[column]:
                    dense[output, places[column]] += slope
            residuals.append(values[0] - left)
            slopes.append(dense)
        if not residuals:
            return np.empty(0), np.empty((0, len(coordinates)))
        return np.concatenate(residuals), np.vstack(slopes)

    def _numbers(self, step: int) -> Indices:
        sizes = [(e.offset + step * e.unknown.size, e.unknown.size) for e in self._entries]
        return np.concatenate([np.arange(first, first + size) for first, size in sizes])

    def _keep_inside(self, point: Floats, coordinates: Indices) -> None:
        """Keep a point within the bounds of the coordinates at hand, in place."""
        layout = self._layout
        plain = coordinates[layout.number[coordinates] >= 0]
        numbers = layout.number[plain]
        point[numbers] = np.clip(point[numbers], layout.lower[plain], layout.upper[plain])


def _range(entry: Entry) -> Indices:
    return np.arange(entry.unknown.freedom)
