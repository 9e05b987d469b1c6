"""Rows that share measured values as systems; equations with errors in measured columns as equations without."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Protocol

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.corrections.measured import Measured, Some, components, divided, values_of
from mbm.equations.corrections.system import Part, System
from mbm.equations.types import Floats, Indices, Mask
from mbm.equations.whitening import Whitener
from mbm.kernels.types import Evaluation, Kernel
from mbm.problem import faults
from mbm.problem.types import Problem
from mbm.text.types import MbmError
from mbm.values import dataclass


class Evaluations(Protocol):
    """Where kernels are evaluated for so many rows."""

    def evaluation(self, number: int, kernel: Kernel, rows: int) -> Evaluation:
        """The evaluation of kernel ``number`` for ``rows`` rows."""
        ...


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
    """Makes the systems of one data set; ``kept`` (rows, outputs) says which equations of a group count (None: all)."""

    def __init__(
        self,
        problem: Problem,
        groups: tuple[Group, ...],
        measured: Measured,
        cache: Evaluations,
        kept: Mapping[int, Mask] | None,
    ) -> None:
        self._problem = problem
        self._groups = groups
        self._measured = measured
        self._cache = cache
        self._kept = kept

    def systems(self) -> tuple[System, ...]:
        """The systems: for each group one of the rows that share nothing, then the shared ones by their kinds.

        Raises:
            MbmError: more equations and values in one component than can be solved.

        """
        division = divided(self._measured, tuple((n, self._rows(n)) for n in self._measured.ids))
        alone = [self.alone(number, rows) for number, rows in division.alone]
        return (*alone, *(self._system(parts) for parts in _by_kind(self._connected(division.shared))))

    def _rows(self, number: int) -> Indices:
        if self._kept is None:
            return np.arange(self._groups[number].rows)
        return np.flatnonzero(self._kept[number].any(axis=1))

    def alone(self, number: int, rows: Indices) -> System:
        """The system of some rows of a group that share nothing."""
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
        some = self._some(rows.group, rows.rows)
        columns = np.asarray(corrections.columns, dtype=np.int64)
        sigma = self._measured.sigma[ids]
        return Part(
            group=some,
            evaluation=self._cache.evaluation(-1 - group.number, corrections.kernel, len(rows.rows)),
            columns=columns,
            measured=some.parameters[:, columns],
            slope_scale=sigma[:, corrections.slope_columns],
            curvature_scale=sigma[:, corrections.curvature_rows] * sigma[:, corrections.curvature_columns],
            sigma=sigma,
            ids=ids,
            residuals=lines,
            equations=rows.components[:, None] * k + rows.equations[:, None] + outputs,
            places=places,
            alone=alone,
        )

    def _some(self, number: int, rows: Indices) -> Group:
        """A group with some of its rows, and some of their equations."""
        group = self._groups[number]
        whiteners = tuple(w.some(rows) for w in group.whiteners)
        if self._kept is not None:
            counts = self._kept[number][rows]
            whiteners = tuple(w.without(~counts[:, w.first]) for w in whiteners)
        elif np.array_equal(rows, np.arange(group.rows)):
            return group
        return replace(
            group,
            evaluation=self._cache.evaluation(group.number, group.kernel, len(rows)),
            positions=group.positions[rows] if group.positions is not None else None,
            index=group.index[rows],
            columns=group.columns[rows],
            parameters=group.parameters[rows],
            whiteners=whiteners,
            trusted=group.trusted[rows] if group.trusted is not None else None,
        )

    def _finished(self, parts: tuple[Part, ...], count: int, k: int, q: int) -> System:
        residuals = np.zeros(count * k, dtype=np.int64)
        noisy = np.zeros(count * k, dtype=bool)
        for part in parts:
            residuals[part.equations] = part.residuals
            noisy[part.equations] = np.hstack([w.noisy for w in part.group.whiteners])
        return System(
            parts=parts,
            noisy=noisy.reshape(count, k),
            corrections=q,
            residuals=residuals.reshape(count, k),
            touched=_most_touched(parts, k),
        )

    def _connected(self, shared: Some) -> Iterator[tuple[int, Rows]]:
        """Rows by group, with the number of their components' kind; components are numbered within their kind.

        Of one kind are components of the same size (k, q) with rows of the same groups.
        """
        if not shared:
            return
        groups = np.concatenate([np.full(len(rows), number) for number, rows in shared])
        members = np.concatenate([rows for _, rows in shared])
        component = components(self._measured, shared)
        outputs = np.array([self._groups[number].kernel.outputs for number in groups])
        equations, k = _running(component, outputs)
        values, of = values_of(self._measured, shared, component)
        inside, q = _running(of, np.ones(len(of), dtype=np.int64), len(k))
        members_of = np.zeros((len(k), 1 + int(groups.max())), dtype=np.int64)
        members_of[component, groups] = 1
        kinds = np.unique(np.column_stack([k, q, members_of]), axis=0, return_inverse=True)[1]
        for kind in range(1 + int(kinds.max())):
            chosen = kinds == kind
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
                    kind,
                    Rows(
                        group=number,
                        rows=members[mine],
                        components=numbers[component[mine]],
                        equations=equations[mine],
                        corrections=corrections,
                    ),
                )


def _running(labels: Indices, amounts: Indices, count: int | None = None) -> tuple[Indices, Indices]:
    """For each item the sum of the amounts before it under its label, and the whole sum of each label."""
    order = np.argsort(labels, kind="stable")
    summed = np.cumsum(amounts[order]) - amounts[order]
    totals = np.bincount(labels, weights=amounts, minlength=count or 0).astype(np.int64)
    starts = np.cumsum(totals) - totals
    result = np.empty(len(labels), dtype=np.int64)
    result[order] = summed - starts[labels[order]]
    return result, totals


def _by_kind(found: Iterator[tuple[int, Rows]]) -> list[tuple[Rows, ...]]:
    kinds: dict[int, list[Rows]] = {}
    for kind, rows in found:
        kinds.setdefault(kind, []).append(rows)
    return [tuple(parts) for parts in kinds.values()]


def _most_touched(parts: tuple[Part, ...], k: int) -> int:
    """The most coordinates that one component of k equations touches."""
    if all(part.alone for part in parts):
        return max(int(part.group.columns.shape[1]) for part in parts)
    width = 1 + max(int(part.group.columns.max(initial=0)) for part in parts)
    codes = [(part.equations[:, :1] // k * width + part.group.columns).ravel() for part in parts]
    owners: Indices = np.unique(np.concatenate(codes)) // width
    return int(np.bincount(owners, minlength=1).max())


KEPT = "eliminated"
"""Where `EvaluationCache.native` has the kernels that were made."""

NUMBERS = 1_000_000
"""Kernels that were made are numbered from here on: beyond all others."""


@dataclass(frozen=True, slots=True, eq=False)
class _Made:
    """Kernels by the number of the one they were made of and by its noise; None: not to be had."""

    kernels: dict[tuple[int, tuple[tuple[int, int, bool], ...]], tuple[int, Kernel | None]]

    def of(self, group: Group) -> tuple[int, Kernel | None]:
        """The kernel for a group, and its number."""
        noises = tuple((w.first, w.last, w.weights.ndim == 3) for w in group.whiteners)
        key = (group.number, noises)
        if key not in self.kernels:
            # Loaded where it is needed first, as most problems are without.
            from mbm.kernels.eliminated import eliminated_kernel

            self.kernels[key] = (NUMBERS + len(self.kernels), eliminated_kernel(group.kernel, noises))
        return self.kernels[key]


def straight_groups(groups: tuple[Group, ...], systems: tuple[System, ...]) -> tuple[Group, ...] | None:
    """The groups, with kernels that eliminate the corrections of ``systems`` themselves; None: it cannot be done so.

    Their residuals and Jacobian are not finite where the corrections need a search.
    """
    sigmas = _sigmas(groups, systems)
    return None if sigmas is None else eliminating(groups, sigmas)


def eliminating(groups: tuple[Group, ...], sigmas: Mapping[int, Floats]) -> tuple[Group, ...] | None:
    """The groups, with kernels that eliminate the corrections of values that no other equation of a solve uses.

    ``sigmas`` (rows, c) are the standard deviations of these values, by the numbers of the groups. None: it cannot be
    done so.
    """
    if any(group.sampled for group in groups):
        return None
    kept = groups[0].cache.native
    made = kept.setdefault(KEPT, _Made({}))
    if not isinstance(made, _Made):
        raise TypeError(KEPT)
    found = []
    for number, group in enumerate(groups):
        sigma = sigmas.get(number)
        changed = group if sigma is None else _group(group, sigma, made)
        if changed is None:
            return None
        found.append(changed)
    return tuple(found)


def _sigmas(groups: tuple[Group, ...], systems: tuple[System, ...]) -> dict[int, Floats] | None:
    """The standard deviations for each group with corrections; None where some rows hang together."""
    found: dict[int, Floats] = {}
    of_first = {group.first: number for number, group in enumerate(groups) if group.rows}
    for system in systems:
        part = system.parts[0]
        if len(system.parts) > 1 or not part.alone:
            return None
        number = of_first.get(part.group.first)
        if number is None or part.group.rows != groups[number].rows:
            return None
        found[number] = part.sigma
    wanted = {n for n, group in enumerate(groups) if group.kernel.corrections is not None and group.rows}
    return found if set(found) == wanted else None


def _group(group: Group, sigma: Floats, made: _Made) -> Group | None:
    """The group with its kernel replaced; None where that is too large, or the roots of the covariances are others."""
    if group.kernel.outputs > sigma.shape[1]:
        return None
    number, kernel = made.of(group)
    if kernel is None:
        return None
    rows = group.rows
    weights = [w.weights.reshape(rows, -1) for w in group.whiteners]
    own = [w.noisy.astype(np.float64) for w in group.whiteners]
    return replace(
        group,
        number=number,
        kernel=kernel,
        evaluation=group.cache.evaluation(number, kernel, rows),
        parameters=np.hstack([group.parameters, sigma, *weights, *own]),
        whiteners=tuple(Whitener(w.first, w.last, np.ones((rows, w.last - w.first))) for w in group.whiteners),
    )
