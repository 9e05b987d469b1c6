"""Straight-line programs → CasADi functions: the way back from `instructions`."""

from __future__ import annotations

from collections.abc import Mapping

import casadi

from mbm.machine.program import Operator, Program

CODES: Mapping[Operator, int] = {operator: getattr(casadi, f"OP_{operator.value.upper()}") for operator in Operator}
"""What CasADi calls the operations."""


def applied(operator: Operator, *arguments: casadi.SX) -> casadi.SX:
    """One operation."""
    apply = casadi.SX.unary if operator.arguments == 1 else casadi.SX.binary
    return apply(CODES[operator], *arguments)


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
        values[instruction.target] = applied(instruction.operator, *arguments)
    outputs = [casadi.SX(0) if value < 0 else values[value] for value in program.outputs]
    return casadi.Function(name, [inputs], [casadi.densify(casadi.vertcat(*outputs))])
