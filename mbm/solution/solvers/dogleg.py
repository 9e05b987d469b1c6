"""Powell's dogleg: along the gradient to its minimum, then straight towards Gauss-Newton's step, to the radius."""

from __future__ import annotations

from math import sqrt

from mbm.solution.solvers.scaled import Scaled
from mbm.solution.solvers.trust_region import TrustRegion
from mbm.solution.types import Floats


def dogleg_step(parts: Scaled, radius: float) -> Floats:
    """The point of the dogleg path on the radius (Powell 1970)."""
    full = parts.gauss_newton()
    if sqrt(float(full @ full)) <= radius:
        return full
    cauchy, length = parts.steepest()
    if length >= radius:
        return cauchy * (radius / length)
    onward = full - cauchy
    a, b = float(onward @ onward), float(cauchy @ onward)
    c = length * length - radius * radius
    return cauchy + (-c / (b + sqrt(max(b * b - a * c, 0.0)))) * onward


DOGLEG = TrustRegion(name="dogleg", rule=dogleg_step)
