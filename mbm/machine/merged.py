"""Several programs as one, which grows: equal operations on equal values are computed once."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import replace

from mbm.machine.program import Instruction, Operator, Program

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
