"""Which groups of equations have their normal equations summed by a function of their own, and those functions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from mbm.equations.binding import Group
from mbm.estimation.native.code import NativeCode
from mbm.kernels.native.kernels import LONG

if TYPE_CHECKING:
    from mbm.kernels.native.normal import NormalKernels
    from mbm.kernels.store import Store

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
