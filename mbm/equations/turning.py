"""Residuals that keep their length though the unknowns move: differences between unknowns, but none from data."""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Mask
from mbm.expression.nodes import Constant, Number
from mbm.problem.types import Equation


def may_turn(equations: Assembled) -> Mask:
    """Which residuals (m,) movements of the unknowns may turn, so that their squares have the same sum.

    A difference from data has a direction of its own, and so have the residuals of a likelihood.
    """
    parts = [
        np.zeros(group.units.size, dtype=bool)
        if group.readings is not None
        else np.tile(
            np.repeat([not _from_data(e) for e in group.equations], [len(e.components) for e in group.equations]),
            group.rows,
        )
        for group in equations.groups
    ]
    every = np.concatenate(parts) if parts else np.zeros(0, dtype=bool)
    return every if equations.rows is None else every[equations.rows]


def _from_data(equation: Equation) -> bool:
    zero = (isinstance(each, Number | Constant) and each.value == 0 for each in equation.measured or ())
    return equation.placed or not all(zero)
