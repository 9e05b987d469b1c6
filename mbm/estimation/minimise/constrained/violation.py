"""The violations of constraints alone as residuals: least squares finds the point where they are least."""

from __future__ import annotations

import numpy as np

from mbm.equations.forwarding import Forwarding
from mbm.equations.types import Floats, Indices, Mask, Minimum
from mbm.estimation.minimise.constrained.types import ConstrainedEquations
from mbm.estimation.minimise.native.minimum import native_minimum
from mbm.estimation.settings import Settings
from mbm.problem.types import Method
from mbm.values import dataclass

TOLERANCE = 1e-10
STILL = 1e-7
"""Violations (in units of the constraints) that are none: the search for the least has this accuracy at least."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Violations(Forwarding):
    """A residual for each constraint ``chosen`` (k,), in its ``unit`` (k,); 0 of an inequality that holds."""

    equations: ConstrainedEquations
    chosen: Indices
    unit: Floats
    lower: Floats
    upper: Floats

    @property
    def count(self) -> int:
        """Constraints."""
        return len(self.unit)

    @property
    def linear(self) -> bool:
        """Never promised: inequalities have a kink."""
        return False

    def residuals(self, x: Floats) -> Floats:
        """The violations, of equations with their signs."""
        values = self.equations.constraint_values(x)[self.chosen]
        return np.where(self._equality | np.isnan(values), values, np.maximum(values, 0.0)) / self.unit

    def jacobian(self, x: Floats) -> Floats:
        """Their derivatives."""
        acting = self._equality | ~(self.equations.constraint_values(x)[self.chosen] <= 0.0)
        return self.equations.constraint_jacobian(x)[self.chosen] * (acting / self.unit)[:, None]

    @property
    def _equality(self) -> Mask:
        return self.equations.equality[self.chosen]


def least_violation(alone: Violations, start: Floats, limit: int) -> Minimum:
    """The point near ``start`` where ``Σ (violation/unit)²`` is least; its residuals are the violations."""
    settings = Settings(method=Method.MARQUARDT, max_iterations=limit, tolerance=TOLERANCE)
    return native_minimum(alone, start, settings)
