"""Expressions as text: what is printed reads back to an expression of the same value, angle-ness and dimension."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, reject, settings, strategies as st

from mbm.expression.algebra import UndefinedValueError, apply
from mbm.expression.evaluate import evaluate
from mbm.expression.forms import to_form
from mbm.expression.inference import Declared, Inference
from mbm.expression.nodes import Component, Constant, LiteralMember, Number, Operation
from mbm.expression.units import NONE, parse_unit
from mbm.text.printer import print_form
from mbm.text.types import MbmError, Source, Span
from tests.expression.texts import COLUMNS, expression

PLACE = Span(source=Source("here", "here"), start=0, end=4)
CONDITIONS = (Operation.LESS, Operation.LESS_EQUAL, Operation.EQUAL)
UNARY = (
    Operation.NEGATE, Operation.ABS, Operation.SIGN, Operation.FLOOR, Operation.SIN, Operation.COS, Operation.TANH,
    Operation.ATAN, Operation.ASINH, Operation.EXP, Operation.SQRT, Operation.LOG, Operation.AS_ANGLE, Operation.HELD,
)  # fmt: skip
BINARY = (
    Operation.ADD, Operation.SUBTRACT, Operation.MULTIPLY, Operation.DIVIDE, Operation.MINIMUM, Operation.MAXIMUM,
    Operation.HYPOT, Operation.ATAN2, Operation.POWER,
)  # fmt: skip
NUMBERS = st.one_of(
    st.integers(-9, 9), st.fractions(-3, 3, max_denominator=9), st.floats(-1e3, 1e3, allow_subnormal=False)
)


def printed(node):
    return print_form(to_form(node, PLACE))


def applied(operation, *arguments):
    try:
        return apply(operation, *arguments)
    except UndefinedValueError:
        return arguments[0]


def extended(inner):
    unary = st.builds(applied, st.sampled_from(UNARY), inner)
    binary = st.builds(applied, st.sampled_from(BINARY), inner, inner)
    test = st.builds(applied, st.sampled_from(CONDITIONS), inner, st.sampled_from(list(COLUMNS.values())))
    logic = st.builds(applied, st.sampled_from((Operation.AND, Operation.OR)), test, test)
    tests = test | logic | st.builds(lambda a: applied(Operation.NOT, a), test)
    return unary | binary | st.builds(lambda t, a, b: applied(Operation.IF, t, a, b), tests, inner, inner)


EXPRESSIONS = st.recursive(
    st.sampled_from(list(COLUMNS.values())) | st.builds(Number, NUMBERS), extended, max_leaves=12
)


@settings(max_examples=150)
@given(node=EXPRESSIONS)
def test_printed_expression_reads_back_to_the_same_numbers(node):
    text = printed(node)
    try:
        again = expression(text)
    except MbmError as error:  # `(/ (sin 1) 0)`: reading folds the numbers that the tree left alone, and says so
        assert error.diagnostics[0].code.name == "undefined-value"
        reject()
    columns = {"x": np.array([0.3, -2.0, 7.5]), "y": np.array([1.25, 0.0, -4.0]), "z": np.array([2.0, 2.0, -1.0])}
    first, second = (np.asarray(evaluate((n,), lambda leaf: columns[leaf.name])[0], dtype=float) for n in (node, again))
    # Reading folds what the tree left alone (`(* 1 (sin 2))`), by the C library instead of NumPy: a last place each,
    # which a difference of nearly equal numbers or a floor may enlarge; the values themselves are printed in full.
    np.testing.assert_allclose(first, second, rtol=1e-9, atol=1e-9)
    assert again.angle == node.angle


@pytest.mark.parametrize("value", [0, -7, 10**30, Fraction(-3, 7), 0.1, 1e-300, 2.5e22, -math.pi, 5.0])
def test_numbers_keep_every_digit_and_their_kind(value):
    again = expression(printed(Number(value)))
    assert (again.value, type(again.value)) == (value, type(value))
    assert again.dimension is None


@pytest.mark.parametrize("unit", ["m", "s^-1", "m/s^2", "kg*m^2/s^3/A", "1/m"])
@pytest.mark.parametrize("value", [2, Fraction(1, 3), 1e-7, 6.25e23])
def test_quantities_keep_their_dimension(unit, value):
    again = expression(printed(Number(value, parse_unit(unit).dimension)))
    assert again.value == pytest.approx(float(value), rel=1e-15)
    assert again.dimension == parse_unit(unit).dimension


@pytest.mark.parametrize("text", ["(sqrt 2m)", "(^ 2kg 1/3)", "(/ (sqrt 3s) (^ 2m 5/6))", "(* 2s (sqrt 2m))"])
def test_powers_of_units_that_are_not_whole_can_be_read(text):
    node = expression(text)
    again = expression(printed(node))
    found = Inference(Declared(components={}, columns={}, same_column={}))
    assert found.dimension(again) == found.dimension(node)
    (first,), (second,) = (evaluate((n,), lambda leaf: math.nan) for n in (node, again))
    # One root more.
    assert float(first) == pytest.approx(float(second), rel=1e-15)


@pytest.mark.parametrize(
    ("node", "text"),
    [
        (Constant("h", 1.0), "h"),
        (Constant("v[2]", 1.0), "(v 2)"),
        (Constant("M[1,3]", 1.0), "(M 1 3)"),
        (Component("p", (2,)), "(p 2)"),
        (Component("T", (2, 1)), "(T 2 1)"),
        (Component("q", (), LiteralMember(key="waist")), '(q "waist")'),
        (Component("q", (3,), LiteralMember(key=2.0)), "((q 2) 3)"),
        (Number(1.5, NONE), "1.5"),
    ],
)
def test_leaves_are_written_as_people_write_them(node, text):
    assert printed(node) == text
