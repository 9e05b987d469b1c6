"""The equations of all solves, bound at once: rows stand solve by solve, and each solve knows where its own begin."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from mbm.kernels.types import KernelSet
from mbm.problem.rows import Positions
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.solution.assembly import Assembled, blank
from mbm.solution.binding import Binder, EvaluationCache, Group
from mbm.solution.layout import Layout
from mbm.solution.many.types import Kept
from mbm.solution.selection import Divided, Part
from mbm.solution.types import Floats, Indices, Mask
from mbm.solution.whitening import Whitener
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.solution.robust.losses.function import LossFunction


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stack:
    """The equations of T solves.

    ``equations`` hold the rows of all of them; ``first`` and ``rows`` (groups, T) say where the rows of each solve
    begin in a group, and how many there are. A group without a table has one row, which all solves share.
    ``derived`` are the groups of the derived quantities. ``tables`` have their rows solve by solve.
    """

    equations: Assembled
    first: Indices
    rows: Indices
    derived: tuple[tuple[Group, ...], ...]
    tables: Mapping[str, Table]

    @property
    def solves(self) -> int:
        """T."""
        return int(self.rows.shape[1])

    def used(self, blocks: int) -> Indices:
        """Rows in use of each solve and block (T, blocks)."""
        found = np.zeros((self.solves, blocks), dtype=np.int64)
        for group, rows in zip(self.equations.groups, self.rows, strict=True):
            found[:, group.kernel.owner] += rows
        return found

    @property
    def residuals(self) -> Indices:
        """Scalar residuals of each solve (T,)."""
        outputs = np.array([group.kernel.outputs for group in self.equations.groups], dtype=np.int64)
        return np.asarray(outputs @ self.rows)


def stack(
    problem: Problem,
    kernels: KernelSet,
    tables: Mapping[str, Table],
    divided: Divided,
    layout: Layout,
    cache: EvaluationCache,
) -> Stack:
    """The equations of all solves, with one layout for all.

    Raises:
        MbmError: weights that are none, in some row.

    """
    sorted_tables = dict(tables)
    ends: dict[str, Indices] = {}
    for name, part in divided.parts.items():
        order, ends[name] = _by_solve(part)
        in_place = len(order) == len(tables[name]) and bool((order == np.arange(len(order))).all())
        sorted_tables[name] = tables[name] if in_place else tables[name].take(order)
    binder = Binder(problem=problem, layout=layout, tables=sorted_tables, cache=cache)
    equations = blank(binder, kernels)
    solves = len(divided.combinations)
    first = np.zeros((len(equations.groups), solves), dtype=np.int64)
    rows = np.ones((len(equations.groups), solves), dtype=np.int64)
    for number, group in enumerate(equations.groups):
        table = problem.blocks[group.kernel.owner].table
        if table is not None and group.positions is not None:
            places = np.searchsorted(group.positions, ends[table])
            first[number], rows[number] = places[:-1], np.diff(places)
    derived = tuple(binder.derived(kernels, owner) for owner in range(len(problem.derived)))
    for group in (*equations.groups, *chain.from_iterable(derived)):
        cache.stream(group.number, group.kernel)  # made here, so that threads find it there
    return Stack(equations=equations, first=first, rows=rows, derived=derived, tables=sorted_tables)


def _by_solve(part: Part) -> tuple[Positions, Indices]:
    """The positions of the rows, solve by solve, and where those of each end: T + 1 numbers from 0."""
    groups, wanted = part.groups, part.group
    sizes = part.sizes
    ends = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(sizes)])
    if np.array_equal(wanted, np.arange(len(groups.cells))):
        return groups.order, ends
    starts = np.repeat(groups.first[wanted] - ends[:-1], sizes)
    return groups.order[np.arange(ends[-1]) + starts], ends


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Lines:
    """The rows of one group that K solves have.

    ``counts`` (K,) of each solve, ``solve`` (R,) of each row, ``slots`` (R, outputs) among the residuals of its solve,
    of which ``kept`` (R, outputs) count, ``whiteners`` and ``inputs`` of these rows: what is data in them stays, the
    numbers of the unknowns are put there.
    """

    group: Group
    counts: Indices
    solve: Indices
    slots: Indices
    kept: Mask
    whiteners: tuple[Whitener, ...]
    inputs: Floats


class Portion:
    """The equations of some consecutive solves, at one point for each: arrays (K, …) over the solves.

    ``most`` m is the largest number of residuals of a solve; what a solve has less is 0.
    """

    def __init__(self, stack: Stack, which: range, kept: Kept | None = None) -> None:
        self.count = len(which)
        self.most = int(stack.residuals[which.start : which.stop].max(initial=0))
        self.equations = stack.equations
        self._columns = _columns(stack.equations)
        self._lines = []
        taken = np.zeros(self.count, dtype=np.int64)
        for number, group in enumerate(stack.equations.groups):
            first = stack.first[number, which.start : which.stop]
            rows = stack.rows[number, which.start : which.stop]
            self._lines.append(_lines(group, first, rows, taken, None if kept is None else kept.outputs))
            taken += rows * group.kernel.outputs

    def block_slots(self, owner: int) -> tuple[Indices, Indices]:
        """Solve (P,) and place (P,) of the residuals of a block that count."""
        mine = [each for each in self._lines if each.group.kernel.owner == owner]
        solves = [np.repeat(each.solve, each.slots.shape[1])[each.kept.ravel()] for each in mine]
        slots = [each.slots[each.kept] for each in mine]
        none = np.zeros(0, dtype=np.int64)
        return np.concatenate([none, *solves]), np.concatenate([none, *slots])

    @property
    def rows(self) -> int:
        """Rows of all groups together."""
        return sum(len(each.solve) for each in self._lines)

    def losses(self) -> Iterator[tuple[LossFunction, Indices, Indices]]:
        """Each loss, with the solves (U,) of its units and the places (U, k) of their residuals."""
        for each in self._lines:
            for whitener, loss in zip(each.whiteners, each.group.losses, strict=False):
                yield loss, each.solve, each.slots[:, whitener.first : whitener.last]

    def residuals(self, points: Floats) -> Floats:
        """Whitened residuals (K, m) at points (K, N), without losses."""
        result = np.zeros((self.count, self.most))
        for each in self._lines:
            values = each.group.cache.stream(each.group.number, each.group.kernel).values(_inputs(each, points))
            result[each.solve[:, None], each.slots] = _whitened(each, values)
        return result

    def linearised(self, points: Floats) -> tuple[Floats, Floats]:
        """Whitened residuals (K, m), and their derivatives by a step (K, m, n), without losses."""
        width = self.equations.dimension
        result, slopes = np.zeros((self.count, self.most)), np.zeros((self.count, self.most, width))
        for each in self._lines:
            group = each.group
            found = group.cache.stream(group.number, group.kernel)
            values, nonzeros = found.values_and_jacobian(_inputs(each, points))
            dense = np.zeros((len(values), group.kernel.outputs, width))
            group.scatter(self._columns).add(nonzeros, dense)
            for whitener in each.whiteners:
                part = dense[:, whitener.first : whitener.last]
                weights = whitener.weights
                if weights.ndim == 2:
                    part *= weights[:, :, None]
                else:
                    part[...] = np.einsum("rij,rjn->rin", weights, part)
            place = each.solve[:, None]
            result[place, each.slots], slopes[place, each.slots] = _whitened(each, values), dense
        return result, slopes


def _lines(group: Group, first: Indices, rows: Indices, taken: Indices, kept: Mask | None) -> _Lines:
    """The rows of consecutive solves; ``taken`` (K,) residuals of each stand before those of this group.

    ``kept`` (R, outputs) says which outputs count (None: all).
    """
    solve = np.repeat(np.arange(len(rows)), rows)
    before = np.cumsum(rows) - rows
    own = np.arange(len(solve)) - before[solve]
    outputs = group.kernel.outputs
    slots = (taken[solve] + own * outputs)[:, None] + np.arange(outputs)
    begin, end = (int(first[0]), int(first[-1] + rows[-1])) if len(rows) else (0, 0)
    together = end - begin == len(solve)
    places = slice(begin, end) if together else first[solve] + own
    return _Lines(
        group=group,
        counts=rows,
        solve=solve,
        slots=slots,
        kept=np.ones(slots.shape, dtype=bool) if kept is None else kept,
        whiteners=tuple(_taken(each, places, kept) for each in group.whiteners),
        inputs=_blank(group, group.parameters[places]),
    )


def _taken(whitener: Whitener, places: Indices | slice, kept: Mask | None) -> Whitener:
    """The whitener of some rows; what does not count weighs nothing."""
    weights = whitener.weights[places]
    if kept is not None:
        counted = kept[:, whitener.first : whitener.last]
        weights = weights * (counted if weights.ndim == 2 else counted[:, :, None])
    return replace(whitener, weights=weights, exact=None)


def _blank(group: Group, parameters: Floats) -> Floats:
    """Inputs of the kernel, the numbers of the unknowns still to be put there."""
    return np.hstack([np.zeros((len(parameters), group.index.shape[1])), parameters])


def _inputs(lines: _Lines, points: Floats) -> Floats:
    """Inputs of the kernel, each row with the numbers of its solve; valid until the next call."""
    group = lines.group
    if len(group.index):
        lines.inputs[:, : group.index.shape[1]] = np.repeat(points[:, group.index[0]], lines.counts, axis=0)
    return lines.inputs


def _whitened(lines: _Lines, values: Floats) -> Floats:
    parts = []
    for whitener in lines.whiteners:
        part, weights = values[:, whitener.first : whitener.last], whitener.weights
        parts.append(part * weights if weights.ndim == 2 else np.einsum("rij,rj->ri", weights, part))
    return parts[0] if len(parts) == 1 else np.hstack(parts)


def stated(group: Group, points: Floats) -> Floats:
    """The outputs (K, outputs) of a group of one row at points (K, N)."""
    return group.cache.stream(group.number, group.kernel).values(_inputs(_once(group, len(points)), points))


def stated_slopes(group: Group, points: Floats, equations: Assembled) -> Floats:
    """Their derivatives (K, outputs, n) by a step of the free coordinates."""
    lines = _once(group, len(points))
    nonzeros = group.cache.stream(group.number, group.kernel).values_and_jacobian(_inputs(lines, points))[1]
    result = np.zeros((len(points), group.kernel.outputs, equations.dimension))
    group.scatter(_columns(equations)).add(nonzeros, result)
    return result


def _columns(equations: Assembled) -> Indices:
    """The column of each coordinate (M,) in Jacobians, -1 where it is not free."""
    columns = np.full(len(equations.layout.number), -1, dtype=np.int64)
    columns[equations.free] = np.arange(equations.dimension)
    return columns


def _once(group: Group, solves: int) -> _Lines:
    """A group of one row as that of each solve."""
    return _Lines(
        group=group,
        counts=np.ones(solves, dtype=np.int64),
        solve=np.arange(solves),
        slots=np.zeros((solves, 1), dtype=np.int64),
        kept=np.ones((solves, 1), dtype=bool),
        whiteners=(),
        inputs=_blank(group, np.repeat(group.parameters, solves, axis=0)),
    )
