"""The kernels of a problem as machine code, for solvers that call them by address."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import TYPE_CHECKING

from mbm.kernels.native.engine import Library, compiled
from mbm.kernels.native.processor import vector_library
from mbm.kernels.types import Kernel
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


@dataclass(frozen=True, slots=True, eq=False)
class NativeKernels:
    """Addresses of functions ``void f(const double *inputs, double *outputs, int64 blocks)`` over blocks of rows.

    See `mbm.machine.blocks_of_rows`. The code lives as long as this does. Each kernel has a library and its number
    there.
    """

    _places: tuple[tuple[Library, int], ...]

    def values_address(self, k: int) -> int:
        """Of what gives the values of kernel ``k``."""
        library, number = self._places[k]
        return library.address(f"values{number}")

    def jacobian_address(self, k: int) -> int:
        """Of what gives the values of kernel ``k`` and behind them the nonzeros of the Jacobian."""
        library, number = self._places[k]
        return library.address(f"jacobian{number}")


@dataclass(frozen=True, slots=True, eq=False)
class KernelCode:
    """Kernels as machine code, made once for each and level; object code is kept in ``store``.

    Local to one compiled problem in one thread.
    """

    store: Store | None
    _made: dict[tuple[int, int], tuple[Kernel, Library, int]] = field(default_factory=dict, init=False, repr=False)

    def of(self, kernels: Sequence[Kernel], rows: int = 0) -> NativeKernels:
        """The code of some kernels; what is missing is made, in one library.

        ``rows``: about how many rows a solve has; many are worth better code.
        """
        levels = [level_for(kernel, rows) for kernel in kernels]
        for level in set(levels):
            missing = {id(k): k for k, own in zip(kernels, levels, strict=True) if own == level}
            self._make([k for key, k in missing.items() if (key, level) not in self._made], level)
        found = [self._made[id(kernel), level] for kernel, level in zip(kernels, levels, strict=True)]
        return NativeKernels(tuple((library, number) for _, library, number in found))

    def _make(self, kernels: Sequence[Kernel], level: int) -> None:
        if not kernels:
            return
        programs = {}
        for k, kernel in enumerate(kernels):
            programs[f"values{k}"] = kernel.value_program
            programs[f"jacobian{k}"] = kernel.jacobian_program
        library = compiled(blocks_of_rows.module_of(programs, vector_library()), self.store, level)
        for k, kernel in enumerate(kernels):
            self._made[id(kernel), level] = kernel, library, k
