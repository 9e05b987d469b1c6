"""The instruction stream of a CasADi function as a straight-line program; reused work slots become single values."""

from __future__ import annotations

from collections.abc import Mapping

import casadi

from mbm.kernels.lowering import UnsupportedOperationError
from mbm.kernels.serialised import CODES
from mbm.machine.program import Instruction, Operator, Program

_OPERATORS: Mapping[int, Operator] = {
    **{code: operator for operator, code in CODES.items()},
    casadi.OP_CONSTPOW: Operator.POW,
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
