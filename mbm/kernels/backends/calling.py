"""Kernels that call functions: their arguments, the calls, then the rest by another backend."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from mbm.kernels.backends.numpy_stream import Step, run, steps_of
from mbm.kernels.called_functions import CalledFunctions
from mbm.kernels.types import Backend, Evaluation, ExternalCall, Floats, Kernel, Stream
from mbm.symbolic.types import ConstantInput
from mbm.text.types import Diagnostic
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.kernels.store import Store


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CallingBackend:
    """``inner`` evaluates what is no call. Solvers call all of it back: none of it is machine code for them."""

    inner: Backend
    functions: CalledFunctions
    name: str
    store: Store | None

    def prepare(self, kernel: Kernel, rows: int) -> Evaluation:
        """Buffers for ``rows`` rows."""
        if not kernel.calls:
            return self.inner.prepare(kernel, rows)
        width = len(kernel.variables) + len(kernel.parameters)
        return _Evaluation(np.zeros((rows, width)), _stream(kernel, self))

    def stream(self, kernel: Kernel) -> Stream:
        """The kernel for any number of rows."""
        return _stream(kernel, self) if kernel.calls else self.inner.stream(kernel)


def backend(inner: Backend, functions: CalledFunctions) -> CallingBackend:
    """The backend whose kernels call ``functions``, and are evaluated by ``inner`` otherwise."""
    return CallingBackend(
        inner=inner,
        functions=functions,
        name=inner.name,
        store=getattr(inner, "store", None),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Evaluation:
    inputs: Floats
    _stream: CallingStream

    def values(self) -> Floats:
        return self._stream.values(self.inputs)

    def values_and_jacobian(self) -> tuple[Floats, Floats]:
        return self._stream.values_and_jacobian(self.inputs)


@dataclass(frozen=True, slots=True, eq=False)
class CallingStream:
    """A kernel for any number of rows. ``rest`` is the kernel that takes the results of the calls as parameters."""

    calls: tuple[tuple[ExternalCall, tuple[Step, ...]], ...]
    width: int
    rest: Stream
    functions: CalledFunctions

    def values(self, inputs: Floats) -> Floats:
        """The outputs (rows, outputs) at inputs (rows, variables + parameters)."""
        return self.rest.values(self._with_results(inputs, derivatives=False))

    def values_and_jacobian(self, inputs: Floats) -> tuple[Floats, Floats]:
        """The outputs (rows, outputs) and the nonzeros of their Jacobian (rows, nonzeros)."""
        return self.rest.values_and_jacobian(self._with_results(inputs, derivatives=True))

    def doubts(self, inputs: Floats) -> list[Diagnostic]:
        """Warnings about Jacobians of functions that the differences of their values contradict at ``inputs``."""
        whole = self._with_results(inputs, derivatives=False)
        pairs = [(call, _arguments(call, steps, whole)) for call, steps in self.calls]
        found = (self.functions.doubt(call.external, arguments, call.wanted) for call, arguments in pairs)
        return [doubt for doubt in found if doubt is not None]

    def reason(self, inputs: Floats) -> str | None:
        """Why the first call that gives no numbers at ``inputs`` (1, variables + parameters) gives none, if known."""
        whole = self._with_results(inputs, derivatives=False)
        said = (self.functions.reason(call.external, _arguments(call, steps, whole)) for call, steps in self.calls)
        return next((reason for reason in said if reason is not None), None)

    def arguments(self, number: int, inputs: Floats) -> Floats:
        """The arguments (rows, m) of call ``number``; earlier ones are made where these depend on their results."""
        call, steps = self.calls[number]
        needed = any(value >= 0 for value in call.arguments.inputs[inputs.shape[1] :])
        earlier = replace(self, calls=self.calls[:number] if needed else ())
        return _arguments(call, steps, earlier._with_results(inputs, derivatives=False))

    def _with_results(self, inputs: Floats, *, derivatives: bool) -> Floats:
        """The inputs with what the calls give behind them; zeros for derivatives that are not wanted."""
        whole = np.zeros((len(inputs), self.width))
        whole[:, : inputs.shape[1]] = inputs
        for call, steps in self.calls:
            arguments = _arguments(call, steps, whole)
            parts = [self.functions.values(call.external, arguments)]
            if derivatives and call.wanted:
                parts.append(self.functions.slopes(call.external, arguments, call.wanted))
                if call.bent:
                    parts.append(self.functions.bends(call.external, arguments, call.wanted))
            found = np.hstack([part.reshape(len(inputs), -1) for part in parts])
            whole[:, call.first : call.first + found.shape[1]] = found
        return whole


def _arguments(call: ExternalCall, steps: tuple[Step, ...], whole: Floats) -> Floats:
    """The arguments (rows, m) of a call, where earlier ones have left their results."""
    found = np.empty((len(whole), len(call.arguments.outputs)))
    run(call.arguments, steps, whole, found)
    return found


def _stream(kernel: Kernel, backend: CallingBackend) -> CallingStream:
    names = chain.from_iterable(
        (f"{call.external.function} {i + 1}" for i in range(call.results)) for call in kernel.calls
    )
    results = tuple(ConstantInput(name) for name in names)
    rest = replace(kernel, parameters=(*kernel.parameters, *results), calls=(), corrections=None)
    return CallingStream(
        tuple((call, steps_of(call.arguments)) for call in kernel.calls),
        len(rest.variables) + len(rest.parameters),
        backend.inner.stream(rest),
        backend.functions,
    )
