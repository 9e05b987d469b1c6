"""The values of expressions at an answer, row by row."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.equations.gathering import picked_members
from mbm.estimation.search.solution import Solution
from mbm.expression.evaluate import Lookup, Values, evaluate
from mbm.expression.nodes import Column, Component, Expression, Leaf, Parameter
from mbm.problem.rows import Positions, lookup
from mbm.problem.tables import Table
from mbm.report.types import Floats


def answer_lookup(
    solution: Solution,
    table: Table | None,
    positions: Positions | None,
    given: Mapping[Parameter, Floats] | None = None,
) -> Lookup:
    """Values of leaves at the estimates, for the rows at ``positions``; parameters are ``given``."""
    data = lookup(table, positions, solution.tables)

    def value(leaf: Leaf) -> Values:
        if isinstance(leaf, Component):
            return _component(leaf, solution, table, positions)
        if isinstance(leaf, Parameter):
            if given is None or leaf not in given:
                raise TypeError(leaf)
            return given[leaf]
        return data(leaf)

    return value


def stepped(known: Lookup, target: object, step: float) -> Lookup:
    """Values where the leaf of the identity ``target`` is greater by ``step``."""

    def value(leaf: Leaf) -> Values:
        found = known(leaf)
        return found + step if isinstance(leaf, Column | Component) and leaf.identity == target else found

    return value


def _component(leaf: Component, solution: Solution, table: Table | None, positions: Positions | None) -> Values:
    entry = solution.layout.entry(leaf.unknown)
    shape = entry.unknown.shape
    within = int(np.ravel_multi_index(tuple(i - 1 for i in leaf.index), shape)) if shape else 0
    member = 0 if leaf.member is None else picked_members(entry, leaf.member, table, positions, solution.tables)
    found = solution.numbers[entry.offset + np.asarray(member) * entry.unknown.size + within]
    return float(found) if np.ndim(found) == 0 else np.asarray(found)


def values_of(elements: tuple[Expression, ...], known: Lookup, rows: int) -> Floats:
    """Values (rows, n) of expressions."""
    return np.stack([np.broadcast_to(v, rows) for v in evaluate(elements, known)], axis=1).astype(np.float64)
