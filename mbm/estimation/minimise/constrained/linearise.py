"""A point of a constrained problem to first order, in units that do not depend on how the constraints are written.

Beside it the constraints at the end of a search.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.metric import column_norms, first_bad, magnitudes, scale_of, violations
from mbm.equations.types import ConstraintState, Floats, Mask, Minimum, Reason
from mbm.estimation.minimise.constrained.types import ConstrainedEquations, Linearised
from mbm.estimation.minimise.native.minimum import without_value
from mbm.solver.decisions import EPSILON, MET, PUSHED, ROUNDING_ERRORS, rounding_of_norm


@np.errstate(all="ignore")
def linearise(equations: ConstrainedEquations, x: Floats) -> Linearised:
    """Everything at ``x``."""
    jacobian = equations.jacobian(x)
    return first_order(equations, x, equations.residuals(x), jacobian, column_norms(jacobian))


@np.errstate(all="ignore")
def first_order(
    equations: ConstrainedEquations, x: Floats, residuals: Floats, jacobian: Floats, norms: Floats
) -> Linearised:
    """The same with residuals (m,) and Jacobian (m, n) that are known, whose columns have the ``norms`` (n,)."""
    values, slopes = equations.constraint_values(x), equations.constraint_jacobian(x)
    scale = scale_of(norms, slopes)
    size = magnitudes(equations, equations.coordinates(x))
    terms = norms * size
    noise = rounding_of_norm(float(terms @ terms), float(residuals @ residuals))
    lengths = np.sqrt(np.square(slopes / scale).sum(axis=1))
    return Linearised(
        point=x,
        residuals=residuals,
        jacobian=jacobian,
        values=values,
        slopes=slopes,
        scale=scale,
        unit=np.where(lengths > 0.0, lengths, 1.0),
        rounding=ROUNDING_ERRORS * EPSILON * (np.abs(slopes) @ size + np.abs(values)),
        noise=noise,
    )


def met(here: Linearised, equality: Mask, share: float = MET) -> Mask:
    """Which constraints hold, as far as anybody can tell, shape (k,)."""
    return np.asarray(violations(here.values, equality) <= share * here.unit + here.rounding, dtype=bool)


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
