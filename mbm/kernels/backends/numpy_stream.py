"""NumPy over the instruction stream: each instruction once for a block of rows. Needs no CasADi once lowered."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.kernels.types import Floats, Kernel, Tabulated
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


@dataclass(slots=True, eq=False)
class _Evaluation:
    inputs: Floats
    _kernel: Kernel
    _values: tuple[Program, tuple[Step, ...], Floats] | None = None
    _both: tuple[Program, tuple[Step, ...], Floats] | None = None

    def values(self) -> Floats:
        if self._values is None:
            program = self._kernel.value_program
            self._values = (program, steps_of(program), np.empty((len(self.inputs), self._kernel.outputs)))
        program, steps, outputs = self._values
        run(program, steps, self.inputs, outputs)
        return outputs

    def values_and_jacobian(self) -> tuple[Floats, Floats]:
        count = self._kernel.outputs
        if self._both is None:
            program = self._kernel.jacobian_program
            shape = (len(self.inputs), count + len(self._kernel.jacobian_rows))
            self._both = (program, steps_of(program), np.empty(shape))
        program, steps, outputs = self._both
        run(program, steps, self.inputs, outputs)
        return outputs[:, :count], outputs[:, count:]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Stream:
    """A kernel for any number of rows: for points by the thousand, whose number changes from call to call."""

    outputs: int
    _values: tuple[Program, tuple[Step, ...]]
    _both: tuple[Program, tuple[Step, ...]]

    def values(self, inputs: Floats) -> Floats:
        """The outputs (rows, outputs) at inputs (rows, variables + parameters)."""
        program, steps = self._values
        found = np.empty((len(inputs), len(program.outputs)))
        run(program, steps, inputs, found)
        return found

    def values_and_jacobian(self, inputs: Floats) -> tuple[Floats, Floats]:
        """The outputs (rows, outputs) and the nonzeros of their Jacobian (rows, nonzeros)."""
        program, steps = self._both
        found = np.empty((len(inputs), len(program.outputs)))
        run(program, steps, inputs, found)
        return found[:, : self.outputs], found[:, self.outputs :]


def tabulated(programs: Mapping[str, Program]) -> Mapping[str, Tabulated]:
    """Each program for any number of rows."""

    def one(program: Program) -> Tabulated:
        steps = steps_of(program)

        def evaluated(inputs: Floats) -> Floats:
            found = np.empty((len(inputs), len(program.outputs)))
            run(program, steps, inputs, found)
            return found

        return evaluated

    return {name: one(program) for name, program in programs.items()}


@dataclass(frozen=True, slots=True)
class NumpyBackend:
    """For many rows, and wherever CasADi's virtual machine is not wanted."""

    name: str = "numpy"
    store: Store | None = None
    """What keeps the solver's machine code."""

    def prepare(self, kernel: Kernel, rows: int) -> _Evaluation:
        """Buffers for ``rows`` rows; the buffers for results are made when first called."""
        width = len(kernel.variables) + len(kernel.parameters)
        return _Evaluation(np.zeros((rows, width)), kernel)

    def stream(self, kernel: Kernel) -> _Stream:
        """The program of the kernel, run anew for each call."""
        values, both = kernel.value_program, kernel.jacobian_program
        return _Stream(outputs=kernel.outputs, _values=(values, steps_of(values)), _both=(both, steps_of(both)))

    def tabulated(self, programs: Mapping[str, Program]) -> Mapping[str, Tabulated]:
        """As the function of that name."""
        return tabulated(programs)


BACKEND = NumpyBackend()
