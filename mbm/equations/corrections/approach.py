"""A better start for equations with errors in measured columns: the fit that takes the columns as exact."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mbm.equations.types import Correctable, Equations, Floats

FAR = 5.0
"""Root mean square residual, in standard deviations, from which a start is far: corrections that large bend the way to
the minimum more than the unknowns do."""

Minimise = Callable[[Equations, Floats], Floats]
"""From equations and a start to the point of a rough minimum."""


def approached(equations: Correctable, start: Floats, rough: Minimise) -> Floats:
    """The start (N,), or where ``rough`` leads from it with exact columns if that fits better."""
    compared = equations.roughly_corrected()
    cost = _cost(compared, start)
    if cost <= FAR**2 * compared.count:
        return start
    other = rough(equations.uncorrected(), start)
    return other if _cost(compared, other) < cost else start


@np.errstate(all="ignore")
def _cost(equations: Equations, point: Floats) -> float:
    residuals = equations.residuals(point)
    cost = float(residuals @ residuals)
    return cost if np.isfinite(cost) else np.inf
