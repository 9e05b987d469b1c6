"""Straight-line programs as LLVM IR on vectors of `LANES` rows: the text of the instructions, value by value.

Comparisons are masks; they become 0.0 and 1.0 only where somebody adds them up. Elementary functions come from the
vector library of glibc (libmvec, at most 4 units in the last place) where the processor has what it needs, else from
the C library lane by lane; sine and cosine of one argument are computed together. Products and sums are not
contracted: what cancels exactly in one backend cancels in all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mbm.machine import sine_and_cosine
from mbm.machine.kinds import LANES
from mbm.machine.program import LIBRARY, Instruction, Operator, Program
from mbm.machine.vector_text import MASK, MINUS_ONE, ONE, VECTOR, ZERO, Text, number

BINARY: Mapping[Operator, str] = {
    Operator.ADD: "fadd",
    Operator.SUB: "fsub",
    Operator.MUL: "fmul",
    Operator.DIV: "fdiv",
}
COMPARISONS: Mapping[Operator, str] = {
    Operator.LESS: "olt",
    Operator.LESS_EQUAL: "ole",
    Operator.EQUAL: "oeq",
    Operator.NOT_EQUAL: "une",
}
ROUND = (Operator.SIN, Operator.COS)
LOGICAL: Mapping[Operator, str] = {Operator.AND: "and", Operator.OR: "or"}
INTRINSICS: Mapping[Operator, str] = {
    Operator.SQRT: "sqrt",
    Operator.FLOOR: "floor",
    Operator.CEIL: "ceil",
    Operator.ABS: "fabs",
    Operator.COPYSIGN: "copysign",
    Operator.MIN: "minnum",
    Operator.MAX: "maxnum",
}
SCALAR = (Operator.FMOD, Operator.REMAINDER)
"""What only the C library has: exact, by long division."""

VECTORISED = LIBRARY.difference(INTRINSICS, SCALAR)
"""Elementary functions: vector libraries may have them, the C library has all of them."""


def outputs_of(program: Program, inputs: list[str], text: Text) -> list[str]:
    """Append the instructions of ``program`` to ``text``; the names of its outputs.

    Args:
        program: what to compute.
        inputs: the names of vectors, one for each input.
        text: where the instructions go.
    """
    values = _Values(program, inputs, text)
    for instruction in program.instructions:
        values.compute(instruction)
    return [ZERO if value < 0 else values.real(value) for value in program.outputs]


class _Values:
    """The values of a program by number, as vectors of reals and as masks; local to one call."""

    def __init__(self, program: Program, inputs: list[str], text: Text) -> None:
        self._text = text
        self._reals = {value: number(constant) for value, constant in program.constants}
        self._masks: dict[int, str] = {}
        for name, value in zip(inputs, program.inputs, strict=True):
            if value >= 0:
                self._reals[value] = name
        self._angles = angles_of(program) if text.library is not None and text.library.fused else frozenset()
        self._pairs: dict[int, dict[Operator, str]] = {}

    def real(self, value: int) -> str:
        """A value as a vector of reals."""
        if value not in self._reals:
            self._reals[value] = self._chosen(self._masks[value], ONE, ZERO)
        return self._reals[value]

    def mask(self, value: int) -> str:
        """A value as a mask: where it is not zero; NaN is not."""
        if value not in self._masks:
            self._masks[value] = self._text.new(f"fcmp une {VECTOR} {self._reals[value]}, {ZERO}")
        return self._masks[value]

    def _chosen(self, mask: str, then: str, otherwise: str) -> str:
        return self._text.new(f"select {MASK} {mask}, {VECTOR} {then}, {VECTOR} {otherwise}")

    def compute(self, instruction: Instruction) -> None:
        """Append one instruction."""
        operator, text = instruction.operator, self._text
        made = self._as_mask(instruction)
        if made is not None:
            self._masks[instruction.target] = made
            return
        if operator is Operator.SELECT:
            test, value = instruction.arguments
            self._reals[instruction.target] = self._chosen(self.mask(test), self.real(value), ZERO)
            return
        arguments = [self.real(a) for a in instruction.arguments]
        if operator in ROUND and instruction.arguments[0] in self._angles:
            found = self._together(instruction.arguments[0])[operator]
        elif operator in BINARY:
            found = text.new(f"{BINARY[operator]} {VECTOR} {arguments[0]}, {arguments[1]}")
        elif operator in INTRINSICS:
            found = text.intrinsic(INTRINSICS[operator], arguments)
        elif operator in SCALAR:
            found = text.by_lane(operator.value, arguments)
        elif operator in _SHORT:
            found = _SHORT[operator](text, arguments[0])
        else:
            found = text.by_library(operator.value, arguments)
        self._reals[instruction.target] = found

    def _together(self, value: int) -> Mapping[Operator, str]:
        """Sine and cosine of a value."""
        if value not in self._pairs:
            found = sine_and_cosine.call(self._text, self.real(value))
            self._pairs[value] = dict(zip(ROUND, found, strict=True))
        return self._pairs[value]

    def _as_mask(self, instruction: Instruction) -> str | None:
        operator, text = instruction.operator, self._text
        if operator in COMPARISONS:
            left, right = (self.real(a) for a in instruction.arguments)
            return text.new(f"fcmp {COMPARISONS[operator]} {VECTOR} {left}, {right}")
        if operator is Operator.NOT:
            true = f"<{', '.join(['i1 true'] * LANES)}>"
            return text.new(f"xor {MASK} {self.mask(instruction.arguments[0])}, {true}")
        if operator in LOGICAL:
            left, right = (self.mask(a) for a in instruction.arguments)
            return text.new(f"{LOGICAL[operator]} {MASK} {left}, {right}")
        return None


def angles_of(program: Program) -> frozenset[int]:
    """The values of which both sine and cosine are wanted."""
    of = [{i.arguments[0] for i in program.instructions if i.operator is operator} for operator in ROUND]
    return frozenset(of[0] & of[1])


def _sign(text: Text, a: str) -> str:
    """−1, 1, or the argument itself: zeros keep their sign, NaN stays."""
    below = text.new(f"fcmp olt {VECTOR} {a}, {ZERO}")
    above = text.new(f"fcmp ogt {VECTOR} {a}, {ZERO}")
    positive = text.new(f"select {MASK} {above}, {VECTOR} {ONE}, {VECTOR} {a}")
    return text.new(f"select {MASK} {below}, {VECTOR} {MINUS_ONE}, {VECTOR} {positive}")


_SHORT: Mapping[Operator, Callable[[Text, str], str]] = {
    Operator.NEG: lambda text, a: text.new(f"fneg {VECTOR} {a}"),
    Operator.SQUARE: lambda text, a: text.new(f"fmul {VECTOR} {a}, {a}"),
    Operator.TWICE: lambda text, a: text.new(f"fadd {VECTOR} {a}, {a}"),
    Operator.RECIPROCAL: lambda text, a: text.new(f"fdiv {VECTOR} {ONE}, {a}"),
    Operator.SIGN: _sign,
}
