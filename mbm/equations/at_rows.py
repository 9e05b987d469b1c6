"""Expressions at rows of a table and numbers of the unknowns, without a kernel: for what is asked for once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mbm.equations.layout import Layout
from mbm.equations.members import MemberPicker, picked_members
from mbm.equations.types import Floats, Indices, Mask
from mbm.expression.evaluate import Values, evaluate
from mbm.expression.nodes import Column, Component, Expression, Leaf, externals
from mbm.problem.rows import Positions, lookup, sampled_column
from mbm.problem.tables import Table
from mbm.problem.types import Equation
from mbm.values import dataclass

DIVIDES_BY_DEPTH = "pinhole"
"""The model of cameras that shows points behind it, turned upside down."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AtRows:
    """R rows at ``positions`` of ``table`` (one without a table); ``numbers`` gives those of the unknowns at places
    (R,) of the ``layout``, or at one for all rows.
    """

    count: int
    layout: Layout
    table: Table | None
    positions: Positions | None
    tables: Mapping[str, Table]
    numbers: Callable[[Indices | int], Values]
    pick: MemberPicker = picked_members

    def values(self, roots: Sequence[Expression], instead: Mapping[str, Sequence[float]] | None = None) -> Floats:
        """The values (R, k) of expressions that call no Python; unknowns named in ``instead`` have those numbers."""
        data = lookup(self.table, self.positions, self.tables)

        def value(leaf: Leaf) -> Values:
            if isinstance(leaf, Column) and leaf.sampling is not None:
                return sampled_column(leaf, leaf.sampling, value, self.tables)
            if not isinstance(leaf, Component):
                return data(leaf)
            entry = self.layout.entry(leaf.unknown)
            place = entry.unknown.indices().index(leaf.index)
            if instead is not None and leaf.unknown in instead:
                return instead[leaf.unknown][place]
            member: Indices | int = 0
            if leaf.member is not None:
                member = self.pick(entry, leaf.member, self.table, self.positions, self.tables)
            return self.numbers(entry.offset + member * entry.unknown.size + place)

        found = np.empty((self.count, len(roots)))
        for place, column in enumerate(evaluate(tuple(roots), value)):
            found[:, place] = column
        return found

    def behind(self, equations: Sequence[Equation]) -> Mask | None:
        """Which rows (R,) see a point that is behind its camera, or beside it; None where no equation can tell."""
        depths = [
            equation.projection.depth
            for equation in equations
            if equation.projection is not None and equation.projection.model == DIVIDES_BY_DEPTH
        ]
        if not depths or any(externals(tuple(depths))):
            return None
        return np.asarray((self.values(depths) <= 0).any(axis=1))
