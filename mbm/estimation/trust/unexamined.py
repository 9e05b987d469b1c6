"""What was not looked at of intervals, and why: whoever relies on them should know."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import affine
from mbm.equations.surface import on_surface, plainly_affine
from mbm.equations.types import Minimum
from mbm.estimation.search.solution import DerivedSolution
from mbm.estimation.trust.curvature import MOST_DERIVED, Curvature
from mbm.estimation.trust.nonlinearity import MOST_COORDINATES, too_much
from mbm.estimation.uncertainty.derived import Propagation
from mbm.estimation.uncertainty.observability import limited

CURVATURE = "curvature"
"""The name of what is not examined at all; that of one quantity is called `curvature of NAME`."""


BESIDE_LIMITS = "intervals beside limits"
"""The name of what is not followed where limits hold an estimate."""

SPARSE = "the problem was solved with sparse matrices"

MOST_WORK = 3e5
"""Residuals times the square of the coordinates beyond which profiles beside limits would take more than seconds."""


def unexamined(
    propagation: Propagation, minimum: Minimum, derived: tuple[DerivedSolution, ...], found: Curvature | None
) -> Mapping[str, str]:
    """Reasons by what was not examined; nothing where no minimum was reached."""
    if not minimum.reason.converged:
        return {}
    return {**_curvature(propagation, minimum, derived, found), **_beside_limits(propagation, minimum)}


def _beside_limits(propagation: Propagation, minimum: Minimum) -> Mapping[str, str]:
    """The same of intervals beside what limits hold; nothing where they hold nothing."""
    outcome = propagation.outcome
    if not limited(outcome.observed):
        return {}
    why = unfollowed(outcome.influence.equations, minimum)
    if why is not None:
        return {BESIDE_LIMITS: why}
    equations = propagation.equations
    layout = equations.layout
    free = np.zeros(len(layout.number), dtype=bool)
    free[equations.free] = layout.number[equations.free] < 0
    return {
        f"{BESIDE_LIMITS} of {entry.unknown.name}": "of what turns only the linear intervals are known"
        for entry in layout.entries
        if bool(free[entry.coordinates].any())
    }


def unfollowed(equations: Assembled, minimum: Minimum) -> str | None:
    """Why nobody follows intervals to where estimates leave the limits that hold them; None: somebody does."""
    if minimum.blocks is not None:
        return SPARSE
    if equations.lossy:
        return "the cost of losses is no likelihood"
    if not equations.likely and equations.count * equations.dimension**2 > MOST_WORK:
        return "too many rows for so many unknowns"
    return None


def _curvature(
    propagation: Propagation, minimum: Minimum, derived: tuple[DerivedSolution, ...], found: Curvature | None
) -> Mapping[str, str]:
    """Reasons by what of the curvature was not examined; nothing where the model is linear."""
    if found is not None and not derived:
        return {}
    equations = propagation.equations
    straight = plainly_affine(equations) and (minimum.blocks is not None or on_surface(equations, minimum) is None)
    bent = [one for one in derived if not (straight and _affine(propagation, one.owner))]
    if found is not None:
        looked_at = {one.owner for one in found.derived}
        return {
            f"{CURVATURE} of {propagation.problem.derived[one.owner].name}": _why(propagation, one)
            for one in bent
            if one.owner not in looked_at and bool((one.sigma > 0.0).any())
        }
    if straight and not bent:
        return {}
    why = _why_nothing(propagation, minimum)
    return {} if why is None else {CURVATURE: why}


def _affine(propagation: Propagation, owner: int) -> bool:
    """Whether a derived quantity depends linearly on the estimates."""
    moving = propagation.equations.is_free
    return all(affine(group, moving) for group in propagation.binder.derived(propagation.kernels, owner))


def _why(propagation: Propagation, one: DerivedSolution) -> str:
    stated = propagation.problem.derived[one.owner]
    if stated.kind is not None:
        return f"of a {stated.kind.value} only the linear intervals are known"
    if one.sigma.size > MOST_DERIVED:
        return f"more than {MOST_DERIVED} derived numbers"
    return "it is one of too many derived numbers"


def _why_nothing(propagation: Propagation, minimum: Minimum) -> str | None:
    """None where the covariance is not that of these equations alone: noises estimated of a subset, no unknowns."""
    estimated = propagation.outcome.covariance
    if minimum.blocks is not None:
        return SPARSE
    if too_much(estimated.factor.shape[1] if estimated.factor.ndim == 2 else 0, minimum.residuals.shape[0]):
        return f"more than {MOST_COORDINATES} unknowns, or too many rows for so many unknowns"
    if propagation.equations.lossy:
        return "the losses leave too little of the rows"
    return None
