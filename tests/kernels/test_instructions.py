"""Every instruction read from CasADi: run by NumPy with CasADi's result, and met in kernels or known not to be."""

from __future__ import annotations

import casadi
import numpy as np
import pytest

from mbm.kernels.backends.numpy_stream import run, steps_of
from mbm.kernels.instructions import _OPERATORS, program_of
from mbm.kernels.lowering import UnsupportedOperationError
from mbm.machine.program import Operator
from tests.symbolic.derivatives import single
from tests.symbolic.test_operation_derivatives import CASES

FUNCTIONS = {
    casadi.OP_ADD: lambda a, b: a + b,
    casadi.OP_SUB: lambda a, b: a - b,
    casadi.OP_MUL: lambda a, b: a * b,
    casadi.OP_DIV: lambda a, b: a / b,
    casadi.OP_NEG: lambda a, b: -a,
    casadi.OP_EXP: lambda a, b: casadi.exp(a),
    casadi.OP_LOG: lambda a, b: casadi.log(a),
    casadi.OP_POW: casadi.power,
    casadi.OP_CONSTPOW: lambda a, b: casadi.constpow(a, 2.5),
    casadi.OP_SQRT: lambda a, b: casadi.sqrt(a),
    casadi.OP_SQ: lambda a, b: a * a,
    casadi.OP_TWICE: lambda a, b: 2 * a,
    casadi.OP_INV: lambda a, b: 1 / a,
    casadi.OP_SIN: lambda a, b: casadi.sin(a),
    casadi.OP_COS: lambda a, b: casadi.cos(a),
    casadi.OP_TAN: lambda a, b: casadi.tan(a),
    casadi.OP_ASIN: lambda a, b: casadi.asin(a),
    casadi.OP_ACOS: lambda a, b: casadi.acos(a),
    casadi.OP_ATAN: lambda a, b: casadi.atan(a),
    casadi.OP_ATAN2: casadi.atan2,
    casadi.OP_SINH: lambda a, b: casadi.sinh(a),
    casadi.OP_COSH: lambda a, b: casadi.cosh(a),
    casadi.OP_TANH: lambda a, b: casadi.tanh(a),
    casadi.OP_ASINH: lambda a, b: casadi.asinh(a),
    casadi.OP_ACOSH: lambda a, b: casadi.acosh(a),
    casadi.OP_ATANH: lambda a, b: casadi.atanh(a),
    casadi.OP_LT: lambda a, b: a < b,
    casadi.OP_LE: lambda a, b: a <= b,
    casadi.OP_EQ: lambda a, b: a == b,
    casadi.OP_NE: lambda a, b: a != b,
    casadi.OP_NOT: lambda a, b: casadi.logic_not(a),
    casadi.OP_AND: casadi.logic_and,
    casadi.OP_OR: casadi.logic_or,
    casadi.OP_IF_ELSE_ZERO: lambda a, b: casadi.if_else(a, b, 0),
    casadi.OP_FLOOR: lambda a, b: casadi.floor(a),
    casadi.OP_CEIL: lambda a, b: casadi.ceil(a),
    casadi.OP_FMOD: casadi.fmod,
    casadi.OP_REMAINDER: casadi.remainder,
    casadi.OP_FABS: lambda a, b: casadi.fabs(a),
    casadi.OP_SIGN: lambda a, b: casadi.sign(a),
    casadi.OP_COPYSIGN: casadi.copysign,
    casadi.OP_FMIN: casadi.fmin,
    casadi.OP_FMAX: casadi.fmax,
    casadi.OP_HYPOT: casadi.hypot,
    casadi.OP_LOG1P: lambda a, b: casadi.log1p(a),
    casadi.OP_EXPM1: lambda a, b: casadi.expm1(a),
    casadi.OP_ERF: lambda a, b: casadi.erf(a),
}
NEVER_FROM_THE_LANGUAGE = {
    Operator.FMOD: "`mod` is a − b·floor(a/b), which has the sign of b",
    Operator.REMAINDER: "`wrap` is made of ceil, whose half turns fall on +π",
    Operator.COPYSIGN: "there is no such function, and no derivative makes one",
    Operator.HYPOT: "a square root of squares: its derivative shares the root",
    Operator.LOG1P: "there is no such function",
    Operator.EXPM1: "there is no such function",
    Operator.ERF: "there is no such function",
    Operator.NOT_EQUAL: "`not` of `=` stays two operations",
}
"""Operators that no kernel of the language holds; kernels of extensions may."""


def by_numpy(function, inputs):
    program = program_of(function)
    outputs = np.empty((len(inputs), function.numel_out(0)))
    run(program, steps_of(program), inputs, outputs)
    return outputs


def test_every_instruction_is_tried():
    assert set(FUNCTIONS) == set(_OPERATORS)


@pytest.mark.parametrize("code", FUNCTIONS, ids=lambda c: _OPERATORS[c].value)
def test_instruction(code):
    inputs = casadi.SX.sym("z", 2)
    function = casadi.Function("f", [inputs], [FUNCTIONS[code](inputs[0], inputs[1])])
    found = {function.instruction_id(k) for k in range(function.n_instructions())}
    assert code in found
    table = np.array([[a, b] for a in (-2.0, -0.5, 0.0, 0.25, 1.0, 1.5, np.nan) for b in (-1.5, 0.0, 0.25, 1.0)])
    expected = [float(function(row)) for row in table]
    # A unit or two in the last place between two libraries.
    np.testing.assert_allclose(by_numpy(function, table)[:, 0], expected, rtol=1e-15, atol=1e-300)


def test_every_operator_is_met_in_kernels_or_known_not_to_be():
    met = set()
    for text in (t for texts in CASES.values() for t in texts):
        _, kernel = single(text)
        for program in (kernel.value_program, kernel.jacobian_program):
            met |= {instruction.operator for instruction in program.instructions}
    assert met | set(NEVER_FROM_THE_LANGUAGE) == set(Operator)
    assert not met & set(NEVER_FROM_THE_LANGUAGE)


def test_unknown_instruction_is_an_internal_fault():
    inputs = casadi.SX.sym("z", 1)
    function = casadi.Function("f", [inputs], [casadi.erfinv(inputs)])
    with pytest.raises(UnsupportedOperationError):
        program_of(function)


def test_outputs_that_are_zero_inputs_that_are_not_used_and_repeated_outputs():
    inputs = casadi.SX.sym("z", 3)
    function = casadi.Function("f", [inputs], [casadi.vertcat(inputs[2], 0, inputs[2] + 1, inputs[2], 7)])
    rows = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    assert by_numpy(function, rows).tolist() == [[3, 0, 4, 3, 7], [6, 0, 7, 6, 7]]


def test_work_slots_that_are_used_again_keep_their_values_apart():
    """A long chain of swaps: CasADi reuses its slots, the program numbers every value."""
    inputs = casadi.SX.sym("z", 2)
    a, b = inputs[0], inputs[1]
    for _ in range(20):
        a, b = casadi.sin(a) + b, a * b
    function = casadi.Function("f", [inputs], [casadi.vertcat(a, b)])
    program = program_of(function)
    targets = [instruction.target for instruction in program.instructions]
    assert len(set(targets)) == len(targets)
    rows = np.random.default_rng(0).uniform(-1, 1, (4, 2))
    expected = [np.asarray(function(row)).reshape(-1) for row in rows]
    np.testing.assert_allclose(by_numpy(function, rows), expected, rtol=1e-13, atol=1e-15)
