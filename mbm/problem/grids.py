"""``:over (grid t 0s 10s 200)``: values of a variable at equal steps, both ends in, as a table of one column."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbm.expression.nodes import Expression
from mbm.expression.units import Unit
from mbm.scales import SI, Scale
from mbm.text.types import Span
from mbm.values import dataclass

ROUNDED = 11
"""Decimals of temperatures: some hundreds of kelvin have errors of 1e-13, and keys are to read 32, not 31.9999999."""


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

    @property
    def scale(self) -> Scale:
        """The scale of the unit that the values are reported in."""
        return SI if self.unit is None else self.unit.scale

    def shown(self) -> NDArray[np.float64]:
        """The values (count,) in the unit that they are reported in."""
        scale = self.scale
        with np.errstate(over="ignore", invalid="ignore"):
            found = np.linspace(scale.from_si(self.first), scale.from_si(self.last), self.count)
            return found if scale.zero == 0.0 else np.round(found, ROUNDED)
