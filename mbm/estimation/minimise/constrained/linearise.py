"""A point of a constrained problem to first order, in units that do not depend on how the constraints are written."""

from __future__ import annotations

import numpy as np

from mbm.equations.metric import column_norms, magnitudes, scale_of
from mbm.equations.types import Floats, Mask
from mbm.estimation.minimise.constrained.types import ConstrainedEquations, Linearised
from mbm.solver.decisions import EPSILON, MET, ROUNDING_ERRORS, rounding_of_norm


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


def violations(values: Floats, equality: Mask) -> Floats:
    """How far each constraint is from being met, shape (k,) >= 0."""
    return np.where(equality, np.abs(values), np.maximum(values, 0.0))


def met(here: Linearised, equality: Mask, share: float = MET) -> Mask:
    """Which constraints hold, as far as anybody can tell, shape (k,)."""
    return np.asarray(violations(here.values, equality) <= share * here.unit + here.rounding, dtype=bool)
