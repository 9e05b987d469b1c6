"""Whether equations are for the sparse solver: asked of all problems, so that only those load it."""

from __future__ import annotations

from mbm.equations.assembly import Assembled
from mbm.equations.types import Equations
from mbm.solver.decisions import MOST_DENSE

SPARSE = 0.1
"""A row that touches more than this share of the unknowns makes the equations dense."""


def sparse_suits(equations: Equations) -> bool:
    """Whether there are many unknowns of which each equation touches few, and no constraints or errors in columns."""
    if not isinstance(equations, Assembled) or equations.dimension <= MOST_DENSE:
        return False
    if equations.constraints or equations.implicit is not None:
        return False
    return all(group.columns.shape[1] <= SPARSE * equations.dimension for group in equations.groups if group.rows)
