"""Which rows use a measured value that others use too, and what hangs together by such values."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.equations.corrections.measured import Measured, UncertainRows
from mbm.equations.types import Indices
from mbm.problem import faults
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.text.types import MbmError
from mbm.values import dataclass

Some = tuple[tuple[int, Indices], ...]
"""Rows of several groups: the group's number with the positions of the rows in it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Division:
    """Rows that share no uncertain value with another, and those that do."""

    alone: Some
    shared: Some


def divided(measured: Measured, rows: Some) -> Division:
    """The rows divided by whether one of their values is used twice."""
    times = np.zeros(len(measured.sigma), dtype=np.int64)
    for number, chosen in rows:
        ids = measured.ids[number][chosen]
        times += np.bincount(ids[measured.sigma[ids] > 0.0], minlength=len(times))
    alone, shared = [], []
    for number, chosen in rows:
        ids = measured.ids[number][chosen]
        meets = ((measured.sigma[ids] > 0.0) & (times[ids] > 1)).any(axis=1)
        if not bool(meets.all()):
            alone.append((number, chosen[~meets]))
        if bool(meets.any()):
            shared.append((number, chosen[meets]))
    return Division(alone=tuple(alone), shared=tuple(shared))


def components(measured: Measured, shared: Some) -> Indices:
    """The component, from 0, of each shared row, group after group."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    lines, values, offset = [], [], 0
    for number, rows in shared:
        ids = measured.ids[number][rows]
        real = measured.sigma[ids] > 0.0
        lines.append(np.broadcast_to(offset + np.arange(len(rows))[:, None], ids.shape)[real])
        values.append(ids[real])
        offset += len(rows)
    row, value = np.concatenate(lines), np.concatenate(values)
    size = offset + len(measured.sigma)
    links = coo_array((np.ones(len(row)), (row, offset + value)), shape=(size, size))
    labels = connected_components(links, directed=False)[1][:offset]
    return np.asarray(np.unique(labels, return_inverse=True)[1], dtype=np.int64)


def values_of(measured: Measured, shared: Some, component: Indices) -> tuple[Indices, Indices]:
    """The uncertain values of all components as sorted numbers ``value + component·P``, and their components."""
    count = len(measured.sigma)
    parts, offset = [], 0
    for number, rows in shared:
        ids = measured.ids[number][rows]
        owner = np.broadcast_to(component[offset : offset + len(rows)][:, None], ids.shape)
        real = measured.sigma[ids] > 0.0
        parts.append(ids[real] + owner[real] * count)
        offset += len(rows)
    found = np.unique(np.concatenate(parts))
    return found, found // count


def check_sharing(
    problem: Problem, tables: Mapping[str, Table], rows: Mapping[int, UncertainRows], measured: Measured
) -> None:
    """Whether corrections can meet the equations.

    Raises:
        MbmError: more exact equations than uncertain values hang together, or a loss acts on rows that share some.

    """
    division = divided(measured, tuple((number, np.arange(len(each.noisy))) for number, each in rows.items()))
    for number, chosen in division.alone:
        ids = measured.ids[number][chosen]
        exact = (~rows[number].noisy[chosen]).sum(axis=1)
        uncertain = (measured.sigma[ids] > 0.0).sum(axis=1)
        if bool((exact > uncertain).any()):
            row = int(np.argmax(exact > uncertain))
            counts = (int(exact[row]), int(uncertain[row]))
            raise _too_few(problem, tables, rows[number], int(chosen[row]), counts)
    if not division.shared:
        return
    for number, _ in division.shared:
        if rows[number].lossy:
            block = problem.blocks[rows[number].owner]
            raise MbmError(faults.errors_with_loss(block.span, block.name, rows[number].columns[0].name))
    component = components(measured, division.shared)
    size = int(component.max()) + 1
    owners = values_of(measured, division.shared, component)[1]
    each_exact = np.concatenate([(~rows[number].noisy[chosen]).sum(axis=1) for number, chosen in division.shared])
    exact = np.bincount(component, weights=each_exact, minlength=size)
    uncertain = np.bincount(owners, minlength=size)
    if not bool((exact > uncertain).any()):
        return
    worst = int(np.argmax(exact > uncertain))
    place = int(np.argmax(component == worst))
    for number, chosen in division.shared:
        if place < len(chosen):
            counts = (int(exact[worst]), int(uncertain[worst]))
            raise _too_few(problem, tables, rows[number], int(chosen[place]), counts)
        place -= len(chosen)


def _too_few(
    problem: Problem, tables: Mapping[str, Table], rows: UncertainRows, row: int, counts: tuple[int, int]
) -> MbmError:
    block = problem.blocks[rows.owner]
    place = tables[block.table].place(int(rows.positions[row])) if block.table is not None else None
    return MbmError(faults.too_few_errors(block.span, block.name, *counts, place))
