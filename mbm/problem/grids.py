"""``:over (grid t 0s 10s 200)``: values of a variable at equal steps, both ends in, as a table of one column."""

from __future__ import annotations

import numpy as np

from mbm.expression.nodes import Expression
from mbm.expression.units import Unit
from mbm.problem.tables import Column, Numbers, Provenance, Table
from mbm.text.types import Span
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """``count`` values of ``variable`` from ``first`` to ``last`` (SI), ascending or descending.

    ``table`` is the name of the table that they make, ``ends`` are the two ends as expressions without unknowns. The
    values are reported in ``unit``, in SI where that is None.
    """

    table: str
    variable: str
    first: float
    last: float
    count: int
    unit: Unit | None
    ends: tuple[Expression, Expression]
    span: Span

    def shown(self) -> Numbers:
        """The values (count,) in the unit that they are reported in."""
        factor = self.unit.factor if self.unit is not None else 1.0
        with np.errstate(over="ignore", invalid="ignore"):
            return np.linspace(self.first / factor, self.last / factor, self.count)

    def rows(self) -> Table:
        """The table, its values in SI."""
        factor = self.unit.factor if self.unit is not None else 1.0
        symbol = self.unit.symbol if self.unit is not None else None
        column = Column(name=self.variable, numbers=self.shown() * factor, unit=symbol)
        rows = np.arange(1, self.count + 1)
        provenance = Provenance(path=self.table, sha256=None, rows=self.count, file_rows=rows, inline=True)
        return Table(
            name=self.table,
            columns={self.variable: column},
            rows=rows,
            provenance=provenance,
            key=self.variable,
        )
