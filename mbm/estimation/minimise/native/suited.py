"""Which equations the native solver takes, which of them alike, and which have sums by a function of their own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.estimation.minimise.native.packing import triangle_kind
from mbm.estimation.native.code import NativeCode
from mbm.kernels.native.kernels import LONG

if TYPE_CHECKING:
    from mbm.kernels.native.normal import NormalKernels
    from mbm.kernels.store import Store


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


MOST_TANGENTS = 16
"""Beyond, the sums of a block of rows do not stay in the nearest cache, and take long to compile."""


def summable(group: Group) -> bool:
    """Whether `description.BLOCK_NORMAL` may be there for a group, and pays where it has many rows."""
    kernel = group.kernel
    if not (group.whiteners and all(group.shared_columns)) or len(kernel.tangents) > MOST_TANGENTS:
        return False
    if len(kernel.jacobian_program.instructions) > LONG:
        return False
    ends = [0, *(whitener.last for whitener in group.whiteners)]
    in_order = all(whitener.first == end for whitener, end in zip(group.whiteners, ends, strict=False))
    plain = all(whitener.weights.ndim == 2 for whitener in group.whiteners)
    with_loss = [loss is not None for loss in group.losses]
    return in_order and plain and ends[-1] == kernel.outputs and (all(with_loss) or not any(with_loss))


def sum_addresses(code: NativeCode, groups: Sequence[Group | None]) -> list[int]:
    """Addresses of the functions that sum the normal equations of groups; 0 where None is asked for."""
    found = []
    for group in groups:
        if group is None:
            found.append(0)
            continue
        key = (group.number, tuple(None if loss is None else loss.kind for loss in group.losses))
        if key not in code.sums:
            code.sums[key] = _sums_of(group, code.store)
        found.append(code.sums[key].normal_address(0))
    return found


def _sums_of(group: Group, store: Store | None) -> NormalKernels:
    """The function of one group under the number 0."""
    from mbm.kernels.native.normal import Unit, normal_kernels
    from mbm.solver.description import NO_LOSS

    losses = [NO_LOSS if loss is None else loss.number for loss in group.losses]
    losses = losses or [NO_LOSS] * len(group.whiteners)
    units = [Unit(first=w.first, last=w.last, loss=k) for w, k in zip(group.whiteners, losses, strict=True)]
    return normal_kernels({0: group.kernel}, {0: tuple(units)}, store)
