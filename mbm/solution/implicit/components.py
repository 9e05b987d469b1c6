"""Groups of equations → systems: rows that share measured values belong together, all others stand for themselves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from mbm.problem import faults
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.solution.binding import EvaluationCache, Group
from mbm.solution.implicit.measured import Measured
from mbm.solution.implicit.system import Part, System
from mbm.solution.types import Indices, Mask
from mbm.text.types import MbmError

LARGEST = 40_000_000
"""Numbers in the largest matrix of one component: 320 MB, and several of them are needed at once."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows:
    """Rows of one group: which, which component each belongs to, and where its equations and corrections stand there.

    ``components`` (rows,), ``equations`` (rows,) the first equation of the row in its component, ``corrections``
    (rows, c) the place of each value in its component, -1 where it is exact.
    """

    group: int
    rows: Indices
    components: Indices
    equations: Indices
    corrections: Indices


class Builder:
    """Makes the systems of one data set; ``kept`` has, for each group with corrections, the rows in use (None: all)."""

    def __init__(
        self,
        problem: Problem,
        tables: Mapping[str, Table],
        groups: tuple[Group, ...],
        measured: Measured,
        cache: EvaluationCache,
        kept: Mapping[int, Mask] | None,
    ) -> None:
        self._problem = problem
        self._tables = tables
        self._groups = groups
        self._measured = measured
        self._cache = cache
        self._kept = kept

    def systems(self) -> tuple[System, ...]:
        """The systems: for each group one of the rows that share nothing, then the shared ones by their sizes.

        Raises:
            MbmError: more exact equations than uncertain values, more of them in one component than can be solved.

        """
        found = []
        shared: list[tuple[int, Indices]] = []
        times = np.zeros(len(self._measured.sigma), dtype=np.int64)
        for number, ids in self._measured.ids.items():
            used = ids[self._rows(number)]
            times += np.bincount(used[self._measured.sigma[used] > 0.0], minlength=len(times))
        for number, ids in self._measured.ids.items():
            rows = self._rows(number)
            meets = ((self._measured.sigma[ids[rows]] > 0.0) & (times[ids[rows]] > 1)).any(axis=1)
            if not bool(meets.all()):
                found.append(self._alone(number, rows[~meets]))
            if bool(meets.any()):
                shared.append((number, rows[meets]))
        return (*found, *(self._system(parts) for parts in _by_size(self._connected(shared))))

    def _rows(self, number: int) -> Indices:
        if self._kept is None:
            return np.arange(self._groups[number].rows)
        return np.flatnonzero(self._kept[number])

    def _alone(self, number: int, rows: Indices) -> System:
        ids = self._measured.ids[number][rows]
        count, width = ids.shape
        outputs = self._groups[number].kernel.outputs
        lines = np.arange(count)
        part = self._part(
            Rows(
                group=number,
                rows=rows,
                components=lines,
                equations=np.zeros(count, dtype=np.int64),
                corrections=np.broadcast_to(np.arange(width), (count, width)),
            ),
            outputs,
            width,
            alone=True,
        )
        return self._finished((part,), count, outputs, width)

    def _system(self, parts: tuple[Rows, ...]) -> System:
        last = {
            int(c): int(e) + self._groups[p.group].kernel.outputs
            for p in parts
            for c, e in zip(p.components, p.equations, strict=True)
        }
        k = max(last.values())
        q = 1 + max(int(p.corrections.max(initial=-1)) for p in parts)
        count = 1 + max(int(p.components.max()) for p in parts)
        made = tuple(self._part(p, k, q, alone=False) for p in parts)
        for part in made:
            if part.group.losses:
                block = self._problem.blocks[part.group.kernel.owner]
                raise MbmError(faults.errors_with_loss(block.span, block.name, block.errors[0].name))
        if max((k + q) ** 2 if k <= q else k * q, q * q) > LARGEST:
            span = self._problem.blocks[made[0].group.kernel.owner].span
            raise MbmError(faults.too_many_shared_errors(span, k, q))
        return self._finished(made, count, k, q)

    def _part(self, rows: Rows, k: int, q: int, *, alone: bool) -> Part:
        group = self._groups[rows.group]
        corrections = group.kernel.corrections
        if corrections is None:
            raise TypeError(group.kernel.name)
        ids = self._measured.ids[rows.group][rows.rows]
        outputs = np.arange(group.kernel.outputs)
        lines = group.first + rows.rows[:, None] * group.kernel.outputs + outputs
        places = np.where(rows.corrections >= 0, rows.components[:, None] * q + rows.corrections, -1)
        return Part(
            group=group if len(rows.rows) == group.rows else self._some(group, rows.rows),
            evaluation=self._cache.evaluation(-1 - group.number, corrections.kernel, len(rows.rows)),
            sigma=self._measured.sigma[ids],
            ids=ids,
            residuals=lines,
            equations=rows.components[:, None] * k + rows.equations[:, None] + outputs,
            places=places,
            alone=alone,
        )

    def _some(self, group: Group, rows: Indices) -> Group:
        """A group with some of its rows."""
        return replace(
            group,
            evaluation=self._cache.evaluation(group.number, group.kernel, len(rows)),
            positions=group.positions[rows] if group.positions is not None else None,
            index=group.index[rows],
            columns=group.columns[rows],
            parameters=group.parameters[rows],
            whiteners=tuple(w.some(rows) for w in group.whiteners),
        )

    def _finished(self, parts: tuple[Part, ...], count: int, k: int, q: int) -> System:
        residuals = np.zeros(count * k, dtype=np.int64)
        noisy = np.zeros(count * k, dtype=bool)
        uncertain = np.zeros(count, dtype=np.int64)
        for part in parts:
            residuals[part.equations] = part.residuals
            noisy[part.equations] = np.hstack([w.noisy for w in part.group.whiteners])
            real = part.sigma > 0.0
            places = np.unique(part.places[real])
            uncertain += np.bincount(places // q, minlength=count)
        exact = (~noisy.reshape(count, k)).sum(axis=1)
        if bool((exact > uncertain).any()):
            raise self._too_few(parts, int(np.argmax(exact > uncertain)), exact, uncertain, k)
        return System(parts=parts, noisy=noisy.reshape(count, k), corrections=q, residuals=residuals.reshape(count, k))

    def _too_few(self, parts: tuple[Part, ...], component: int, exact: Indices, uncertain: Indices, k: int) -> MbmError:
        part = next(p for p in parts if bool((p.equations // k == component).any()))
        row = int(np.argmax((part.equations // k == component).any(axis=1)))
        block = self._problem.blocks[part.group.kernel.owner]
        place = None
        if block.table is not None and part.group.positions is not None:
            place = self._tables[block.table].place(int(part.group.positions[row]))
        counts = (int(exact[component]), int(uncertain[component]))
        return MbmError(faults.too_few_errors(block.span, block.name, *counts, place))

    def _connected(self, shared: list[tuple[int, Indices]]) -> Iterator[tuple[int, int, Rows]]:
        """Rows by group, with the sizes (k, q) of their components; components are numbered within their size."""
        if not shared:
            return
        groups = np.concatenate([np.full(len(rows), number) for number, rows in shared])
        members = np.concatenate([rows for _, rows in shared])
        component = self._labels(shared)
        outputs = np.array([self._groups[number].kernel.outputs for number in groups])
        equations, k = _running(component, outputs)
        values, of = self._values(shared, component)
        inside, q = _running(of, np.ones(len(of), dtype=np.int64), len(k))
        sizes = np.stack([k, q], axis=1)
        for size in np.unique(sizes, axis=0):
            chosen = (sizes == size).all(axis=1)
            numbers = np.cumsum(chosen) - 1
            for number, _ in shared:
                mine = (groups == number) & chosen[component]
                if not bool(mine.any()):
                    continue
                ids = self._measured.ids[number][members[mine]]
                corrections = np.full(ids.shape, -1, dtype=np.int64)
                real = self._measured.sigma[ids] > 0.0
                owner = np.broadcast_to(component[mine][:, None], ids.shape)
                where = np.searchsorted(values, ids[real] + owner[real] * len(self._measured.sigma))
                corrections[real] = inside[where]
                yield (
                    int(size[0]),
                    int(size[1]),
                    Rows(
                        group=number,
                        rows=members[mine],
                        components=numbers[component[mine]],
                        equations=equations[mine],
                        corrections=corrections,
                    ),
                )

    def _labels(self, shared: list[tuple[int, Indices]]) -> Indices:
        """The component of each shared row."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        lines, values, offset = [], [], 0
        for number, rows in shared:
            ids = self._measured.ids[number][rows]
            real = self._measured.sigma[ids] > 0.0
            lines.append(np.broadcast_to(offset + np.arange(len(rows))[:, None], ids.shape)[real])
            values.append(ids[real])
            offset += len(rows)
        row, value = np.concatenate(lines), np.concatenate(values)
        size = offset + len(self._measured.sigma)
        links = coo_array((np.ones(len(row)), (row, offset + value)), shape=(size, size))
        labels = connected_components(links, directed=False)[1][:offset]
        return np.asarray(np.unique(labels, return_inverse=True)[1], dtype=np.int64)

    def _values(self, shared: list[tuple[int, Indices]], component: Indices) -> tuple[Indices, Indices]:
        """The uncertain values of all components as sorted numbers ``value + component·P``, and their components."""
        count = len(self._measured.sigma)
        parts, offset = [], 0
        for number, rows in shared:
            ids = self._measured.ids[number][rows]
            owner = np.broadcast_to(component[offset : offset + len(rows)][:, None], ids.shape)
            real = self._measured.sigma[ids] > 0.0
            parts.append(ids[real] + owner[real] * count)
            offset += len(rows)
        found = np.unique(np.concatenate(parts))
        return found, found // count


def _running(labels: Indices, amounts: Indices, count: int | None = None) -> tuple[Indices, Indices]:
    """For each item the sum of the amounts before it under its label, and the whole sum of each label."""
    order = np.argsort(labels, kind="stable")
    summed = np.cumsum(amounts[order]) - amounts[order]
    totals = np.bincount(labels, weights=amounts, minlength=count or 0).astype(np.int64)
    starts = np.cumsum(totals) - totals
    result = np.empty(len(labels), dtype=np.int64)
    result[order] = summed - starts[labels[order]]
    return result, totals


def _by_size(found: Iterator[tuple[int, int, Rows]]) -> list[tuple[Rows, ...]]:
    sizes: dict[tuple[int, int], list[Rows]] = {}
    for k, q, rows in found:
        sizes.setdefault((k, q), []).append(rows)
    return [tuple(parts) for parts in sizes.values()]
