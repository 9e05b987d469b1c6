"""The instruction stream of a CasADi function as a straight-line program; reused work slots become single values."""

from __future__ import annotations

from collections.abc import Mapping

import casadi

from mbm.kernels.lowering import UnsupportedOperationError
from mbm.target.program import Instruction, Operator, Program

_OPERATORS: Mapping[int, Operator] = {
    casadi.OP_ADD: Operator.ADD,
    casadi.OP_SUB: Operator.SUB,
    casadi.OP_MUL: Operator.MUL,
    casadi.OP_DIV: Operator.DIV,
    casadi.OP_NEG: Operator.NEG,
    casadi.OP_EXP: Operator.EXP,
    casadi.OP_LOG: Operator.LOG,
    casadi.OP_POW: Operator.POW,
    casadi.OP_CONSTPOW: Operator.POW,
    casadi.OP_SQRT: Operator.SQRT,
    casadi.OP_SQ: Operator.SQUARE,
    casadi.OP_TWICE: Operator.TWICE,
    casadi.OP_INV: Operator.RECIPROCAL,
    casadi.OP_SIN: Operator.SIN,
    casadi.OP_COS: Operator.COS,
    casadi.OP_TAN: Operator.TAN,
    casadi.OP_ASIN: Operator.ASIN,
    casadi.OP_ACOS: Operator.ACOS,
    casadi.OP_ATAN: Operator.ATAN,
    casadi.OP_ATAN2: Operator.ATAN2,
    casadi.OP_SINH: Operator.SINH,
    casadi.OP_COSH: Operator.COSH,
    casadi.OP_TANH: Operator.TANH,
    casadi.OP_ASINH: Operator.ASINH,
    casadi.OP_ACOSH: Operator.ACOSH,
    casadi.OP_ATANH: Operator.ATANH,
    casadi.OP_LT: Operator.LESS,
    casadi.OP_LE: Operator.LESS_EQUAL,
    casadi.OP_EQ: Operator.EQUAL,
    casadi.OP_NE: Operator.NOT_EQUAL,
    casadi.OP_NOT: Operator.NOT,
    casadi.OP_AND: Operator.AND,
    casadi.OP_OR: Operator.OR,
    casadi.OP_IF_ELSE_ZERO: Operator.SELECT,
    casadi.OP_FLOOR: Operator.FLOOR,
    casadi.OP_CEIL: Operator.CEIL,
    casadi.OP_FMOD: Operator.FMOD,
    casadi.OP_REMAINDER: Operator.REMAINDER,
    casadi.OP_FABS: Operator.ABS,
    casadi.OP_SIGN: Operator.SIGN,
    casadi.OP_COPYSIGN: Operator.COPYSIGN,
    casadi.OP_FMIN: Operator.MIN,
    casadi.OP_FMAX: Operator.MAX,
    casadi.OP_HYPOT: Operator.HYPOT,
    casadi.OP_LOG1P: Operator.LOG1P,
    casadi.OP_EXPM1: Operator.EXPM1,
    casadi.OP_ERF: Operator.ERF,
}


def program_of(function: casadi.Function) -> Program:
    """The straight-line program of a function with one dense input and one dense output vector.

    Raises:
        UnsupportedOperationError: an instruction without a counterpart.

    """
    slots: dict[int, int] = {}
    inputs = [-1] * function.numel_in(0)
    outputs = [-1] * function.numel_out(0)
    constants: list[tuple[int, float]] = []
    instructions: list[Instruction] = []
    values = 0
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        sources, targets = function.instruction_input(k), function.instruction_output(k)
        if code == casadi.OP_OUTPUT:
            outputs[targets[1]] = slots[sources[0]]
            continue
        if code == casadi.OP_ASSIGN:
            slots[targets[0]] = slots[sources[0]]
            continue
        if code == casadi.OP_INPUT:
            inputs[sources[1]] = values
        elif code == casadi.OP_CONST:
            constants.append((values, float(function.instruction_constant(k))))
        elif code in _OPERATORS:
            arguments = tuple(slots[s] for s in sources)
            instructions.append(Instruction(values, _OPERATORS[code], arguments))
        else:
            raise UnsupportedOperationError(f"instruction {code}")
        slots[targets[0]] = values
        values += 1
    return Program(
        values=values,
        inputs=tuple(inputs),
        constants=tuple(constants),
        instructions=tuple(instructions),
        outputs=tuple(outputs),
    )
