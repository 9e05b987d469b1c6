"""CasADi's own virtual machine, mapped over the rows and called through a buffer: no copies, no Python per row."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from mbm.kernels.backends import numpy_stream
from mbm.kernels.serialised import function_of
from mbm.kernels.types import Floats, Kernel, Stream, Tabulated
from mbm.machine.program import Program
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.kernels.store import Store

MAPPED_ROWS = 1024
"""Rows of one mapped function: CasADi's time to make it grows with its rows, so that many rows call it many times."""


def _bind(function: casadi.Function, inputs: Floats, outputs: Floats) -> Callable[[], None]:
    """What evaluates ``function`` for all rows of ``inputs`` into ``outputs``: whole blocks, then the rest."""
    rows = len(inputs)
    whole = rows - rows % MAPPED_ROWS
    pieces = []
    for size, starts in ((MAPPED_ROWS, range(0, whole, MAPPED_ROWS)), (rows - whole, range(whole, rows, MAPPED_ROWS))):
        if len(starts):
            mapped = function.map(size) if size > 1 else function
            buffer: Any
            buffer, trigger = mapped.buffer()
            places = [(inputs[s : s + size].data, outputs[s : s + size].data) for s in starts]
            buffer.set_arg(0, places[0][0])
            buffer.set_res(0, places[0][1])
            pieces.append((mapped, buffer, trigger, places))

    def call() -> None:
        for _, buffer, trigger, places in pieces:
            if len(places) == 1:
                trigger()
                continue
            for source, target in places:
                buffer.set_arg(0, source)
                buffer.set_res(0, target)
                trigger()

    return call


@dataclass(slots=True, eq=False)
class _Evaluation:
    inputs: Floats
    outputs: int
    _kernel: Kernel
    _values: tuple[Floats, Callable[[], None]] | None = field(default=None)
    _both: tuple[Floats, Callable[[], None]] | None = field(default=None)

    def values(self) -> Floats:
        if self._values is None:
            result = np.empty((len(self.inputs), self.outputs))
            self._values = (result, _bind(function_of("values", self._kernel.value_program), self.inputs, result))
        self._values[1]()
        return self._values[0]

    def values_and_jacobian(self) -> tuple[Floats, Floats]:
        if self._both is None:
            result = np.empty((len(self.inputs), self.outputs + len(self._kernel.jacobian_rows)))
            self._both = (
                result,
                _bind(function_of("values_and_jacobian", self._kernel.jacobian_program), self.inputs, result),
            )
        self._both[1]()
        both = self._both[0]
        return both[:, : self.outputs], both[:, self.outputs :]


@dataclass(frozen=True, slots=True)
class CasadiBackend:
    """The default: small and large numbers of rows alike."""

    name: str = "casadi"
    store: Store | None = None
    """What keeps the solver's machine code."""

    def prepare(self, kernel: Kernel, rows: int) -> _Evaluation:
        """Buffers for ``rows`` rows; the mapped functions are made when first called."""
        width = len(kernel.variables) + len(kernel.parameters)
        return _Evaluation(np.zeros((rows, width)), kernel.outputs, kernel)

    def stream(self, kernel: Kernel) -> Stream:
        """By NumPy: a mapped function is made for a number of rows, and here that changes with each call."""
        return numpy_stream.BACKEND.stream(kernel)

    def tabulated(self, programs: Mapping[str, Program]) -> Mapping[str, Tabulated]:
        """By NumPy, for the same reason."""
        return numpy_stream.tabulated(programs)


BACKEND = CasadiBackend()
