"""The end of a constrained search as the answer that every solver gives."""

from __future__ import annotations

import numpy as np

from mbm.solution.constrained.linearise import met
from mbm.solution.constrained.minimise import Constrained
from mbm.solution.constrained.types import ConstrainedEquations, Linearised
from mbm.solution.metric import first_bad
from mbm.solution.types import ConstraintState, Floats, Mask, Minimum, Reason
from mbm.target.decisions import MET, PUSHED


def minimum_of(equations: ConstrainedEquations, found: Constrained) -> Minimum:
    """The answer, with the constraints as they stand there."""
    state, place = found.state, found.state.place
    reason, bad_row = found.reason, None
    if reason is Reason.NOT_FINITE_AT_START:
        bad_row = first_bad(np.concatenate([place.residuals, place.values]))
        if bad_row is None:
            reason = Reason.JACOBIAN_NOT_FINITE_AT_START
            bad_row = first_bad(np.vstack([place.jacobian, place.slopes]))
    usable = bad_row is None
    return Minimum(
        point=place.point,
        residuals=place.residuals,
        jacobian=place.jacobian if usable else np.zeros_like(place.jacobian),
        cost=place.cost,
        reason=reason,
        iterations=found.iterations,
        evaluations=found.evaluations,
        offset=state.offset,
        at_bound=_sides(equations, place, state.bounds),
        bad_row=bad_row,
        constraints=constraint_state(equations.equality, place, state.multipliers, found),
    )


def constraint_state(
    equality: Mask, place: Linearised, multipliers: Floats, found: Constrained | None = None
) -> ConstraintState:
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
        conflict=None if found is None else found.conflict,
    )


def _sides(equations: ConstrainedEquations, place: Linearised, bounds: Floats) -> np.ndarray:
    """-1 and +1 for coordinates that their lower or upper bound holds, else 0 (n,)."""
    pushed = np.abs(bounds) / place.scale > PUSHED
    x = equations.coordinates(place.point)
    low = pushed & (bounds < 0.0) & ((x <= equations.lower) | equations.positive)
    high = pushed & (bounds > 0.0) & (x >= equations.upper)
    return np.where(low, -1, np.where(high, 1, 0)).astype(np.int8)
