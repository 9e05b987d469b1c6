"""Machine code made by LLVM in this process: four rows at a time, no Python and no interpreter per row."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from dataclasses import field
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mbm.kernels.native.engine import Library, compiled, fetched, hindrance, kept, vector_library
from mbm.kernels.native.kernels import EVALUATIONS, FAST, MANY, PLAIN, KernelCode, NativeKernels
from mbm.kernels.native.sources import source_digest
from mbm.kernels.types import BackendUnavailableError, Evaluation, Floats, Kernel, MachineCode, Stream, Tabulated
from mbm.machine import straight_line
from mbm.machine.kinds import LANES
from mbm.machine.program import Program
from mbm.machine.records import address
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.kernels.store import Store

PORTION = 16
"""Blocks that are evaluated at a time: their inputs and outputs stay in the cache."""

_SIGNATURE = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64, *[ctypes.c_void_p] * 4)


def _tables_text() -> str:
    """The IR of what evaluates kernels over tables."""
    from mbm.machine import llvm
    from mbm.solver.modules import tables_module

    return llvm.text(tables_module(LANES))


@dataclass(slots=True, eq=False)
class _Tables:
    """What evaluates kernels over tables: compiled in no time, and for speed once the rows were many.

    A row costs 1.2 ns more for each number that goes in or out until then, and compiling for speed 40 ms.
    What was made stays: a thread may be in it.
    """

    _store: Store | None
    _rows: int = 0
    _fast: bool = False
    _made: list[tuple[Library, Callable[..., int]]] = field(default_factory=list)
    _making: Lock = field(default_factory=Lock)

    def run(self, rows: int) -> Callable[..., int]:
        """`mbm.solver.tables.evaluate_rows`, which takes addresses and a number of rows, for so many of them."""
        self._rows += rows
        many = self._rows >= MANY * EVALUATIONS
        if self._lacks(many=many):
            with self._making:
                if self._lacks(many=many):  # another thread may have made it meanwhile
                    self._make(many=many)
        return self._made[-1][1]

    def _lacks(self, *, many: bool) -> bool:
        return not self._made or (many and not self._fast)

    def _make(self, *, many: bool) -> None:
        name = f"tables {source_digest('solver')}"
        library = fetched(name, self._store, FAST, compact=True)
        fast = many or library is not None
        if library is None:
            library = kept(name, _tables_text, self._store, FAST if many else PLAIN, compact=many)
        self._made.append((library, _SIGNATURE(library.address("evaluate_rows"))))
        self._fast = fast


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Call:
    """A call of `mbm.solver.tables.evaluate_rows` with the arrays that it fills, and those that have to stay."""

    arguments: tuple[int, ...]
    values: Floats
    nonzeros: Floats
    held: tuple[object, ...]

    @staticmethod
    def of(kernel: Kernel, code: NativeKernels, inputs: Floats, *, jacobian: bool) -> _Call:
        """``inputs``: contiguous, for all rows."""
        rows, width = inputs.shape
        place = code.jacobian_address(0) if jacobian else code.values_address(0)
        others = len(kernel.jacobian_rows) if jacobian else 0
        portion = min(PORTION, -(-rows // LANES))
        values, nonzeros = np.empty((rows, kernel.outputs)), np.empty((rows, others))
        work = np.empty(portion * LANES * (width + kernel.outputs + others))
        table = np.array([place, width, kernel.outputs, others, portion], dtype=np.int64)
        first, second = address(values), address(nonzeros if jacobian else values)
        return _Call(
            arguments=(address(table), rows, address(inputs), first, second, address(work)),
            values=values,
            nonzeros=nonzeros,
            held=(code, inputs, table, work),
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Tabulated:
    """A program for any number of rows; ``work`` is filled anew by each call.

    ``places`` are the addresses of ``table`` and ``work``.
    """

    library: Library
    tables: _Tables
    outputs: int
    table: NDArray[np.int64]
    work: Floats
    places: tuple[int, int]

    @staticmethod
    def of(library: Library, name: str, program: Program, tables: _Tables) -> _Tabulated:
        width, outputs = len(program.inputs), len(program.outputs)
        table = np.array([library.address(name), width, outputs, 0, PORTION], dtype=np.int64)
        work = np.empty(PORTION * LANES * (width + outputs))
        return _Tabulated(library, tables, outputs, table, work, (address(table), address(work)))

    def __call__(self, inputs: Floats) -> Floats:
        found = np.empty((len(inputs), self.outputs))
        place, (table, work) = address(found), self.places
        self.tables.run(len(inputs))(table, len(inputs), address(inputs), place, place, work)
        return found


@dataclass(slots=True, eq=False)
class _Stream:
    """A kernel for any number of rows, compiled for speed once they are many."""

    _kernel: Kernel
    _backend: NativeBackend
    _code: NativeKernels
    _done: int = 0

    def values(self, inputs: Floats) -> Floats:
        """The outputs (rows, outputs) at inputs (rows, variables + parameters)."""
        return self._called(inputs, jacobian=False).values

    def values_and_jacobian(self, inputs: Floats) -> tuple[Floats, Floats]:
        """The outputs (rows, outputs) and the nonzeros of their Jacobian (rows, nonzeros)."""
        call = self._called(inputs, jacobian=True)
        return call.values, call.nonzeros

    def _called(self, inputs: Floats, *, jacobian: bool) -> _Call:
        before, self._done = self._done, self._done + len(inputs)
        if before < MANY * EVALUATIONS <= self._done:
            self._code = self._backend.code.of([self._kernel], MANY)
        given = np.ascontiguousarray(inputs, dtype=np.float64)
        call = _Call.of(self._kernel, self._code, given, jacobian=jacobian)
        self._backend.tables.run(len(inputs))(*call.arguments)
        return call


@dataclass(slots=True, eq=False)
class _Evaluation:
    """A kernel for the rows of a table; its code is made when it is first asked for."""

    inputs: Floats
    _kernel: Kernel
    _backend: NativeBackend
    _calls: dict[bool, _Call] = field(default_factory=dict, init=False)

    def values(self) -> Floats:
        return self._called(jacobian=False).values

    def values_and_jacobian(self) -> tuple[Floats, Floats]:
        call = self._called(jacobian=True)
        return call.values, call.nonzeros

    def _called(self, *, jacobian: bool) -> _Call:
        call = self._calls.get(jacobian)
        if call is None:
            code = self._backend.code.of([self._kernel], len(self.inputs))
            call = self._calls[jacobian] = _Call.of(self._kernel, code, self.inputs, jacobian=jacobian)
        self._backend.tables.run(len(self.inputs))(*call.arguments)
        return call


@dataclass(frozen=True, slots=True, eq=False)
class NativeBackend(MachineCode):
    """Kernels as machine code; object code is kept in ``store``.

    Local to one compiled problem in one thread: what was compiled is kept in ``code``.
    """

    code: KernelCode = field(init=False, repr=False)
    tables: _Tables = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "code", KernelCode(self.store))
        object.__setattr__(self, "tables", _Tables(self.store))

    def prepare(self, kernel: Kernel, rows: int) -> Evaluation:
        """A table for ``rows`` rows."""
        return _Evaluation(np.zeros((rows, len(kernel.jacobian_program.inputs))), kernel, self)

    def stream(self, kernel: Kernel) -> Stream:
        """The kernel for points by the thousand; its code is made now."""
        return _Stream(kernel, self, self.code.of([kernel]))

    def tabulated(self, programs: Mapping[str, Program]) -> Mapping[str, Tabulated]:
        """Programs as machine code, made now in one piece."""
        text = straight_line.module_of(
            {f"program{k}": each for k, each in enumerate(programs.values())}, vector_library()
        )
        library = compiled(text, self.store, PLAIN)
        return {
            name: _Tabulated.of(library, f"program{k}", each, self.tables)
            for k, (name, each) in enumerate(programs.items())
        }


def backend(store: Store | None) -> NativeBackend:
    """The backend that keeps its object code in ``store``.

    Raises:
        BackendUnavailableError: no machine code can be made here.
    """
    reason = hindrance(store)
    if reason is not None:
        raise BackendUnavailableError(reason)
    return NativeBackend(store)
