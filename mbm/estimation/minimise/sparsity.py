"""Whether equations are for the sparse solver: asked of all problems, so that only those load it."""

from __future__ import annotations

from mbm.equations.assembly import Assembled
from mbm.equations.types import Equations
from mbm.solver.decisions import MOST_DENSE

SPARSE = 0.1
"""A row, or rows that share measured values with errors, that touch more than this share of the unknowns make the
equations dense."""

MOST_SLOPES = 50_000_000
"""Numbers in the dense Jacobian of the constraints: 400 MB."""


def sparse_suits(equations: Equations) -> bool:
    """Whether there are many unknowns of which each equation touches few, few constraints."""
    return touch_few(equations, MOST_DENSE)


def touch_few(equations: Equations, many: int) -> bool:
    """The same of more than so ``many`` unknowns."""
    if not isinstance(equations, Assembled) or equations.dimension <= many or equations.structure is not None:
        return False
    if len(equations.equality) * equations.dimension > MOST_SLOPES:
        return False
    if equations.implicit is not None and equations.implicit.widest > SPARSE * equations.dimension:
        return False
    groups = (*equations.groups, *equations.constraints)
    return all(group.columns.shape[1] <= SPARSE * equations.dimension for group in groups if group.rows)
