"""Marquardt's method: inside the trust radius, the step of the damped equations whose length is the radius."""

from __future__ import annotations

from math import sqrt

from mbm.solution.solvers.scaled import Scaled
from mbm.solution.solvers.trust_region import TrustRegion
from mbm.solution.types import Floats


def marquardt_step(parts: Scaled, radius: float) -> Floats:
    """Gauss-Newton's step where it is short enough, else the damped one (Levenberg 1944, Marquardt 1963, Moré 1978)."""
    full = parts.gauss_newton()
    return full if sqrt(float(full @ full)) <= 1.1 * radius else parts.damped(radius, full)


MARQUARDT = TrustRegion(name="lm", rule=marquardt_step)
