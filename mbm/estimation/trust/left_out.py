"""Doubts about what a loss or consensus leaves out, and what it keeps."""

from __future__ import annotations

from mbm.equations.types import Minimum
from mbm.estimation.consensus.preparation import outliers
from mbm.estimation.trust.leverage import leverage
from mbm.estimation.trust.lost import lost_track
from mbm.estimation.trust.one_sided import one_sided
from mbm.estimation.trust.swapped import swapped
from mbm.estimation.uncertainty.derived import Propagation
from mbm.text.types import Diagnostic


def of_left_out(propagation: Propagation, minimum: Minimum) -> tuple[Diagnostic, ...]:
    """Rows that others could be left out for, rows of great influence, one-sided ones, and long runs."""
    problem, equations, outcome = propagation.problem, propagation.equations, propagation.outcome
    tables, every = propagation.binder.tables, equations.everything()
    found = swapped(problem, tables, equations, minimum, outcome.influence)
    if problem.sequence is not None:
        residuals = every.plain_residuals(minimum.point)
        found += lost_track(problem, tables, equations, residuals, outliers(equations, residuals))
    if equations.lossy:
        found += leverage(problem, tables, equations, minimum, outcome.covariance)
        found += one_sided(problem, equations, equations.plain_residuals(minimum.point))
    return found
