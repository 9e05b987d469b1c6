"""Kernels that call functions: their arguments, the calls, then the rest by another backend."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mbm.kernels.backends.numpy_stream import StreamEvaluation, evaluator
from mbm.kernels.called_functions import CalledFunctions
from mbm.kernels.types import Backend, Evaluation, ExternalCall, Floats, Kernel, Stream, Tabulated
from mbm.machine.program import Program
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
    _streams: dict[Kernel, CallingStream] = field(default_factory=dict, init=False)

    def prepare(self, kernel: Kernel, rows: int) -> Evaluation:
        """Buffers for ``rows`` rows."""
        if not kernel.calls:
            return self.inner.prepare(kernel, rows)
        return StreamEvaluation.of(kernel, self._calling(kernel), rows)

    def stream(self, kernel: Kernel) -> Stream:
        """The kernel for any number of rows."""
        return self._calling(kernel) if kernel.calls else self.inner.stream(kernel)

    def _calling(self, kernel: Kernel) -> CallingStream:
        """The one of a kernel: what it gave for rows is known wherever these are asked for again."""
        if kernel not in self._streams:
            self._streams[kernel] = _stream(kernel, self)
        return self._streams[kernel]

    def tabulated(self, programs: Mapping[str, Program]) -> Mapping[str, Tabulated]:
        """Those of ``inner``: programs call nothing."""
        return self.inner.tabulated(programs)


def backend(inner: Backend, functions: CalledFunctions) -> CallingBackend:
    """The backend whose kernels call ``functions``, and are evaluated by ``inner`` otherwise, as outlines are."""
    functions.evaluate_by(inner.tabulated)
    return CallingBackend(
        inner=inner,
        functions=functions,
        name=inner.name,
        store=getattr(inner, "store", None),
    )


class _Arguments:
    """The arguments of a call: those that are the same in all rows are computed once. Local to one stream."""

    def __init__(self, program: Program) -> None:
        self._program = program
        self._used = np.flatnonzero(np.array(program.inputs, dtype=np.int64) >= 0)
        self._parts: tuple[NDArray[np.bool_], _Part, _Part] | None = None

    def at(self, whole: Floats) -> Floats:
        """The arguments (rows, m), where earlier calls have left their results."""
        found = np.empty((len(whole), len(self._program.outputs)))
        used = whole[:, self._used]
        varied = (used != used[:1]).any(axis=0)
        parts = self._parts
        if parts is None or not np.array_equal(parts[0], varied):
            parts = self._parts = varied, *self._split(varied)
        _, alike, others = parts
        found[:, alike.outputs] = alike.at(whole[:1])
        found[:, others.outputs] = others.at(whole)
        return found

    def _split(self, varied: NDArray[np.bool_]) -> tuple[_Part, _Part]:
        """What does not depend on the used inputs that are ``varied``, and what does."""
        inputs = np.zeros(len(self._program.inputs), dtype=bool)
        inputs[self._used] = varied
        depends = self._program.depends_on(inputs.tolist())
        alike, others = ([k for k, each in enumerate(depends) if each is wanted] for wanted in (False, True))
        return _Part.of(self._program, alike), _Part.of(self._program, others)


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """Some outputs of a program, which takes the inputs at ``used`` alone."""

    outputs: Sequence[int] | slice
    used: NDArray[np.int64]
    evaluated: Tabulated

    @staticmethod
    def of(program: Program, outputs: list[int]) -> _Part:
        whole = program.restricted(outputs)
        used = [place for place, value in enumerate(whole.inputs) if value >= 0]
        own = replace(whole, inputs=tuple(whole.inputs[place] for place in used))
        together = outputs == list(range(outputs[0], outputs[-1] + 1)) if outputs else False
        places = slice(outputs[0], outputs[-1] + 1) if together else outputs
        return _Part(places, np.array(used, dtype=np.int64), evaluator(own))

    def at(self, inputs: Floats) -> Floats:
        return self.evaluated(inputs[:, self.used])


@dataclass(slots=True, eq=False)
class _Results:
    """The ``inputs`` of the last rows with what the calls gave behind them, and the ``arguments`` of each call.

    ``derivatives``: those too; else zeros stand in their place.
    """

    inputs: Floats
    whole: Floats
    arguments: list[Floats]
    derivatives: bool = False


class _Memory:
    """The results of the last rows: derivatives are asked for where values were."""

    def __init__(self) -> None:
        self.last: _Results | None = None


def reason_of(stream: Stream, inputs: Floats) -> str | None:
    """Why a call of a kernel gives no numbers at ``inputs`` (1, variables + parameters); None where nobody knows."""
    return stream.reason(inputs) if isinstance(stream, CallingStream) else None


@dataclass(frozen=True, slots=True, eq=False)
class CallingStream:
    """A kernel for any number of rows. ``rest`` is the kernel that takes the results of the calls as parameters."""

    calls: tuple[tuple[ExternalCall, _Arguments], ...]
    width: int
    rest: Stream
    functions: CalledFunctions
    _memory: _Memory = field(default_factory=_Memory, init=False)

    def values(self, inputs: Floats) -> Floats:
        """The outputs (rows, outputs) at inputs (rows, variables + parameters)."""
        return self.rest.values(self._with_results(inputs, derivatives=False))

    def values_and_jacobian(self, inputs: Floats) -> tuple[Floats, Floats]:
        """The outputs (rows, outputs) and the nonzeros of their Jacobian (rows, nonzeros)."""
        return self.rest.values_and_jacobian(self._with_results(inputs, derivatives=True))

    def doubts(self, inputs: Floats) -> list[Diagnostic]:
        """Warnings about Jacobians of functions that the differences of their values contradict at ``inputs``."""
        whole = self._with_results(inputs, derivatives=False)
        pairs = [(call, arguments.at(whole)) for call, arguments in self.calls]
        found = (self.functions.doubt(call.external, arguments, call.wanted) for call, arguments in pairs)
        return [doubt for doubt in found if doubt is not None]

    def reason(self, inputs: Floats) -> str | None:
        """Why the first call that gives no numbers at ``inputs`` (1, variables + parameters) gives none, if known."""
        whole = self._with_results(inputs, derivatives=False)
        said = (self.functions.reason(call.external, arguments.at(whole)) for call, arguments in self.calls)
        return next((reason for reason in said if reason is not None), None)

    def arguments(self, number: int, inputs: Floats) -> Floats:
        """The arguments (rows, m) of call ``number``; earlier ones are made where these depend on their results."""
        call, arguments = self.calls[number]
        needed = any(value >= 0 for value in call.arguments.inputs[inputs.shape[1] :])
        earlier = replace(self, calls=self.calls[:number] if needed else ())
        return arguments.at(earlier._with_results(inputs, derivatives=False))

    def _with_results(self, inputs: Floats, *, derivatives: bool) -> Floats:
        """The inputs with what the calls give behind them; derivatives that were not wanted may be zero."""
        found = self._memory.last
        if found is None or not np.array_equal(found.inputs[: len(inputs)], inputs):
            found = self._called(inputs)
        if derivatives and not found.derivatives:
            for (call, _), arguments in zip(self.calls, found.arguments, strict=True):
                self._differentiate(call, arguments, found.whole)
            found.derivatives = True
        self._memory.last = found
        return found.whole[: len(inputs)]

    def _called(self, inputs: Floats) -> _Results:
        whole, every = np.zeros((len(inputs), self.width)), []
        whole[:, : inputs.shape[1]] = inputs
        for call, program in self.calls:
            arguments = program.at(whole)
            every.append(arguments)
            _put(whole, call.first, self.functions.values(call.external, arguments))
        return _Results(inputs.copy(), whole, every)

    def _differentiate(self, call: ExternalCall, arguments: Floats, whole: Floats) -> None:
        if not call.wanted:
            return
        slopes = self.functions.slopes(call.external, arguments, call.wanted)
        behind = _put(whole, call.first + call.external.size, slopes)
        if call.bent:
            _put(whole, behind, self.functions.bends(call.external, arguments, call.wanted))


def _put(whole: Floats, place: int, part: Floats) -> int:
    """Enter numbers (rows, …) from column ``place`` on; where they end."""
    width = part[0].size if len(part) else 0
    whole[:, place : place + width] = part.reshape(len(whole), width)
    return place + width


def _stream(kernel: Kernel, backend: CallingBackend) -> CallingStream:
    names = chain.from_iterable(
        (f"{call.external.function} {i + 1}" for i in range(call.results)) for call in kernel.calls
    )
    results = tuple(ConstantInput(name) for name in names)
    rest = replace(kernel, parameters=(*kernel.parameters, *results), calls=(), corrections=None)
    return CallingStream(
        tuple((call, _Arguments(call.arguments)) for call in kernel.calls),
        len(rest.variables) + len(rest.parameters),
        backend.inner.stream(rest),
        backend.functions,
    )
