"""Constraints that no point meets → the smallest set of them that contradict one another.

Where the violations are least, those that remain and the bounds that hold there are a contradiction (the multipliers
of the minimum prove it for the linearised constraints). The deletion filter (Chinneck and Dravnieks 1991) then leaves
one out at a time: what can be left out without making the rest feasible belongs not to the set.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Conflict, Floats, Minimum
from mbm.estimation.minimise.constrained.types import ConstrainedEquations
from mbm.estimation.minimise.constrained.violation import STILL, Violations, least_violation

LARGEST = 200
"""Members of a contradiction that are tried one by one; of more, all that take part are named."""


def conflict_at(equations: ConstrainedEquations, least: Minimum, unit: Floats, limit: int) -> Conflict:
    """The contradiction seen at the point ``least`` of least violation."""
    values = equations.constraint_values(least.point) / unit
    remaining = np.where(equations.equality, np.abs(values), values) > STILL
    members = [("constraint", int(i)) for i in np.flatnonzero(remaining)]
    members += [("lower", int(j)) for j in np.flatnonzero((least.at_bound < 0) & np.isfinite(equations.lower))]
    members += [("upper", int(j)) for j in np.flatnonzero(least.at_bound > 0)]
    smallest = len(members) <= LARGEST
    if smallest and not _impossible(equations, members, least.point, unit, limit):
        members += [("constraint", int(i)) for i in np.flatnonzero(~remaining)]
        smallest = len(members) <= LARGEST
    if smallest:
        for member in tuple(members):
            others = [m for m in members if m != member]
            if others and _impossible(equations, others, least.point, unit, limit):
                members = others
    return Conflict(
        constraints=tuple(i for kind, i in members if kind == "constraint"),
        lower=tuple(i for kind, i in members if kind == "lower"),
        upper=tuple(i for kind, i in members if kind == "upper"),
        smallest=smallest,
    )


def _impossible(
    equations: ConstrainedEquations, members: list[tuple[str, int]], point: Floats, unit: Floats, limit: int
) -> bool:
    """Whether no point near ``point`` meets the constraints and bounds ``members``."""
    chosen = np.array([i for kind, i in members if kind == "constraint"], dtype=np.int64)
    if not chosen.size:
        return False
    lower, upper = np.full(equations.dimension, -np.inf), np.full(equations.dimension, np.inf)
    for kind, i in members:
        if kind == "lower":
            lower[i] = equations.lower[i]
        elif kind == "upper":
            upper[i] = equations.upper[i]
    part = Violations(equations=equations, chosen=chosen, unit=unit[chosen], lower=lower, upper=upper)
    return not bool((np.abs(least_violation(part, point, limit).residuals) <= STILL).all())
