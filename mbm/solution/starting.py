"""Where a solve begins: the starts that are given, and for unknowns without one what the equations themselves tell.

Where the equations are affine in the unknowns without a start, that is linear least squares given the others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbm.problem import faults
from mbm.solution.assembly import Assembled
from mbm.solution.binding import affine
from mbm.solution.layout import Layout
from mbm.solution.settings import Settings
from mbm.solution.types import Floats, Mask
from mbm.text.types import MbmError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beginning:
    """A point (N,) to start from, and where it came from in words."""

    point: Floats
    origin: str


def beginnings(equations: Assembled, settings: Settings) -> tuple[Beginning, ...]:
    """The points to start from, the most promising first; at least one.

    Raises:
        MbmError: an unknown without a start that enters nonlinearly, or is fixed at nothing.

    """
    layout = equations.layout
    missing = layout.missing()
    if not bool(missing.any()):
        return (Beginning(point=layout.start, origin="the initial values"),)
    numbers = layout.start.copy()
    is_free = np.zeros(len(missing), dtype=bool)
    is_free[equations.free] = True
    _refuse(layout, missing & layout.fixed)
    estimated = missing & is_free
    plain = layout.number >= 0
    numbers[layout.number[missing & plain]] = 0.0  # members that no equation mentions stay without a value
    for curved in layout.curved:
        idle = ~estimated[curved.coordinates].any(axis=1) & np.isnan(numbers[curved.numbers]).any(axis=1)
        numbers[curved.numbers[idle]] = np.eye(curved.piece.size)[0]
    if not bool(estimated.any()):
        return (Beginning(point=numbers, origin="the initial values"),)
    wrong = estimated & ~plain
    for group in equations.groups:
        if not affine(group, estimated):
            columns = np.unique(group.kernel.jacobian_columns)
            touched = np.unique(group.columns[:, columns])
            wrong[touched[estimated[touched]]] = True
    _refuse(layout, wrong)
    partial = equations.freed(np.flatnonzero(estimated), numbers)
    residuals, jacobian = partial.residuals(numbers), partial.jacobian(numbers)
    usable = np.isfinite(residuals) & np.isfinite(jacobian).all(axis=1)
    scale = np.linalg.norm(jacobian[usable], axis=0)
    scale[scale == 0] = 1.0
    solution = np.linalg.lstsq(jacobian[usable] / scale, -residuals[usable], rcond=None)[0] / scale
    positive = layout.positive[partial.free]
    solution[positive] = np.where(solution[positive] > 0, solution[positive], 1.0)
    return (Beginning(point=partial.placed(numbers, solution), origin="linear least squares"),)


def _refuse(layout: Layout, wrong: Mask) -> None:
    if bool(wrong.any()):
        unknowns = [e.unknown for e in layout.entries if bool(wrong[e.coordinates].any())]
        raise MbmError(*(faults.missing_start(u.span, u.name) for u in unknowns))
