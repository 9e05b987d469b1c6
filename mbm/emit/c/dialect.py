"""How C99 writes the operations of straight-line programs."""

from __future__ import annotations

from collections.abc import Mapping

from mbm.emit.c.text import bare
from mbm.emit.reserved import RESERVED
from mbm.emit.statements import ARITHMETIC, Dialect, Shape
from mbm.target.c import number
from mbm.target.program import Operator

_CALLED: Mapping[Operator, str] = {
    Operator.EXP: "exp",
    Operator.LOG: "log",
    Operator.SQRT: "sqrt",
    Operator.SIN: "sin",
    Operator.COS: "cos",
    Operator.TAN: "tan",
    Operator.ASIN: "asin",
    Operator.ACOS: "acos",
    Operator.ATAN: "atan",
    Operator.SINH: "sinh",
    Operator.COSH: "cosh",
    Operator.TANH: "tanh",
    Operator.ASINH: "asinh",
    Operator.ACOSH: "acosh",
    Operator.ATANH: "atanh",
    Operator.FLOOR: "floor",
    Operator.CEIL: "ceil",
    Operator.ABS: "fabs",
    Operator.LOG1P: "log1p",
    Operator.EXPM1: "expm1",
    Operator.ERF: "erf",
    Operator.SIGN: "kernel_sign",
    Operator.SQUARE: "kernel_square",
    Operator.NOT: "kernel_not",
}
_CALLED_WITH_TWO: Mapping[Operator, str] = {
    Operator.POW: "pow",
    Operator.ATAN2: "atan2",
    Operator.FMOD: "fmod",
    Operator.REMAINDER: "remainder",
    Operator.COPYSIGN: "copysign",
    Operator.MIN: "fmin",
    Operator.MAX: "fmax",
    Operator.HYPOT: "hypot",
    Operator.LESS: "kernel_less",
    Operator.LESS_EQUAL: "kernel_less_equal",
    Operator.EQUAL: "kernel_equal",
    Operator.NOT_EQUAL: "kernel_not_equal",
    Operator.AND: "kernel_and",
    Operator.OR: "kernel_or",
    Operator.SELECT: "kernel_select",
}

HELPERS: Mapping[str, str] = {
    "kernel_sign": "(double a) { return a > 0.0 ? 1.0 : a < 0.0 ? -1.0 : a; }",
    "kernel_square": "(double a) { return a * a; }",
    "kernel_not": "(double a) { return a == 0.0 ? 1.0 : 0.0; }",
    "kernel_less": "(double a, double b) { return a < b ? 1.0 : 0.0; }",
    "kernel_less_equal": "(double a, double b) { return a <= b ? 1.0 : 0.0; }",
    "kernel_equal": "(double a, double b) { return a == b ? 1.0 : 0.0; }",
    "kernel_not_equal": "(double a, double b) { return a != b ? 1.0 : 0.0; }",
    "kernel_and": "(double a, double b) { return a != 0.0 && b != 0.0 ? 1.0 : 0.0; }",
    "kernel_or": "(double a, double b) { return a != 0.0 || b != 0.0 ? 1.0 : 0.0; }",
    "kernel_select": "(double test, double value) { return test != 0.0 ? value : 0.0; }",
}
"""Functions that C does not have; a file holds those that it uses."""

DIALECT = Dialect(
    shapes={
        **ARITHMETIC,
        **{operator: Shape(f"{name}({{0}})") for operator, name in _CALLED.items()},
        **{operator: Shape(f"{name}({{0}}, {{1}})") for operator, name in _CALLED_WITH_TWO.items()},
    },
    number=number,
    reserved=RESERVED | frozenset(_CALLED.values()) | frozenset(_CALLED_WITH_TWO.values()),
)


def helpers(text: str) -> str:
    """The definitions of the helpers that ``text`` calls."""
    code = bare(text)
    return "".join(f"static double {name}{body}\n" for name, body in HELPERS.items() if f"{name}(" in code)
