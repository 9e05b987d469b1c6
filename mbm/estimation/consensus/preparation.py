"""What robust estimation does before the minimisation, and what it says of the rows afterwards."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mbm.equations.assembly import Assembled, loss_lines
from mbm.equations.losses import loss_weights
from mbm.equations.types import Floats, Mask, Minimum
from mbm.estimation.consensus.types import Checked, Prepared
from mbm.estimation.search.starting import Beginning
from mbm.estimation.settings import Settings
from mbm.problem.types import Problem


def prepared(
    problem: Problem,
    equations: Assembled,
    settings: Settings,
    starts: Callable[[], tuple[Beginning, ...]],
    checked: Checked,
) -> Prepared:
    """The equations that count, and better starts; what ``starts`` finds where nothing is robust.

    Raises:
        MbmError: no start is known and none can be found.

    """
    if settings.robust is None and not equations.lossy:
        return Prepared(equations=equations, starts=starts())
    # Here and below: loaded by robust problems only, so that the others start at once.
    from mbm.estimation.consensus.consensus import agreeing, scaled

    if settings.robust is not None:
        return agreeing(problem, equations, settings, settings.robust, starts, checked)
    return scaled(problem, equations, settings, starts, checked)


def outliers(equations: Assembled, whole: Floats) -> Mask | None:
    """Which residuals (all,) belong to units left out, or beyond three deviations under a loss; None if neither is.

    ``whole`` (all residuals,) are plain and whitened with the final noise.
    """
    if equations.rows is None and not equations.lossy:
        return None
    from mbm.estimation.consensus.units import outlying

    found = outlying(loss_lines(equations.everything()), whole)
    if equations.rows is not None:
        found |= ~np.isin(np.arange(equations.whole), equations.rows)
    return found


def unit_weights(equations: Assembled, whole: Floats) -> Floats | None:
    """What each residual (all of them) counted: 0 where it was left out, ρ' under a loss; None if all counted fully."""
    if equations.rows is None and not equations.lossy:
        return None
    found = loss_weights(loss_lines(equations.everything()), whole)
    if equations.rows is not None:
        counted = np.zeros(equations.whole)
        counted[equations.rows] = 1.0
        found *= counted
    return found


def robust_cost(equations: Assembled, minimum: Minimum) -> float | None:
    """``Σ ρ`` at the minimum, without what is no part of χ²; None without losses."""
    left = equations.uncounted
    if left is None or not equations.lossy:
        return minimum.cost if equations.lossy else None
    return minimum.cost - float(np.square(minimum.residuals[left]).sum())
