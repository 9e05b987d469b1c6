"""CasADi's own virtual machine, mapped over the rows and called through a buffer: no copies, no Python per row."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import casadi
import numpy as np

from mbm.kernels.types import Floats, Kernel


def _bind(function: casadi.Function, inputs: Floats, outputs: Floats) -> tuple[object, Callable[[], None]]:
    mapped = function.map(len(inputs)) if len(inputs) != 1 else function
    buffer: Any
    buffer, trigger = mapped.buffer()
    buffer.set_arg(0, inputs.data)
    buffer.set_res(0, outputs.data)
    return (mapped, buffer), trigger


@dataclass(slots=True, eq=False)
class _Evaluation:
    inputs: Floats
    outputs: int
    _kernel: Kernel
    _values: tuple[Floats, object, Callable[[], None]] | None = field(default=None)
    _both: tuple[Floats, object, Callable[[], None]] | None = field(default=None)

    def values(self) -> Floats:
        if not len(self.inputs):
            return np.empty((0, self.outputs))
        if self._values is None:
            result = np.empty((len(self.inputs), self.outputs))
            self._values = (result, *_bind(self._kernel.value_function, self.inputs, result))
        self._values[2]()
        return self._values[0]

    def values_and_jacobian(self) -> tuple[Floats, Floats]:
        width = self.outputs + len(self._kernel.jacobian_rows)
        if not len(self.inputs):
            return np.empty((0, self.outputs)), np.empty((0, width - self.outputs))
        if self._both is None:
            result = np.empty((len(self.inputs), width))
            self._both = (result, *_bind(self._kernel.jacobian_function, self.inputs, result))
        self._both[2]()
        both = self._both[0]
        return both[:, : self.outputs], both[:, self.outputs :]


@dataclass(frozen=True, slots=True)
class CasadiBackend:
    """The default: small and large numbers of rows alike."""

    name: str = "casadi"

    def prepare(self, kernel: Kernel, rows: int) -> _Evaluation:
        """Buffers for ``rows`` rows; the mapped functions are made when first called."""
        width = len(kernel.variables) + len(kernel.parameters)
        return _Evaluation(np.zeros((rows, width)), kernel.outputs, kernel)


BACKEND = CasadiBackend()
