"""The constraints at the end of a search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.metric import first_bad
from mbm.equations.types import ConstraintState, Floats, Mask, Minimum, Reason
from mbm.estimation.minimise.constrained.linearise import linearise, met
from mbm.estimation.minimise.constrained.types import ConstrainedEquations, Linearised
from mbm.estimation.minimise.native.minimum import without_value
from mbm.solver.decisions import MET, PUSHED


def constraint_state(equality: Mask, place: Linearised, multipliers: Floats) -> ConstraintState:
    """The constraints at a place where their multipliers (k,) are known."""
    usable = bool(np.isfinite(place.slopes).all())
    holds = met(place, equality)
    active = equality | (place.values >= -(MET * place.unit + place.rounding))
    pushed = multipliers * place.unit > PUSHED * (1.0 + np.sqrt(max(place.cost, 0.0)) if np.isfinite(place.cost) else 1)
    return ConstraintState(
        values=place.values,
        slopes=place.slopes if usable else np.zeros_like(place.slopes),
        multipliers=multipliers,
        equality=equality,
        violated=~holds,
        active=active,
        forcing=equality | (active & pushed),
    )


def without_constrained_value(equations: ConstrainedEquations, start: Floats) -> Minimum:
    """A start where something is not finite, with the first row that is not: of residuals, then of constraints."""
    place = linearise(equations, start)
    reason = Reason.NOT_FINITE_AT_START
    row = first_bad(np.concatenate([place.residuals, place.values]))
    if row is None:
        reason = Reason.JACOBIAN_NOT_FINITE_AT_START
        row = first_bad(np.vstack([place.jacobian, place.slopes]))
    found = without_value(equations, start)
    if row is not None:
        found = replace(found, reason=reason, bad_row=row)
    return replace(found, constraints=constraint_state(equations.equality, place, np.zeros(len(place.values))))
