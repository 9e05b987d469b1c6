"""Constraints as residuals: multiplied penalties, and the violations alone. The least squares solvers do the rest."""

from __future__ import annotations

import numpy as np

from mbm.problem.types import Method
from mbm.solution.constrained.linearise import violations
from mbm.solution.constrained.types import ConstrainedEquations, Stopped, never
from mbm.solution.forwarding import Forwarding
from mbm.solution.native.minimum import native_minimum
from mbm.solution.settings import Settings
from mbm.solution.types import Equations, Floats, Minimum, Profiled
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Penalised(Forwarding):
    """The augmented Lagrange function as squares (Hestenes 1969, Powell 1969, Rockafellar 1973).

    To the residuals come ``weight · (c/unit + shift)``, for inequalities only where positive. ``shift`` (k,) is the
    multiplier in units of the penalty. ``observed`` False leaves the residuals themselves out.
    """

    equations: ConstrainedEquations
    unit: Floats
    shift: Floats
    weight: float
    lower: Floats
    upper: Floats
    observed: bool = True

    @property
    def count(self) -> int:
        """Residuals, then one for each constraint."""
        return (self.equations.count if self.observed else 0) + len(self.unit)

    @property
    def linear(self) -> bool:
        """Never promised: inequalities have a kink."""
        return False

    @property
    def profiled(self) -> bool:
        """As the equations have it."""
        return self.observed and isinstance(self.equations, Profiled) and self.equations.profiled

    def residuals(self, x: Floats) -> Floats:
        """Whitened residuals and penalties."""
        penalties = self.weight * self._shifted(x)
        return np.concatenate([self.equations.residuals(x), penalties]) if self.observed else penalties

    def jacobian(self, x: Floats) -> Floats:
        """Derivatives of both."""
        acting = self.equations.equality | ~(self._shifted(x) <= 0.0)
        rows = self.equations.constraint_jacobian(x) * (self.weight * acting / self.unit)[:, None]
        return np.vstack([self.equations.jacobian(x), rows]) if self.observed else rows

    def _shifted(self, x: Floats) -> Floats:
        values = self.equations.constraint_values(x) / self.unit + self.shift
        return np.where(self.equations.equality | np.isnan(values), values, np.maximum(values, 0.0))


def penalised(
    equations: ConstrainedEquations, unit: Floats, multipliers: Floats, weight: float, *, observed: bool = True
) -> Penalised:
    """The penalties with ``multipliers`` (k,) of ``‖r‖²/2 + Σ λ c``, and a violation by one unit costing weight²/2."""
    return Penalised(
        equations=equations,
        unit=unit,
        shift=multipliers * unit / weight**2,
        weight=weight,
        lower=equations.lower,
        upper=equations.upper,
        observed=observed,
    )


def updated(penalties: Penalised, x: Floats) -> Floats:
    """The multipliers (k,) that the penalties at ``x`` amount to."""
    shifted = penalties.equations.constraint_values(x) / penalties.unit + penalties.shift
    acting = np.where(penalties.equations.equality, shifted, np.maximum(shifted, 0.0))
    return acting * penalties.weight**2 / penalties.unit


def marquardt(equations: Equations, start: Floats, tolerance: float, limit: int, stopped: Stopped = never) -> Minimum:
    """The minimum by Marquardt's method."""
    settings = Settings(method=Method.MARQUARDT, max_iterations=limit, tolerance=tolerance)
    return native_minimum(equations, start, settings, None if stopped is never else stopped)


def least_violation(
    equations: ConstrainedEquations, start: Floats, unit: Floats, tolerance: float, limit: int
) -> tuple[Minimum, Floats]:
    """The point near ``start`` where ``Σ (violation/unit)²`` is least, and the violations (k,) there in units."""
    alone = penalised(equations, unit, np.zeros(len(unit)), 1.0, observed=False)
    found = marquardt(alone, start, tolerance, limit)
    return found, violations(equations.constraint_values(found.point), equations.equality) / unit
