"""Layouts of many solves of one problem: made once where no option of an unknown looks into a table."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.equations.layout import Layout, layout, stated_values
from mbm.equations.types import Floats
from mbm.expression.nodes import Column, leaves
from mbm.problem.tables import Table
from mbm.problem.types import Problem, RowValues, Unknown


class Layouts:
    """Remembers the last layout. Local to one compiled problem in one thread, as the kernels that are prepared."""

    def __init__(self) -> None:
        self._unknowns: tuple[Unknown, ...] | None = None
        self._shared = False
        self._last: tuple[Mapping[str, Floats], Layout] | None = None

    def of(self, problem: Problem, tables: Mapping[str, Table], starts: Mapping[str, Floats]) -> Layout:
        """The layout for these tables and starts; faults as `layout` has them."""
        if self._unknowns is not problem.unknowns:
            self._unknowns, self._last = problem.unknowns, None
            self._shared = not any(reads_tables(unknown) for unknown in problem.unknowns)
        if not self._shared:
            return layout(problem, tables, starts)
        if self._last is None or not _same(self._last[0], starts):
            self._last = (dict(starts), layout(problem, tables, starts))
        return self._last[1]


def reads_tables(unknown: Unknown) -> bool:
    """Whether members, starts, bounds or what is fixed follow from the rows of a table."""
    return unknown.family is not None or any(map(varies, stated(unknown)))


def limits(unknown: Unknown) -> tuple[RowValues, ...]:
    """What is stated of an unknown beside its start: bounds, the range of starts, what is fixed."""
    found = (unknown.lower, unknown.upper, unknown.start_lower, unknown.start_upper, unknown.fixed)
    return tuple(values for values in found if values is not None)


def stated(unknown: Unknown) -> tuple[RowValues, ...]:
    """All that is stated of an unknown."""
    values = stated_values(unknown)
    return limits(unknown) if values is None else (values, *limits(unknown))


def columns_of(values: RowValues) -> list[Column]:
    """The columns that an option reads."""
    nodes = tuple(node for case in values.cases for node in case.values)
    return [leaf for leaf in leaves(nodes) if isinstance(leaf, Column)]


def varies(values: RowValues) -> bool:
    """Whether an option may be another one in other rows: it reads columns, or depends on static ones."""
    return len(values.cases) > 1 or bool(columns_of(values))


def _same(some: Mapping[str, Floats], others: Mapping[str, Floats]) -> bool:
    return some.keys() == others.keys() and all(
        np.array_equal(numbers, others[name], equal_nan=True) for name, numbers in some.items()
    )
