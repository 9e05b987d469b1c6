"""Numbers for expressions: every operation against the standard library, and conditions with missing numbers."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from mbm.expression.evaluate import evaluate
from mbm.expression.nodes import CONDITIONS, Apply, Number, Operation
from tests.expression.texts import COLUMNS, expression

X, Y, Z = COLUMNS.values()
ANY, ABOVE, UNIT, BEYOND = (-20.0, 20.0), (1e-3, 50.0), (-0.999, 0.999), (1.0, 40.0)
REFERENCE = {
    Operation.ADD: (lambda a, b: a + b, ANY, ANY),
    Operation.SUBTRACT: (lambda a, b: a - b, ANY, ANY),
    Operation.NEGATE: (lambda a: -a, ANY),
    Operation.MULTIPLY: (lambda a, b: a * b, ANY, ANY),
    Operation.DIVIDE: (lambda a, b: a / b, ANY, ABOVE),
    Operation.POWER: (math.pow, ABOVE, (-5.0, 5.0)),
    Operation.SQRT: (math.sqrt, ABOVE),
    Operation.EXP: (math.exp, ANY),
    Operation.LOG: (math.log, ABOVE),
    Operation.ABS: (math.fabs, ANY),
    Operation.SIGN: (lambda a: math.copysign(1, a) if a else 0, ANY),
    Operation.FLOOR: (math.floor, ANY),
    Operation.MINIMUM: (min, ANY, ANY),
    Operation.MAXIMUM: (max, ANY, ANY),
    Operation.HYPOT: (math.hypot, ANY, ANY),
    Operation.SIN: (math.sin, ANY),
    Operation.COS: (math.cos, ANY),
    Operation.TAN: (math.tan, ANY),
    Operation.ASIN: (math.asin, UNIT),
    Operation.ACOS: (math.acos, UNIT),
    Operation.ATAN: (math.atan, ANY),
    Operation.ATAN2: (math.atan2, ANY, ANY),
    Operation.SINH: (math.sinh, ANY),
    Operation.COSH: (math.cosh, ANY),
    Operation.TANH: (math.tanh, ANY),
    Operation.ASINH: (math.asinh, ANY),
    Operation.ACOSH: (math.acosh, BEYOND),
    Operation.ATANH: (math.atanh, UNIT),
    Operation.WRAP: (lambda a: math.remainder(a, 2 * math.pi), ANY),
    Operation.AS_ANGLE: (lambda a: a, ANY),
    Operation.HELD: (lambda a: a, ANY),
    Operation.LESS: (lambda a, b: a < b, ANY, ANY),
    Operation.LESS_EQUAL: (lambda a, b: a <= b, ANY, ANY),
    Operation.EQUAL: (lambda a, b: a == b, ANY, ANY),
    Operation.FINITE: (math.isfinite, ANY),
}
"""The operation in the standard library, and the range of each argument."""
LOGIC = {Operation.NOT, Operation.AND, Operation.OR, Operation.IF}


def values(node, **columns):
    return np.asarray(evaluate((node,), lambda leaf: columns[leaf.name])[0])


def test_no_operation_is_left_out():
    assert set(REFERENCE) | LOGIC | {Operation.EXTERNAL} == set(Operation)


@pytest.mark.parametrize("operation", REFERENCE, ids=lambda o: o.value)
def test_operation_is_that_of_the_standard_library(operation):
    function, *ranges = REFERENCE[operation]
    random = np.random.default_rng(len(operation.value))
    table = [random.uniform(low, high, 200) for low, high in ranges]
    if operation in (Operation.EQUAL, Operation.LESS, Operation.LESS_EQUAL, Operation.MINIMUM):
        table[1][:50] = table[0][:50]
    found = values(Apply(operation, (X, Y)[: len(ranges)]), **dict(zip("xy", table, strict=False)))
    expected = [float(function(*row)) for row in zip(*table, strict=True)]
    # Two libraries round elementary functions to within a unit or two of the last place; `wrap` subtracts a multiple
    # of 2π, whose rounding is that of the argument.
    np.testing.assert_allclose(found, expected, rtol=2e-15, atol=1e-14 if operation is Operation.WRAP else 1e-300)


@given(x=st.floats(-1e6, 1e6), y=st.floats(-1e6, 1e6))
def test_rows_do_not_see_one_another(x, y):
    node = expression("(+ (* x y) (if (< x y) (sin x) (abs y)))")
    alone = [float(values(node, x=a, y=b)) for a, b in ((x, y), (y, x))]
    together = values(node, x=np.array([x, y]), y=np.array([y, x]))
    # NumPy's sine of one number and of many may differ in the last place.
    np.testing.assert_allclose(together, alone, rtol=1e-15, atol=1e-15)


TRUTH = {0.0: False, 1.0: True, math.nan: None}
KLEENE_AND = {(a, b): False if False in (a, b) else None if None in (a, b) else True
              for a, b in itertools.product((True, False, None), repeat=2)}  # fmt: skip


def truth(number):
    return None if math.isnan(number) else bool(number)


@pytest.mark.parametrize(("a", "b"), list(itertools.product(TRUTH, TRUTH)))
def test_logic_is_three_valued(a, b):
    """Kleene (1952), §64: what the missing number cannot change is decided."""
    conditions = [Apply(Operation.LESS, (X, Number(0.5))), Apply(Operation.LESS, (Y, Number(0.5)))]
    given_values = [math.nan if v is None else (0.0 if v else 1.0) for v in (TRUTH[a], TRUTH[b])]
    columns = {"x": np.array([given_values[0]]), "y": np.array([given_values[1]])}
    both = truth(values(Apply(Operation.AND, tuple(conditions)), **columns)[0])
    either = truth(values(Apply(Operation.OR, tuple(conditions)), **columns)[0])
    neither = truth(values(Apply(Operation.NOT, (conditions[0],)), **columns)[0])
    opposite = {True: False, False: True, None: None}
    assert both == KLEENE_AND[TRUTH[a], TRUTH[b]]
    assert either == opposite[KLEENE_AND[opposite[TRUTH[a]], opposite[TRUTH[b]]]]
    assert neither == opposite[TRUTH[a]]


@pytest.mark.parametrize("operation", sorted(CONDITIONS - LOGIC - {Operation.FINITE}))
def test_comparison_with_a_missing_number_is_undecided(operation):
    found = values(
        Apply(operation, (X, Y)), x=np.array([math.nan, 1.0, math.nan]), y=np.array([1.0, math.nan, math.nan])
    )
    assert np.isnan(found).all()


def test_finite_is_always_decided():
    found = values(expression("(finite x)"), x=np.array([math.nan, math.inf, -math.inf, 0.0]))
    assert found.tolist() == [0, 0, 0, 1]


def test_choice_takes_the_branch_that_holds_whatever_the_other_is():
    node = expression("(if (< 0 x) (log x) (if (= x 0) y (/ 1 0.5)))")
    found = values(node, x=np.array([-1.0, 0.0, math.e, math.nan]), y=np.array([math.nan, 7.0, math.nan, 1.0]))
    np.testing.assert_array_equal(found[:3], [2.0, 7.0, 1.0])
    assert math.isnan(found[3])


def test_guard_against_missing_numbers_decides():
    node = expression("(and (finite x) (< x 1))")
    assert values(node, x=np.array([math.nan, 0.0, 2.0])).tolist() == [0, 1, 0]


def test_values_outside_a_domain_are_those_of_ieee_754_without_a_warning():
    found = [float(values(expression(t), x=np.float64(-1.0))) for t in ("(sqrt x)", "(log (+ x 1))", "(/ 1 (+ x 1))")]
    assert math.isnan(found[0])
    assert found[1:] == [-math.inf, math.inf]


def test_several_roots_share_their_parts():
    seen = []
    shared = expression("(+ x 1)")
    roots = (Apply(Operation.SIN, (shared,)), Apply(Operation.COS, (shared,)))
    sine, cosine = evaluate(roots, lambda leaf: seen.append(leaf) or 1.0)
    assert (sine, cosine) == (math.sin(2), math.cos(2))
    assert len(seen) == 1
