"""Starts for unknowns without one: where the equations are affine in them, linear least squares given the others."""

from __future__ import annotations

import numpy as np

from mbm.problem import faults
from mbm.solution.assembly import Assembled, affine
from mbm.solution.layout import Layout
from mbm.solution.types import Floats, Indices
from mbm.text.types import MbmError


def completed(equations: Assembled, free: Indices) -> Floats:
    """The vector of all numbers (N,) with every start known.

    Raises:
        MbmError: an unknown without a start that enters nonlinearly, or is fixed at nothing.

    """
    layout = equations.layout
    numbers = layout.start.copy()
    missing = np.isnan(numbers)
    if not bool(missing.any()):
        return numbers
    is_free = np.zeros(len(numbers), dtype=bool)
    is_free[free] = True
    _refuse(layout, missing & layout.fixed)
    estimated = missing & is_free
    numbers[estimated] = 0.0  # members that no equation mentions stay without a value
    if not bool(estimated.any()):
        return numbers
    wrong = np.zeros(len(numbers), dtype=bool)
    for group in equations.groups:
        if not affine(group, estimated):
            columns = np.unique(group.kernel.jacobian_columns)
            touched = np.unique(group.index[:, columns])
            wrong[touched[estimated[touched]]] = True
    _refuse(layout, wrong)
    partial = equations.freed(np.flatnonzero(estimated), numbers)
    at_zero = numbers[partial.free]
    residuals, jacobian = partial.residuals(at_zero), partial.jacobian(at_zero)
    usable = np.isfinite(residuals) & np.isfinite(jacobian).all(axis=1)
    scale = np.linalg.norm(jacobian[usable], axis=0)
    scale[scale == 0] = 1.0
    solution = np.linalg.lstsq(jacobian[usable] / scale, -residuals[usable], rcond=None)[0] / scale
    positive = layout.positive[partial.free]
    solution[positive] = np.where(solution[positive] > 0, solution[positive], 1.0)
    numbers[partial.free] = solution
    return numbers


def _refuse(layout: Layout, wrong: np.ndarray) -> None:
    if bool(wrong.any()):
        unknowns = [e.unknown for e in layout.entries if bool(wrong[e.range].any())]
        raise MbmError(*(faults.missing_start(u.span, u.name) for u in unknowns))
