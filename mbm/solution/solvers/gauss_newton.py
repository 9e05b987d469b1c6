"""Damped Gauss-Newton: the undamped direction, shortened to the radius."""

from __future__ import annotations

from math import sqrt

from mbm.solution.solvers.scaled import Scaled
from mbm.solution.solvers.trust_region import TrustRegion
from mbm.solution.types import Floats


def gauss_newton_step(parts: Scaled, radius: float) -> Floats:
    """The Gauss-Newton direction, at most ``radius`` long: refused steps are halved along it (Hartley 1961)."""
    full = parts.gauss_newton()
    length = sqrt(float(full @ full))
    return full if length <= radius else full * (radius / length)


GAUSS_NEWTON = TrustRegion(name="gauss-newton", rule=gauss_newton_step)
