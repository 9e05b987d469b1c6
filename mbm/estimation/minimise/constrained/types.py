"""Equations with constraints, and what they are at a point to first order."""

from __future__ import annotations

from typing import Protocol, cast

from mbm.equations.types import Equations, Floats, Mask
from mbm.values import dataclass


class ConstrainedEquations(Equations, Protocol):
    """Least squares with constraints: ``c_i(x) = 0`` where ``equality[i]``, ``c_i(x) <= 0`` elsewhere."""

    @property
    def equality(self) -> Mask:
        """Which constraints are equations, shape (k,)."""
        ...

    def constraint_values(self, x: Floats) -> Floats:
        """c(x), shape (k,), in the units that the problem states them in; NaN where one has no value."""
        ...

    def constraint_jacobian(self, x: Floats) -> Floats:
        """dc/d(step) at step 0, shape (k, n)."""
        ...


def constrained(equations: Equations) -> ConstrainedEquations | None:
    """The equations if they have constraints."""
    equality = getattr(equations, "equality", None)
    return cast(ConstrainedEquations, equations) if equality is not None and equality.size > 0 else None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Linearised:
    """Everything at a point to first order.

    ``residuals`` (m,), ``jacobian`` (m, n), ``values`` (k,), ``slopes`` (k, n) of the constraints; ``scale`` (n,) > 0
    measures coordinates: ``1/scale`` is about a standard deviation; ``unit`` (k,) > 0 is what a movement by one such
    unit does to a constraint, so that ``values / unit`` does not depend on how the constraint is written.
    ``rounding`` (k,) is the error of ``values`` that the arithmetic makes.
    """

    point: Floats
    residuals: Floats
    jacobian: Floats
    values: Floats
    slopes: Floats
    scale: Floats
    unit: Floats
    rounding: Floats
    noise: float

    @property
    def cost(self) -> float:
        """``Σ r²``."""
        return float(self.residuals @ self.residuals)
