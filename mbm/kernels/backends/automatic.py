"""The default: machine code where it can be made; else CasADi's virtual machine for few rows, NumPy for many."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from mbm.kernels.types import Backend, Evaluation, Kernel, KernelSet, Stream, Tabulated, WithoutMachineCode
from mbm.machine.program import Program
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.kernels.store import Store

MANY = 192
"""Rows from which NumPy is faster, for short and long kernels alike (`benchmarks/kernels.py`): it pays for each
instruction once per block of rows, CasADi once per row."""


MOST_KERNELS, MOST_INSTRUCTIONS = 64, 20_000
"""Kernels of one problem that machine code is made for, and instructions in all of them: a kernel takes some 20 ms to
compile, an instruction twice 20 µs, which solves of so many groups of rows do not give back."""


@dataclass(frozen=True, slots=True, eq=False)
class InterpretingBackend(WithoutMachineCode):
    """CasADi or NumPy, whichever is faster for the number of rows: what there is where no machine code can be made."""

    def prepare(self, kernel: Kernel, rows: int) -> Evaluation:
        """Buffers for ``rows`` rows of the backend that suits them."""
        from mbm.kernels.backends import casadi_map, numpy_stream

        interpreter = numpy_stream.BACKEND if rows >= MANY else casadi_map.BACKEND
        return interpreter.prepare(kernel, rows)

    def stream(self, kernel: Kernel) -> Stream:
        """The kernel for points by the thousand, by NumPy."""
        from mbm.kernels.backends import numpy_stream

        return numpy_stream.BACKEND.stream(kernel)

    def tabulated(self, programs: Mapping[str, Program]) -> Mapping[str, Tabulated]:
        """By NumPy."""
        from mbm.kernels.backends import numpy_stream

        return numpy_stream.tabulated(programs)


def backend(store: Store | None) -> Backend:
    """The backend that suits this machine; ``store`` keeps what it compiles."""
    from mbm.kernels.backends.native import NativeBackend
    from mbm.kernels.native.engine import hindrance

    reason = hindrance(store)
    return NativeBackend(store=store, name="auto") if reason is None else InterpretingBackend(reason, store=store)


def suited(chosen: Backend, kernels: KernelSet) -> Backend:
    """The ``chosen`` backend for a problem; the default one makes no machine code where compiling does not pay."""
    if chosen.name != "auto" or isinstance(chosen, WithoutMachineCode):
        return chosen
    count = len(kernels.kernels)
    length = sum(len(kernel.jacobian_program.instructions) for kernel in kernels.kernels)
    if count <= MOST_KERNELS and length <= MOST_INSTRUCTIONS:
        return chosen
    reason = f"{count} kernels with {length} instructions take longer to compile than to solve"
    return InterpretingBackend(reason, store=getattr(chosen, "store", None))
