"""Machine code made by LLVM in this process: four rows at a time, no Python and no interpreter per row."""

from __future__ import annotations

import ctypes
from dataclasses import field
from typing import TYPE_CHECKING, Any

import numpy as np

from mbm.kernels.native.engine import Library, compiled, hindrance
from mbm.kernels.native.kernels import MANY, PLAIN, level_for
from mbm.kernels.native.processor import vector_library
from mbm.kernels.types import BackendUnavailableError, Evaluation, Floats, Kernel, MachineCode, Stream
from mbm.machine import plain_rows
from mbm.machine.kinds import LANES
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.kernels.store import Store

_SIGNATURE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Code:
    """The functions of a kernel, with what keeps their code alive."""

    values: Any
    both: Any
    width: int
    outputs: int
    nonzeros: int
    _library: Library


def _code(kernel: Kernel, store: Store | None, level: int) -> _Code:
    functions = {
        "values": plain_rows.Table(program=kernel.value_program, split=kernel.outputs),
        "both": plain_rows.Table(program=kernel.jacobian_program, split=kernel.outputs),
    }
    library = compiled(plain_rows.module_of(functions, vector_library()), store, level)
    return _Code(
        values=_SIGNATURE(library.address("values")),
        both=_SIGNATURE(library.address("both")),
        width=len(kernel.jacobian_program.inputs),
        outputs=kernel.outputs,
        nonzeros=len(kernel.jacobian_rows),
        _library=library,
    )


def _blocks(rows: int) -> int:
    return -(-rows // LANES)


@dataclass(slots=True, eq=False)
class _Evaluation:
    """Tables with room for whole blocks; what stands in the rows behind the last is computed and not looked at."""

    inputs: Floats
    _code: _Code
    _whole: Floats
    _values: Floats
    _nonzeros: Floats | None = None
    _places: tuple[int, int, int] = field(init=False)

    def __post_init__(self) -> None:
        self._places = (self._whole.ctypes.data, self._values.ctypes.data, 0)

    def values(self) -> Floats:
        source, values, _ = self._places
        self._code.values(source, values, None, _blocks(len(self.inputs)))
        return self._values[: len(self.inputs)]

    def values_and_jacobian(self) -> tuple[Floats, Floats]:
        rows = len(self.inputs)
        if self._nonzeros is None:
            self._nonzeros = np.empty((len(self._whole), self._code.nonzeros))
            self._places = (*self._places[:2], self._nonzeros.ctypes.data)
        self._code.both(*self._places, _blocks(rows))
        return self._values[:rows], self._nonzeros[:rows]


@dataclass(frozen=True, slots=True, eq=False)
class _Stream:
    """A kernel for any number of rows."""

    _code: _Code

    def values(self, inputs: Floats) -> Floats:
        """The outputs (rows, outputs) at inputs (rows, variables + parameters)."""
        whole = _padded(inputs)
        values = np.empty((len(whole), self._code.outputs))
        self._code.values(whole.ctypes.data, values.ctypes.data, None, _blocks(len(inputs)))
        return values[: len(inputs)]

    def values_and_jacobian(self, inputs: Floats) -> tuple[Floats, Floats]:
        """The outputs (rows, outputs) and the nonzeros of their Jacobian (rows, nonzeros)."""
        whole, rows = _padded(inputs), len(inputs)
        values = np.empty((len(whole), self._code.outputs))
        nonzeros = np.empty((len(whole), self._code.nonzeros))
        self._code.both(whole.ctypes.data, values.ctypes.data, nonzeros.ctypes.data, _blocks(rows))
        return values[:rows], nonzeros[:rows]


def _padded(inputs: Floats) -> Floats:
    """The rows one behind the other, with the last one again until the blocks are whole."""
    missing = -len(inputs) % LANES
    whole = np.ascontiguousarray(inputs, dtype=np.float64)
    return np.concatenate([whole, whole[-1:].repeat(missing, axis=0)]) if missing else whole


@dataclass(frozen=True, slots=True, eq=False)
class NativeBackend(MachineCode):
    """Kernels as machine code; object code is kept in ``store``.

    Local to one compiled problem in one thread: what was compiled is kept for each kernel and level.
    """

    _made: dict[tuple[int, int], tuple[Kernel, _Code]] = field(default_factory=dict, init=False, repr=False)

    def prepare(self, kernel: Kernel, rows: int) -> Evaluation:
        """Buffers for ``rows`` rows; the machine code is made once for each kernel."""
        code = self._compiled(kernel, level_for(kernel, rows) if rows >= MANY else PLAIN)
        whole = np.zeros((_blocks(rows) * LANES, code.width))
        return _Evaluation(whole[:rows], code, whole, np.empty((len(whole), code.outputs)))

    def stream(self, kernel: Kernel) -> Stream:
        """The kernel for points by the thousand."""
        return _Stream(self._compiled(kernel, level_for(kernel, 0)))

    def _compiled(self, kernel: Kernel, level: int) -> _Code:
        key = (id(kernel), level)
        if key not in self._made:
            self._made[key] = (kernel, _code(kernel, self.store, level))
        return self._made[key][1]


def backend(store: Store | None) -> NativeBackend:
    """The backend that keeps its object code in ``store``.

    Raises:
        BackendUnavailableError: no machine code can be made here.
    """
    reason = hindrance(store)
    if reason is not None:
        raise BackendUnavailableError(reason)
    return NativeBackend(store)
