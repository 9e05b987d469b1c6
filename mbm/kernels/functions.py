"""Straight-line programs → CasADi functions: the way back from `instructions`."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import casadi

from mbm.target.program import Operator, Program

_FUNCTIONS: Mapping[Operator, Callable[..., casadi.SX]] = {
    Operator.ADD: lambda a, b: a + b,
    Operator.SUB: lambda a, b: a - b,
    Operator.MUL: lambda a, b: a * b,
    Operator.DIV: lambda a, b: a / b,
    Operator.NEG: lambda a: -a,
    Operator.EXP: casadi.exp,
    Operator.LOG: casadi.log,
    Operator.POW: casadi.power,
    Operator.SQRT: casadi.sqrt,
    Operator.SQUARE: lambda a: a * a,
    Operator.TWICE: lambda a: 2 * a,
    Operator.RECIPROCAL: lambda a: 1 / a,
    Operator.SIN: casadi.sin,
    Operator.COS: casadi.cos,
    Operator.TAN: casadi.tan,
    Operator.ASIN: casadi.asin,
    Operator.ACOS: casadi.acos,
    Operator.ATAN: casadi.atan,
    Operator.ATAN2: casadi.atan2,
    Operator.SINH: casadi.sinh,
    Operator.COSH: casadi.cosh,
    Operator.TANH: casadi.tanh,
    Operator.ASINH: casadi.asinh,
    Operator.ACOSH: casadi.acosh,
    Operator.ATANH: casadi.atanh,
    Operator.LESS: lambda a, b: a < b,
    Operator.LESS_EQUAL: lambda a, b: a <= b,
    Operator.EQUAL: lambda a, b: a == b,
    Operator.NOT_EQUAL: lambda a, b: a != b,
    Operator.NOT: casadi.logic_not,
    Operator.AND: casadi.logic_and,
    Operator.OR: casadi.logic_or,
    Operator.SELECT: lambda test, value: casadi.SX.binary(casadi.OP_IF_ELSE_ZERO, test, value),
    Operator.FLOOR: casadi.floor,
    Operator.CEIL: casadi.ceil,
    Operator.FMOD: casadi.fmod,
    Operator.REMAINDER: casadi.remainder,
    Operator.ABS: casadi.fabs,
    Operator.SIGN: casadi.sign,
    Operator.COPYSIGN: casadi.copysign,
    Operator.MIN: casadi.fmin,
    Operator.MAX: casadi.fmax,
    Operator.HYPOT: casadi.hypot,
    Operator.LOG1P: casadi.log1p,
    Operator.EXPM1: casadi.expm1,
    Operator.ERF: casadi.erf,
}


def function_of(name: str, program: Program) -> casadi.Function:
    """A CasADi function of one dense input vector and one dense output vector that computes what ``program`` does."""
    inputs = casadi.SX.sym("z", len(program.inputs))
    scalars = casadi.vertsplit(inputs) if program.inputs else []
    values: list[casadi.SX] = [casadi.SX(0)] * program.values
    for value, constant in program.constants:
        values[value] = casadi.SX(constant)
    for scalar, value in zip(scalars, program.inputs, strict=True):
        if value >= 0:
            values[value] = scalar
    for instruction in program.instructions:
        arguments = [values[a] for a in instruction.arguments]
        values[instruction.target] = _FUNCTIONS[instruction.operator](*arguments)
    outputs = [casadi.SX(0) if value < 0 else values[value] for value in program.outputs]
    return casadi.Function(name, [inputs], [casadi.densify(casadi.vertcat(*outputs))])
