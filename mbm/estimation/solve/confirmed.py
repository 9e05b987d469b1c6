"""Corrections at a minimum that do not hang on the way there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Minimum, Reason
from mbm.estimation.minimise.native.minimum import without_value


def confirmed(equations: Assembled, minimum: Minimum) -> Minimum:
    """The minimum, if the corrections there are found without those of points before; else it has no finite value.

    Searches go on from the corrections of the point before. Where only that finds them, what is asked at the minimum
    later (the covariance, residuals without losses) would depend on what was asked between.
    """
    if equations.implicit is None or minimum.bad_row is not None:
        return minimum
    equations.implicit.forget(minimum.point)
    if np.isfinite(equations.residuals(minimum.point)).all():
        return minimum
    return replace(
        without_value(equations, minimum.point),
        reason=Reason.NO_FINITE_STEP,
        iterations=minimum.iterations,
        evaluations=minimum.evaluations + 1,
    )
