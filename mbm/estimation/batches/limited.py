"""Hard limits of single coordinates in many solves, by the formulas of `intervals.limits`."""

from __future__ import annotations

import numpy as np

from mbm.equations.binding import affine
from mbm.equations.spreads import Limited
from mbm.equations.types import Floats
from mbm.estimation.batches.factor import Spread
from mbm.estimation.batches.portion import Portion
from mbm.estimation.batches.surface import Held
from mbm.estimation.coverage.limits import Lines, box, narrow, released, single_limits


@np.errstate(all="ignore")
def limited_columns(
    portion: Portion, found: Held | None, points: Floats, jacobian: Floats, spread: Spread, residuals: Floats
) -> Limited | None:
    """The limits at the ends ``points`` (K, N) of K solves; None where there are none.

    ``jacobian`` (K, m, n) and ``residuals`` (K, m) are whitened there, and the basis of the ``spread`` is orthonormal.
    Estimates at bounds are no matter of columns.
    """
    equations = portion.equations
    shape = (portion.count, equations.dimension)
    lower, upper = (np.broadcast_to(each, shape).copy() for each in box(equations))
    held, tied = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
    if found is not None:
        plain = np.zeros(len(equations.layout.number), dtype=bool)
        plain[equations.free] = True
        exact = np.zeros(found.there.shape, dtype=bool)
        for group, solve, slots in portion.limits():
            exact[solve[:, None], slots] = affine(group, plain)
        single, owner = single_limits(found.slopes, exact & found.there & ~found.equality)
        places = equations.layout.number[equations.free]
        place = np.where(places >= 0, points[:, places], 0.0)
        held = narrow(lower, upper, place, Lines(found.values, found.slopes, found.forcing, single, owner))
        tied = ((found.slopes != 0.0) & found.equality[:, :, None]).any(axis=1)
    if not (held.any() or np.isfinite(lower).any() or np.isfinite(upper).any()):
        return None
    step, sigma = np.full(shape, np.inf), np.full(shape, np.nan)
    if held.any() and not equations.lossy:
        step, sigma = released(jacobian, spread.basis, residuals)
        step, sigma = np.where(tied, np.inf, step), sigma * spread.deviation[:, None]
    return Limited(lower=lower, upper=upper, step=np.where(held, step, np.nan), sigma=np.where(held, sigma, np.nan))
