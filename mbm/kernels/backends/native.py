"""Machine code made by LLVM in this process: four rows at a time, no Python and no interpreter per row."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import field
from typing import TYPE_CHECKING

import numpy as np

from mbm.kernels.native.engine import Library, hindrance, kept
from mbm.kernels.native.kernels import KernelCode, NativeKernels
from mbm.kernels.native.sources import lowered, source_digest
from mbm.kernels.types import BackendUnavailableError, Evaluation, Floats, Kernel, MachineCode, Stream
from mbm.machine.kinds import LANES
from mbm.machine.records import address
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.kernels.store import Store

PORTION = 16
"""Blocks that are evaluated at a time: their inputs and outputs stay in the cache."""

_LEVEL = 1
_SIGNATURE = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64, *[ctypes.c_void_p] * 4)


def _tables_text() -> str:
    """The IR of what evaluates kernels over tables."""
    from mbm.solver.modules import tables_module

    return lowered(tables_module(LANES))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Stream:
    """A kernel for any number of rows; ``run`` is `mbm.solver.tables.evaluate_rows`, ``held`` keeps its code alive."""

    inputs: int
    outputs: int
    nonzeros: int
    code: NativeKernels
    run: Callable[..., int]
    held: Library

    def values(self, inputs: Floats) -> Floats:
        """The outputs (rows, outputs) at inputs (rows, variables + parameters)."""
        return self._evaluated(self.code.values_address(0), inputs, 0)[0]

    def values_and_jacobian(self, inputs: Floats) -> tuple[Floats, Floats]:
        """The outputs (rows, outputs) and the nonzeros of their Jacobian (rows, nonzeros)."""
        return self._evaluated(self.code.jacobian_address(0), inputs, self.nonzeros)

    def _evaluated(self, kernel: int, inputs: Floats, nonzeros: int) -> tuple[Floats, Floats]:
        rows = len(inputs)
        portion = min(PORTION, -(-rows // LANES))
        given = np.ascontiguousarray(inputs, dtype=np.float64)
        values, slopes = np.empty((rows, self.outputs)), np.empty((rows, nonzeros))
        work = np.empty(portion * LANES * (self.inputs + self.outputs + nonzeros))
        table = np.array([kernel, self.inputs, self.outputs, nonzeros, portion], dtype=np.int64)
        self.run(address(table), rows, *(address(array) for array in (given, values, slopes, work)))
        return values, slopes


@dataclass(slots=True, eq=False)
class _Evaluation:
    """A kernel for the rows of a table; its code is made when it is first asked for."""

    inputs: Floats
    _made: Callable[[], Stream]
    _stream: Stream | None = None

    @property
    def _code(self) -> Stream:
        if self._stream is None:
            self._stream = self._made()
        return self._stream

    def values(self) -> Floats:
        return self._code.values(self.inputs)

    def values_and_jacobian(self) -> tuple[Floats, Floats]:
        return self._code.values_and_jacobian(self.inputs)


@dataclass(frozen=True, slots=True, eq=False)
class NativeBackend(MachineCode):
    """Kernels as machine code; object code is kept in ``store``.

    Local to one compiled problem in one thread: what was compiled is kept in ``code``.
    """

    code: KernelCode = field(init=False, repr=False)
    _tables: list[Library] = field(default_factory=list, init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "code", KernelCode(self.store))

    def prepare(self, kernel: Kernel, rows: int) -> Evaluation:
        """A table for ``rows`` rows."""
        inputs = np.zeros((rows, len(kernel.jacobian_program.inputs)))
        return _Evaluation(inputs, lambda: self._stream(kernel, rows))

    def stream(self, kernel: Kernel) -> Stream:
        """The kernel for points by the thousand."""
        return self._stream(kernel, 0)

    def _stream(self, kernel: Kernel, rows: int) -> Stream:
        """The kernel, whose machine code is made now if it has none that suits so many rows."""
        if not self._tables:
            name = f"tables {source_digest('solver')}"
            self._tables.append(kept(name, _tables_text, self.store, _LEVEL, loops=False))
        return _Stream(
            inputs=len(kernel.jacobian_program.inputs),
            outputs=kernel.outputs,
            nonzeros=len(kernel.jacobian_rows),
            code=self.code.of([kernel], rows),
            run=_SIGNATURE(self._tables[0].address("evaluate_rows")),
            held=self._tables[0],
        )


def backend(store: Store | None) -> NativeBackend:
    """The backend that keeps its object code in ``store``.

    Raises:
        BackendUnavailableError: no machine code can be made here.
    """
    reason = hindrance(store)
    if reason is not None:
        raise BackendUnavailableError(reason)
    return NativeBackend(store)
