"""Straight-line programs: every value is assigned once, by one operation on earlier values.

This is the form in which kernels leave CasADi, and from which they are interpreted or printed.
"""

from __future__ import annotations

from enum import StrEnum

from mbm.values import dataclass


class Operator(StrEnum):
    """The operations of straight-line programs; the value is the printed name."""

    ADD = "add"
    SUB = "sub"
    MUL = "mul"
    DIV = "div"
    NEG = "neg"
    EXP = "exp"
    LOG = "log"
    POW = "pow"
    SQRT = "sqrt"
    SQUARE = "sq"
    TWICE = "twice"
    RECIPROCAL = "inv"
    SIN = "sin"
    COS = "cos"
    TAN = "tan"
    ASIN = "asin"
    ACOS = "acos"
    ATAN = "atan"
    ATAN2 = "atan2"
    SINH = "sinh"
    COSH = "cosh"
    TANH = "tanh"
    ASINH = "asinh"
    ACOSH = "acosh"
    ATANH = "atanh"
    LESS = "lt"
    LESS_EQUAL = "le"
    EQUAL = "eq"
    NOT_EQUAL = "ne"
    NOT = "not"
    AND = "and"
    OR = "or"
    SELECT = "if_else_zero"
    FLOOR = "floor"
    CEIL = "ceil"
    FMOD = "fmod"
    REMAINDER = "remainder"
    ABS = "fabs"
    SIGN = "sign"
    COPYSIGN = "copysign"
    MIN = "fmin"
    MAX = "fmax"
    HYPOT = "hypot"
    LOG1P = "log1p"
    EXPM1 = "expm1"
    ERF = "erf"


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
