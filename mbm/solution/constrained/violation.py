"""The violations of constraints alone as residuals: least squares finds the point where they are least."""

from __future__ import annotations

import numpy as np

from mbm.problem.types import Method
from mbm.solution.constrained.linearise import violations
from mbm.solution.constrained.types import ConstrainedEquations
from mbm.solution.forwarding import Forwarding
from mbm.solution.native.minimum import native_minimum
from mbm.solution.settings import Settings
from mbm.solution.types import Floats, Minimum
from mbm.values import dataclass

TOLERANCE = 1e-10
STILL = 1e-7
"""Violations (in units of the constraints) that are none: the search for the least has this accuracy at least."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Violations(Forwarding):
    """A residual for each constraint, in its ``unit`` (k,); of inequalities only where positive."""

    equations: ConstrainedEquations
    unit: Floats
    lower: Floats
    upper: Floats

    @property
    def count(self) -> int:
        return len(self.unit)

    @property
    def linear(self) -> bool:
        """Never promised: inequalities have a kink."""
        return False

    def residuals(self, x: Floats) -> Floats:
        values = self.equations.constraint_values(x) / self.unit
        return np.where(self.equations.equality | np.isnan(values), values, np.maximum(values, 0.0))

    def jacobian(self, x: Floats) -> Floats:
        acting = self.equations.equality | ~(self.equations.constraint_values(x) <= 0.0)
        return self.equations.constraint_jacobian(x) * (acting / self.unit)[:, None]


def least_violation(equations: ConstrainedEquations, start: Floats, unit: Floats, limit: int) -> tuple[Minimum, Floats]:
    """The point near ``start`` where ``Σ (violation/unit)²`` is least, and the violations (k,) there in units."""
    alone = _Violations(equations=equations, unit=unit, lower=equations.lower, upper=equations.upper)
    settings = Settings(method=Method.MARQUARDT, max_iterations=limit, tolerance=TOLERANCE)
    found = native_minimum(alone, start, settings)
    return found, violations(equations.constraint_values(found.point), equations.equality) / unit
