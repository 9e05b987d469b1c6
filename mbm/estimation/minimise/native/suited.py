"""Which equations the native solver takes, and which of them alike."""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.estimation.minimise.native.packing import triangle_kind

MOST_COORDINATES = 80
"""Beyond, calling kernels gains a fifth at most over asking for all residuals at once, and a batch loses by it: what it
says of each answer takes longer than LAPACK does."""


def handled(equations: object) -> bool:
    """Whether equations are such as the native solver knows."""
    if not isinstance(equations, Assembled) or equations.implicit is not None or equations.dimension == 0:
        return False
    if equations.dimension > MOST_COORDINATES or equations.count == 0 or equations.structure is not None:
        return False
    groups = (*equations.groups, *equations.constraints)
    if any(group.sampled for group in groups) or not all(group.kernel.outputs for group in groups):
        return False
    if equations.rows is not None and not _whole_units(equations):
        return False
    return all(triangle_kind(w) is not None for group in groups for w in group.whiteners)


def _whole_units(equations: Assembled) -> bool:
    """Whether the residuals picked are all those of some units."""
    units = equations.every_unit
    sizes = np.bincount(units)
    found = np.bincount(units[equations.rows], minlength=len(sizes))
    return bool(((found == 0) | (found == sizes)).all())


def alike(some: Assembled, others: Assembled) -> bool:
    """Whether the native solver takes equations as it does others, which it takes: they have as many rows of the same
    kernels, and depend on the same coordinates in the same way. What is not looked at closely is not alike.
    """
    known = bool(some._scatters) and some._scatters is others._scatters and some.free is others.free
    if not known or some.layout is not others.layout:
        return False
    if any(e.rows is not None or e.implicit is not None or e.structure is not None for e in (some, others)):
        return False
    first, second = (*some.groups, *some.constraints), (*others.groups, *others.constraints)
    same = len(first) == len(second) and np.array_equal(some.equality, others.equality)
    return same and all(
        a.kernel is b.kernel
        and len(a.index) == len(b.index)
        and a.losses == b.losses
        and len(a.whiteners) == len(b.whiteners)
        and all(
            u is v or (u.weights.ndim == v.weights.ndim == 2 and u.last == v.last)
            for u, v in zip(a.whiteners, b.whiteners, strict=True)
        )
        for a, b in zip(first, second, strict=True)
    )
