"""Several programs as one: equal operations on equal values once; rows of several as one straight-line program."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import replace

from mbm.machine.program import Instruction, Operator, Program
from mbm.values import dataclass

_EITHER_WAY = (Operator.ADD, Operator.MUL)
"""Operations that give the same bits with their arguments exchanged."""

ZERO = -1
"""The value that is zero, as in `Program`."""


def reduced(program: Program, outputs: Sequence[int]) -> Program:
    """What some outputs need of a program."""
    wanted = set(outputs)
    for each in reversed(program.instructions):
        if each.target in wanted:
            wanted.update(each.arguments)
    return replace(
        program,
        inputs=tuple(value if value in wanted else -1 for value in program.inputs),
        constants=tuple((value, constant) for value, constant in program.constants if value in wanted),
        instructions=tuple(each for each in program.instructions if each.target in wanted),
        outputs=tuple(outputs),
    )


class Merged:
    """A program that grows; equal operations on equal values are one value. Local to one call."""

    def __init__(self, inputs: int) -> None:
        self._inputs = inputs
        self._count = inputs
        self._constants: dict[bytes, int] = {}
        self._known: dict[tuple[Operator, tuple[int, ...]], int] = {}

    def run(self, program: Program, inputs: Sequence[int]) -> list[int]:
        """The outputs of a program whose inputs are these values."""
        values = {own: self.constant(constant) for own, constant in program.constants}
        values |= {own: given for own, given in zip(program.inputs, inputs, strict=True) if own >= 0}
        for each in program.instructions:
            values[each.target] = self.applied(each.operator, *(values[a] for a in each.arguments))
        return [ZERO if output < 0 else values[output] for output in program.outputs]

    def sum(self, a: int, b: int) -> int:
        """``a + b``; either may be zero."""
        if ZERO in (a, b):
            return max(a, b)
        return self.applied(Operator.ADD, a, b)

    def weighted(self, terms: Sequence[tuple[int, int]]) -> int:
        """The sum of products."""
        total = ZERO
        for weight, value in terms:
            if value != ZERO:
                total = self.sum(total, self.applied(Operator.MUL, weight, value))
        return total

    def program(self, outputs: Sequence[int]) -> Program:
        """What the outputs need of all that was computed."""
        constants = ((value, struct.unpack("<d", bits)[0]) for bits, value in self._constants.items())
        whole = Program(
            values=self._count,
            inputs=tuple(range(self._inputs)),
            constants=tuple(constants),
            instructions=tuple(Instruction(target, *key) for key, target in self._known.items()),
            outputs=tuple(outputs),
        )
        return reduced(whole, outputs)

    def constant(self, number: float) -> int:
        """A value known from the start."""
        bits = struct.pack("<d", number)
        if bits not in self._constants:
            self._constants[bits] = self._new()
        return self._constants[bits]

    def applied(self, operator: Operator, *arguments: int) -> int:
        """The value of an operation on earlier ones."""
        if operator in _EITHER_WAY:
            arguments = tuple(sorted(arguments))
        key = (operator, arguments)
        if key not in self._known:
            self._known[key] = self._new()
        return self._known[key]

    def _new(self) -> int:
        self._count += 1
        return self._count - 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """Some rows of one kernel.

    ``program`` gives ``outputs`` values, and nonzeros of their Jacobian behind them: ``derivatives`` has the output and
    the column of each (-1: of no interest). Its inputs are the ``numbers`` of the point, the same in all ``rows``, then
    ``parameters`` of the row. Residual i is the sum of weight times output over ``whitening[i]``, where weights are
    those of the row, ``weights`` in all.
    """

    program: Program
    rows: int
    outputs: int
    derivatives: tuple[tuple[int, int], ...]
    numbers: tuple[int, ...]
    parameters: int
    whitening: tuple[tuple[tuple[int, int], ...], ...]
    weights: int


def fused(parts: Sequence[Part], numbers: int, columns: int) -> Program:
    """The rows of all parts as one program.

    Inputs are the ``numbers`` of the point, then for each part the parameters of its rows, row by row, and their
    weights. Outputs are the derivatives of the m residuals by each of the ``columns`` (m each), then the residuals.
    """
    merged = Merged(numbers + sum(each.rows * (each.parameters + each.weights) for each in parts))
    residuals: list[int] = []
    slopes: list[dict[int, int]] = []
    first = numbers
    for part in parts:
        heavy = first + part.rows * part.parameters
        for row in range(part.rows):
            own = range(first + row * part.parameters, first + (row + 1) * part.parameters)
            found = merged.run(part.program, (*part.numbers, *own))
            weights = range(heavy + row * part.weights, heavy + (row + 1) * part.weights)
            lines: list[dict[int, int]] = [{} for _ in range(part.outputs)]
            for (output, column), value in zip(part.derivatives, found[part.outputs :], strict=True):
                if column >= 0:
                    lines[output][column] = merged.sum(lines[output].get(column, ZERO), value)
            for terms in part.whitening:
                residuals.append(merged.weighted([(weights[w], found[output]) for w, output in terms]))
                touched = sorted({column for _, output in terms for column in lines[output]})
                slopes.append(
                    {c: merged.weighted([(weights[w], lines[o].get(c, ZERO)) for w, o in terms]) for c in touched}
                )
        first = heavy + part.rows * part.weights
    outputs = [line.get(column, ZERO) for column in range(columns) for line in slopes]
    return merged.program([*outputs, *residuals])
