"""Corrections at a minimum that do not hang on the way there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.metric import first_bad
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
    residuals = equations.residuals(minimum.point)
    if np.isfinite(residuals).all():
        return minimum
    if minimum.blocks is None:
        lost = without_value(equations, minimum.point)
    else:
        # Loaded by sparse problems only, so that the others start at once.
        from mbm.sparse.system import without_slopes

        lost = replace(without_slopes(minimum), residuals=residuals, cost=np.nan, bad_row=first_bad(residuals))
    return replace(
        lost,
        reason=Reason.NO_FINITE_STEP,
        iterations=minimum.iterations,
        evaluations=minimum.evaluations + 1,
        offset=np.inf,
    )
