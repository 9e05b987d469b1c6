"""The kernels of a problem as machine code, for solvers that call them by address."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbm.kernels.native.engine import Library, compiled
from mbm.kernels.native.processor import vector_library
from mbm.kernels.types import Kernel, KernelSet
from mbm.machine import blocks_of_rows
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.kernels.store import Store

LONG = 2_000
"""Instructions of a kernel from which it is made fast rather than running fast: compiling for speed takes 60 µs for
each instruction, four times as long as without, and saves 0.03 ns of it for each row (`benchmarks/kernels.py`)."""

MANY = 50_000
"""Rows of a solve from which that pays for itself all the same."""

FAST, PLAIN = 1, 0
"""Levels of optimisation; higher ones than 1 find nothing more in straight lines."""


def level_for(kernel: Kernel, rows: int) -> int:
    """The level of optimisation that suits a kernel for a number of rows in each solve."""
    return FAST if len(kernel.jacobian_program.instructions) <= LONG or rows >= MANY else PLAIN


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NativeKernels:
    """Addresses of functions ``void f(const double *inputs, double *outputs, int64 blocks)`` over blocks of rows.

    See `mbm.machine.blocks_of_rows`. The code lives as long as this does.
    """

    _library: Library

    def values_address(self, k: int) -> int:
        """Of what gives the values of kernel ``k``."""
        return self._library.address(f"values{k}")

    def jacobian_address(self, k: int) -> int:
        """Of what gives the values of kernel ``k`` and behind them the nonzeros of the Jacobian."""
        return self._library.address(f"jacobian{k}")


def native_kernels(kernels: KernelSet, store: Store | None, rows: int = 0) -> NativeKernels:
    """All kernels of a set as machine code in one library.

    Args:
        kernels: the kernels.
        store: where object code is kept; None: nowhere.
        rows: about how many rows a solve has; many are worth better code.
    """
    programs = {}
    for k, kernel in enumerate(kernels.kernels):
        programs[f"values{k}"] = kernel.value_program
        programs[f"jacobian{k}"] = kernel.jacobian_program
    level = min((level_for(kernel, rows) for kernel in kernels.kernels), default=PLAIN)
    text = blocks_of_rows.module_of(programs, vector_library())
    return NativeKernels(_library=compiled(text, store, level))
