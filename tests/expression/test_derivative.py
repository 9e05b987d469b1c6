"""Derivatives along a curve, against those of mpmath's numerical differentiation with 40 digits."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from mbm.expression.algebra import apply, number
from mbm.expression.derivative import LEVEL, derivatives, substituted
from mbm.expression.evaluate import evaluate
from mbm.expression.nodes import CONDITIONS, Apply, Component, Operation, Parameter

ROUNDING = 1e-13  # a few operations on doubles
S, X = Parameter("s"), Component("x")

PLACES = {Operation.ACOSH: 1.7, Operation.LOG: 1.7, Operation.SQRT: 1.7, Operation.ABS: -0.4}
UNARY = [
    operation
    for operation in Operation
    if operation.operator is not None and operation.operator.arguments == 1 and operation not in LEVEL
]
BINARY = {
    Operation.ADD: mpmath.fadd,
    Operation.SUBTRACT: mpmath.fsub,
    Operation.MULTIPLY: mpmath.fmul,
    Operation.DIVIDE: mpmath.fdiv,
    Operation.POWER: mpmath.power,
    Operation.HYPOT: mpmath.hypot,
    Operation.ATAN2: mpmath.atan2,
    Operation.MINIMUM: min,
    Operation.MAXIMUM: max,
}


def _value(node, at: float, x: float = 0.0) -> float:
    return float(evaluate((node,), lambda leaf: at if leaf is S else x)[0])


def _outside(operation: Operation, value: mpmath.mpf) -> mpmath.mpf:
    if operation is Operation.NEGATE:
        return -value
    return abs(value) if operation is Operation.ABS else getattr(mpmath, operation.value)(value)


@pytest.mark.parametrize("operation", UNARY)
def test_functions_of_one_number(operation):
    at = PLACES.get(operation, 0.4)
    (found,) = derivatives((apply(operation, apply(Operation.MULTIPLY, S, S)),), S)
    if operation is Operation.ABS:
        (found,) = derivatives((apply(operation, S),), S)
    with mpmath.workdps(40):
        inner = (lambda s: s) if operation is Operation.ABS else (lambda s: s * s)
        wanted = float(mpmath.diff(lambda s: _outside(operation, inner(s)), mpmath.mpf(at)))
    assert _value(found, at) == pytest.approx(wanted, rel=ROUNDING)


@pytest.mark.parametrize("operation", BINARY)
@pytest.mark.parametrize("at", [0.3, 1.9])
def test_functions_of_two_numbers(operation, at):
    first, second = apply(Operation.SIN, S), apply(Operation.SQRT, S)
    (found,) = derivatives((apply(operation, first, second),), S)
    with mpmath.workdps(40):
        function = BINARY[operation]
        wanted = float(mpmath.diff(lambda s: function(mpmath.sin(s), mpmath.sqrt(s)), mpmath.mpf(at)))
    assert _value(found, at) == pytest.approx(wanted, rel=ROUNDING)


def test_a_constant_power_of_a_negative_number():
    (found,) = derivatives((apply(Operation.POWER, S, number(3)),), S)
    assert _value(found, -2.0) == 12.0


def test_choices_go_by_the_branch_taken():
    test = Apply(Operation.LESS, (S, number(1)))
    (found,) = derivatives((apply(Operation.IF, test, apply(Operation.EXP, S), X),), S)
    assert _value(found, 0.5, x=7.0) == pytest.approx(np.exp(0.5), rel=ROUNDING)
    assert _value(found, 1.5, x=7.0) == 0.0


def test_what_does_not_depend_on_the_parameter_is_level():
    assert [_value(d, 0.3) for d in derivatives((X, number(3), apply(Operation.FLOOR, S)), S)] == [0.0, 0.0, 0.0]


def test_every_operation_has_a_rule():
    for operation in Operation:
        if operation in CONDITIONS or operation in (Operation.IF, Operation.EXTERNAL):
            continue
        count = 1 if operation.operator is None else operation.operator.arguments
        derivatives((Apply(operation, (S,) * count),), S)


def test_substitution_leaves_the_rest_as_it_is():
    inner = apply(Operation.SIN, X)
    node = apply(Operation.ADD, inner, S)
    (found,) = substituted((node,), {S: number(2)})
    assert isinstance(found, Apply)
    assert found.arguments[0] is inner
    assert _value(found, 0.0, x=0.5) == pytest.approx(np.sin(0.5) + 2, rel=ROUNDING)
