"""The kernels of a problem as machine code, for solvers that call them by address."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import TYPE_CHECKING

from mbm.kernels.native.engine import Library, compiled, vector_library
from mbm.kernels.types import Kernel
from mbm.machine import straight_line
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.kernels.store import Store

FAST, PLAIN = 1, 0
"""Levels of optimisation, with the same numbers to the last bit; beyond 1 there is nothing more in straight lines.

Compiling for speed takes 60 µs for each instruction (and 10 ms), four times as long as without, and saves 0.03 ns of it
for each row (`benchmarks/kernels.py`): 5 to 15 % of what a row takes."""

MANY = 50_000
"""Rows of a solve from which that pays: each is evaluated some `EVALUATIONS` times."""

EVALUATIONS = 20

LONG = 2_000
"""Instructions of a kernel that is not compiled for speed for the sake of solves to come, however many."""


def level_for(kernel: Kernel, rows: int, *, often: bool = False) -> int:
    """The level of optimisation that suits a kernel for solves of so many rows, of which many are to come if often."""
    short = len(kernel.jacobian_program.instructions) <= LONG
    return FAST if rows >= MANY or (often and short) else PLAIN


@dataclass(frozen=True, slots=True, eq=False)
class NativeKernels:
    """Addresses of functions ``void f(const double *inputs, double *outputs, int64 blocks)`` over blocks of rows.

    See `mbm.machine.straight_line`. The code lives as long as this does. Each kernel has a library and its number
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

    def of(self, kernels: Sequence[Kernel], rows: int = 0, *, often: bool = False) -> NativeKernels:
        """The code of some kernels at the levels that `level_for` says, or better; what is missing is made at once."""
        levels = [level_for(kernel, rows, often=often) for kernel in kernels]
        for level in set(levels):
            wanted = {id(k): k for k, own in zip(kernels, levels, strict=True) if own == level}
            self._make([k for key, k in wanted.items() if not self._has(key, level)], level)
        places = zip(kernels, levels, strict=True)
        found = [self._made.get((id(k), FAST)) or self._made[id(k), level] for k, level in places]
        return NativeKernels(tuple((library, number) for _, library, number in found))

    def _has(self, key: int, level: int) -> bool:
        return any((key, each) in self._made for each in {level, FAST})

    def _make(self, kernels: Sequence[Kernel], level: int) -> None:
        if not kernels:
            return
        programs = {}
        for k, kernel in enumerate(kernels):
            programs[f"values{k}"] = kernel.value_program
            programs[f"jacobian{k}"] = kernel.jacobian_program
        library = compiled(straight_line.module_of(programs, vector_library()), self.store, level)
        for k, kernel in enumerate(kernels):
            self._made[id(kernel), level] = kernel, library, k
