"""Straight-line programs: every value is assigned once, by one operation on earlier values.

This is the form in which kernels leave CasADi, and from which they are interpreted or printed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from typing import Self

from mbm.values import dataclass


class Operator(StrEnum):
    """The operations of straight-line programs: the name, how many values each takes, and what NumPy calls it.

    The name is that of CasADi's ``OP_…``; functions that C has in ``math.h`` have the name from there. Whoever
    evaluates or prints an operation goes by these, and writes out only what is no function there.
    """

    arguments: int
    numpy: str

    def __new__(cls, name: str, arguments: int = 1, numpy: str | None = None) -> Self:
        """One operation."""
        made = str.__new__(cls, name)
        made._value_ = name
        made.arguments = arguments
        made.numpy = numpy or name
        return made

    ADD = "add", 2
    SUB = "sub", 2, "subtract"
    MUL = "mul", 2, "multiply"
    DIV = "div", 2, "divide"
    NEG = "neg", 1, "negative"
    EXP = "exp"
    LOG = "log"
    POW = "pow", 2, "power"
    SQRT = "sqrt"
    SQUARE = "sq", 1, "square"
    TWICE = "twice"
    RECIPROCAL = "inv", 1, "reciprocal"
    SIN = "sin"
    COS = "cos"
    TAN = "tan"
    ASIN = "asin", 1, "arcsin"
    ACOS = "acos", 1, "arccos"
    ATAN = "atan", 1, "arctan"
    ATAN2 = "atan2", 2, "arctan2"
    SINH = "sinh"
    COSH = "cosh"
    TANH = "tanh"
    ASINH = "asinh", 1, "arcsinh"
    ACOSH = "acosh", 1, "arccosh"
    ATANH = "atanh", 1, "arctanh"
    LESS = "lt", 2, "less"
    LESS_EQUAL = "le", 2, "less_equal"
    EQUAL = "eq", 2, "equal"
    NOT_EQUAL = "ne", 2, "not_equal"
    NOT = "not", 1, "logical_not"
    AND = "and", 2, "logical_and"
    OR = "or", 2, "logical_or"
    SELECT = "if_else_zero", 2
    FLOOR = "floor"
    CEIL = "ceil"
    FMOD = "fmod", 2
    REMAINDER = "remainder", 2
    ABS = "fabs", 1, "abs"
    SIGN = "sign"
    COPYSIGN = "copysign", 2
    MIN = "fmin", 2
    MAX = "fmax", 2
    HYPOT = "hypot", 2
    LOG1P = "log1p"
    EXPM1 = "expm1"
    ERF = "erf"


LIBRARY = frozenset(Operator).difference(
    (Operator.ADD, Operator.SUB, Operator.MUL, Operator.DIV, Operator.NEG, Operator.SQUARE, Operator.TWICE),
    (Operator.RECIPROCAL, Operator.SIGN, Operator.LESS, Operator.LESS_EQUAL, Operator.EQUAL, Operator.NOT_EQUAL),
    (Operator.NOT, Operator.AND, Operator.OR, Operator.SELECT),
)
"""The functions of C's ``math.h``."""


@dataclass(frozen=True, slots=True)
class Instruction:
    """``value[target] = operator(value[arguments]…)``."""

    target: int
    operator: Operator
    arguments: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """A straight-line program over numbered values.

    ``inputs[i]`` is the number of the value that holds input i (-1: not used); ``constants`` are values known from the
    start; ``outputs[j]`` is the number of the value that output j takes (-1: output j is zero).
    """

    values: int
    inputs: tuple[int, ...]
    constants: tuple[tuple[int, float], ...]
    instructions: tuple[Instruction, ...]
    outputs: tuple[int, ...]

    def restricted(self, outputs: Sequence[int]) -> Program:
        """The program of some outputs, by their numbers, without what these do not need."""
        needed = {self.outputs[k] for k in outputs}
        instructions = []
        for each in reversed(self.instructions):
            if each.target in needed:
                needed.update(each.arguments)
                instructions.append(each)
        return replace(
            self,
            inputs=tuple(value if value in needed else -1 for value in self.inputs),
            constants=tuple(each for each in self.constants if each[0] in needed),
            instructions=tuple(reversed(instructions)),
            outputs=tuple(self.outputs[k] for k in outputs),
        )

    def depends_on(self, inputs: Sequence[bool]) -> list[bool]:
        """Which outputs depend on any of the inputs that are marked."""
        touched = {value for value, marked in zip(self.inputs, inputs, strict=False) if marked and value >= 0}
        for each in self.instructions:
            if not touched.isdisjoint(each.arguments):
                touched.add(each.target)
        return [value in touched for value in self.outputs]
