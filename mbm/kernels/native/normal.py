"""Normal equations of kernels as machine code: summed over the rows, without a Jacobian in memory."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

from mbm.kernels.native.engine import Library, compiled
from mbm.kernels.native.kernels import level_for
from mbm.kernels.native.normal_rows import NormalRows, Unit, function
from mbm.kernels.native.processor import vector_library
from mbm.kernels.types import Kernel
from mbm.machine.vector_text import Text
from mbm.solver.description import NO_LOSS
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.kernels.store import Store

_DECLARATION = re.compile(r'^declare .*@"?([\w.]+)"?\(.*$', re.MULTILINE)
_HEADER = re.compile(r"^(;|target ).*$", re.MULTILINE)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NormalKernels:
    """Addresses of ``void f(const double *inputs, const double *weights, const double *losses, double *sums, int64)``.

    The last argument counts blocks of rows; see `mbm.kernels.native.normal_rows`.
    """

    _library: Library

    def normal_address(self, k: int) -> int:
        """Of what sums the normal equations of kernel ``k``."""
        return self._library.address(f"normal{k}")


def normal_rows(kernel: Kernel, units: tuple[Unit, ...]) -> NormalRows:
    """What there is to sum for a kernel whose outputs fall into ``units``."""
    return NormalRows(
        program=kernel.jacobian_program,
        outputs=kernel.outputs,
        tangents=len(kernel.tangents),
        rows=tuple(int(row) for row in kernel.jacobian_rows),
        columns=tuple(int(column) for column in kernel.jacobian_columns),
        units=units,
    )


def normal_kernels(
    kernels: Mapping[int, Kernel], units: Mapping[int, tuple[Unit, ...]], store: Store | None
) -> NormalKernels:
    """Kernels by number, as machine code that sums their normal equations.

    Args:
        kernels: the kernels; the tangents of each are taken to be the same coordinates in all rows.
        units: the outputs of each kernel that belong together, with their losses.
        store: where object code is kept; None: nowhere.
    """
    text = Text(vector_library())
    for k, kernel in kernels.items():
        function(f"normal{k}", normal_rows(kernel, units[k]), text)
    if any(unit.loss != NO_LOSS for of_kernel in units.values() for unit in of_kernel):
        _add_losses(text)
    level = max((level_for(kernel, 0, often=True) for kernel in kernels.values()), default=0)
    return NormalKernels(_library=compiled(text.module(), store, level))


def _add_losses(text: Text) -> None:
    """The functions of losses, from the text that the solver has of them."""
    from llvmlite import ir

    from mbm.machine.from_python import module_of
    from mbm.machine.llvm import lower_into
    from mbm.solver.losses import root_factor, root_slope

    module = ir.Module("losses")
    lower_into(module, module_of("losses", (root_factor, root_slope), public=False))
    written = str(module)
    for found in _DECLARATION.finditer(written):
        text.declared.setdefault(found[1], found[0])
    text.lines.append(_HEADER.sub("", _DECLARATION.sub("", written)))
