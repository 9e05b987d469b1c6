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
    _kernel: Kernel
    _made: dict[str, tuple[Floats, Callable[[], None]]] = field(default_factory=dict)

    def values(self) -> Floats:
        return self._called("values", self._kernel.value_program)

    def values_and_jacobian(self) -> tuple[Floats, Floats]:
        both = self._called("values_and_jacobian", self._kernel.jacobian_program)
        return both[:, : self._kernel.outputs], both[:, self._kernel.outputs :]

    def _called(self, name: str, program: Program) -> Floats:
        if name not in self._made:
            result = np.empty((len(self.inputs), len(program.outputs)))
            self._made[name] = result, _bind(function_of(name, program), self.inputs, result)
        result, call = self._made[name]
        call()
        return result


@dataclass(frozen=True, slots=True)
class CasadiBackend:
    """The default: small and large numbers of rows alike."""

    name: str = "casadi"
    store: Store | None = None
    """What keeps the solver's machine code."""

    def prepare(self, kernel: Kernel, rows: int) -> _Evaluation:
        """Buffers for ``rows`` rows; the mapped functions are made when first called."""
        width = len(kernel.variables) + len(kernel.parameters)
        return _Evaluation(np.zeros((rows, width)), kernel)

    def stream(self, kernel: Kernel) -> Stream:
        """By NumPy: a mapped function is made for a number of rows, and here that changes with each call."""
        return numpy_stream.BACKEND.stream(kernel)

    def tabulated(self, programs: Mapping[str, Program]) -> Mapping[str, Tabulated]:
        """By NumPy, for the same reason."""
        return numpy_stream.tabulated(programs)


BACKEND = CasadiBackend()
