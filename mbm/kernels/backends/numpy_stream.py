"""NumPy over the instruction stream: each instruction once for a block of rows. Needs no CasADi once lowered."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.kernels.types import Floats, Kernel, Stream, Tabulated
from mbm.machine.numpy_functions import function_of
from mbm.machine.program import Operator, Program
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.kernels.store import Store

BLOCK = 1024
"""Rows evaluated together: their values stay in the cache, and Python's share of the work is small."""


def _truth(function: Callable[..., NDArray[np.bool_]]) -> Callable[..., Floats]:
    """0.0 or 1.0, which add up as numbers do: the derivative of ``max`` at a tie is the mean of two comparisons."""
    return lambda *arguments: function(*arguments).astype(np.float64)


_TRUTHS = (
    Operator.LESS, Operator.LESS_EQUAL, Operator.EQUAL, Operator.NOT_EQUAL, Operator.NOT, Operator.AND, Operator.OR
)  # fmt: skip

_OWN: Mapping[Operator, Callable[..., Floats]] = {
    Operator.ADD: operator.add,
    Operator.SUB: operator.sub,
    Operator.MUL: operator.mul,
    Operator.DIV: operator.truediv,
    Operator.NEG: operator.neg,
    Operator.TWICE: lambda a: a + a,
    Operator.SELECT: lambda test, value: np.where(test != 0, value, 0.0),
    **{each: _truth(getattr(np, each.numpy)) for each in _TRUTHS},
}
"""What NumPy has no function for, or a slower one, or one that gives no numbers."""

FUNCTIONS: Mapping[Operator, Callable[..., Floats]] = {
    each: _OWN[each] if each in _OWN else function_of(each) for each in Operator
}


Step: TypeAlias = tuple[Callable[..., Floats], int, int, int, tuple[int, ...]]
"""A function, the one or two values that it takes (-1: one), the one that it gives, and those that end with it."""


def steps_of(program: Program) -> tuple[Step, ...]:
    """The instructions, looked up once."""
    kept = set(program.outputs)
    last: dict[int, int] = {}
    for position, instruction in enumerate(program.instructions):
        for argument in instruction.arguments:
            last[argument] = position
    dying: list[list[int]] = [[] for _ in program.instructions]
    for value, position in last.items():
        if value not in kept:
            dying[position].append(value)
    return tuple(
        (FUNCTIONS[each.operator], each.arguments[0], (*each.arguments, -1)[1], each.target, tuple(dead))
        for each, dead in zip(program.instructions, dying, strict=True)
    )


def run(program: Program, steps: tuple[Step, ...], inputs: Floats, outputs: Floats) -> None:
    """Fill ``outputs`` (rows, outputs) from ``inputs`` (rows, inputs)."""
    with np.errstate(all="ignore"):
        for start in range(0, len(inputs), BLOCK):
            block = inputs[start : start + BLOCK]
            columns = block[0] if len(block) == 1 else np.ascontiguousarray(block.T)  # scalars take half as long
            values: list[Floats | float | None] = [None] * program.values
            for value, constant in program.constants:
                values[value] = np.float64(constant)
            for position, value in enumerate(program.inputs):
                if value >= 0:
                    values[value] = columns[position]
            for function, one, other, given, dead in steps:
                values[given] = function(values[one]) if other < 0 else function(values[one], values[other])
                for value in dead:
                    values[value] = None
            target = outputs[start : start + BLOCK]
            for position, value in enumerate(program.outputs):
                target[:, position] = 0.0 if value < 0 else values[value]


def evaluator(program: Program) -> Tabulated:
    """What evaluates a program for any number of rows."""
    steps = steps_of(program)

    def evaluated(inputs: Floats) -> Floats:
        found = np.empty((len(inputs), len(program.outputs)))
        run(program, steps, inputs, found)
        return found

    return evaluated


def tabulated(programs: Mapping[str, Program]) -> Mapping[str, Tabulated]:
    """Each program for any number of rows."""
    return {name: evaluator(program) for name, program in programs.items()}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Stream:
    """A kernel for any number of rows: for points by the thousand, whose number changes from call to call."""

    outputs: int
    values: Tabulated
    _both: Tabulated

    def values_and_jacobian(self, inputs: Floats) -> tuple[Floats, Floats]:
        """The outputs (rows, outputs) and the nonzeros of their Jacobian (rows, nonzeros)."""
        found = self._both(inputs)
        return found[:, : self.outputs], found[:, self.outputs :]


@dataclass(frozen=True, slots=True, eq=False)
class StreamEvaluation:
    """A stream for a number of rows, whose results are new arrays."""

    inputs: Floats
    _stream: Stream

    @staticmethod
    def of(kernel: Kernel, stream: Stream, rows: int) -> StreamEvaluation:
        """That of a kernel for ``rows`` rows."""
        return StreamEvaluation(np.zeros((rows, len(kernel.variables) + len(kernel.parameters))), stream)

    def values(self) -> Floats:
        """As `mbm.kernels.types.Evaluation` has it."""
        return self._stream.values(self.inputs)

    def values_and_jacobian(self) -> tuple[Floats, Floats]:
        """Likewise."""
        return self._stream.values_and_jacobian(self.inputs)


@dataclass(frozen=True, slots=True)
class NumpyBackend:
    """For many rows, and wherever CasADi's virtual machine is not wanted."""

    name: str = "numpy"
    store: Store | None = None
    """What keeps the solver's machine code."""

    def prepare(self, kernel: Kernel, rows: int) -> StreamEvaluation:
        """The stream for ``rows`` rows."""
        return StreamEvaluation.of(kernel, self.stream(kernel), rows)

    def stream(self, kernel: Kernel) -> Stream:
        """The program of the kernel, run anew for each call."""
        return _Stream(
            outputs=kernel.outputs, values=evaluator(kernel.value_program), _both=evaluator(kernel.jacobian_program)
        )

    def tabulated(self, programs: Mapping[str, Program]) -> Mapping[str, Tabulated]:
        """As the function of that name."""
        return tabulated(programs)


BACKEND = NumpyBackend()
