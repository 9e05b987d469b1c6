"""Folding of constants: exact where numbers are, undefined where they have no value, and silent about nothing."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import given, settings, strategies as st

from mbm.expression.algebra import MAXIMUM_BITS, UndefinedValueError, apply, constant_value, number, wrap_angle
from mbm.expression.nodes import Apply, Column, Component, Constant, Number, Operation
from mbm.expression.units import NONE, base
from tests.expression.texts import expression

M, S = base("m"), base("s")
X = Column("t", "x")
THETA = Component("theta", angle=True)
FRACTIONS = st.fractions(min_value=-1000, max_value=1000, max_denominator=1000)


@given(a=FRACTIONS, b=FRACTIONS)
def test_rational_arithmetic_is_exact(a, b):
    for operation, exact in (
        (Operation.ADD, a + b),
        (Operation.SUBTRACT, a - b),
        (Operation.MULTIPLY, a * b),
        (Operation.MINIMUM, min(a, b)),
        (Operation.MAXIMUM, max(a, b)),
    ):
        folded = apply(operation, number(a), number(b))
        assert isinstance(folded, Number)
        assert folded.value == exact
        assert not isinstance(folded.value, float)
    if b:
        assert apply(Operation.DIVIDE, number(a), number(b)).value == a / b
    assert apply(Operation.FLOOR, number(a)).value == math.floor(a)
    assert apply(Operation.ABS, number(a)).value == abs(a)
    assert apply(Operation.SIGN, number(a)).value == (a > 0) - (a < 0)


@given(a=FRACTIONS.filter(bool), power=st.integers(-6, 6))
def test_whole_powers_of_fractions_are_exact(a, power):
    folded = apply(Operation.POWER, number(a), number(power)).value
    assert folded == a**power
    assert not isinstance(folded, float)


@given(root=st.integers(0, 10**40))
def test_roots_of_squares_are_exact(root):
    assert apply(Operation.SQRT, number(root * root)).value == root


@pytest.mark.parametrize("text", ["(/ 6 3)", "(* 2/3 3)", "(+ 1/2 3/2)", "(sqrt 4)", "(^ 1/2 -1)"])
def test_whole_results_are_integers_that_may_index(text):
    assert expression(text).value == 2
    assert isinstance(expression(text).value, int)


@pytest.mark.parametrize("quarter", range(-8, 9))
def test_right_angles_are_exact_within_two_turns(quarter):
    angle = number(quarter * (math.pi / 2), None, NONE)
    assert apply(Operation.SIN, angle).value == (0, 1, 0, -1)[quarter % 4]
    assert apply(Operation.COS, angle).value == (1, 0, -1, 0)[quarter % 4]
    assert expression(f"(sin {90 * quarter}deg)").value == (0, 1, 0, -1)[quarter % 4]


@given(st.floats(-1e6, 1e6).filter(lambda a: a % (math.pi / 2) != 0))
def test_other_angles_are_those_of_the_libm(angle):
    assert apply(Operation.SIN, number(angle)).value == math.sin(angle)
    assert apply(Operation.COS, number(angle)).value == math.cos(angle)


@pytest.mark.parametrize(
    "text", ["(+ x 0)", "(+ 0 x)", "(- x 0)", "(* x 1rad)", "(* 1rad x)", "(/ x 1rad)", "(^ x 1)", "(- (- x))"]
)
def test_neutral_elements_vanish(text):
    node = expression(text, {"x": X})
    assert isinstance(node, Column)
    assert node.identity == X.identity


@pytest.mark.parametrize("text", ["(* 0 x)", "(* x 0)"])
def test_zero_swallows(text):
    assert expression(text).value == 0


@pytest.mark.parametrize(
    "text", ["(* 1 x)", "(+ 0m x)", "(* x 1m)", "(+ 1m 1s)", "(min 1m 2kg)", "(* 2 3m)", "(sin 1m)"]
)
def test_what_says_something_about_units_is_kept(text):
    assert isinstance(expression(text), Apply)


def test_a_zero_angle_makes_an_angle_of_what_it_is_added_to():
    assert expression("(- x (angle 0))").angle
    assert expression("(+ (atan2 0 1) x)").angle
    assert not expression("(- x 0)").angle


@pytest.mark.parametrize(
    ("text", "angle"),
    [
        ("(+ a x)", True), ("(- x a)", True), ("(- a)", True), ("(if (< x 0) a x)", True), ("(if (< x 0) x a)", True),
        ("(atan2 x y)", True), ("(angle x)", True), ("(* 2 a)", False), ("(/ a 2)", False), ("(abs a)", False),
        ("(sin a)", False), ("(min a x)", False), ("(let ((b a)) (+ b 1))", True), ("([x a] 2)", True),
        ("(- (atan2 1 1) (atan2 1 0))", True), ("(* 2 (atan2 1 1))", False),
    ],
)  # fmt: skip
def test_being_an_angle_survives_sums_choices_and_names(text, angle):
    assert expression(text, {"a": THETA}).angle is angle


@pytest.mark.parametrize(
    ("operation", "arguments"),
    [
        (Operation.DIVIDE, (1, 0)), (Operation.DIVIDE, (1.0, 0.0)), (Operation.SQRT, (-1,)), (Operation.LOG, (0,)),
        (Operation.LOG, (-2.5,)), (Operation.POWER, (0, -1)), (Operation.POWER, (-8, Fraction(1, 3))),
        (Operation.ASIN, (1.1,)), (Operation.ACOS, (-1.1,)), (Operation.ACOSH, (0.9,)), (Operation.ATANH, (1,)),
        (Operation.EXP, (1000,)), (Operation.COSH, (-800,)), (Operation.MULTIPLY, (1e200, 1e200)),
        (Operation.POWER, (10.0, 400)),
    ],
)  # fmt: skip
def test_constants_without_a_finite_value_are_errors(operation, arguments):
    with pytest.raises(UndefinedValueError) as caught:
        apply(operation, *(number(a) for a in arguments))
    assert str(caught.value).startswith(f"({operation.value} ")


def test_integers_beyond_the_limit_of_bits_become_floats_or_errors():
    assert apply(Operation.POWER, number(2), number(1000)).value == 2**1000
    grown = apply(Operation.MULTIPLY, number(Fraction(1, 3**2000)), number(Fraction(1, 3**2000)))
    # 3^4000 has 6340 bits: too many to keep, and its reciprocal is below the smallest float.
    assert (MAXIMUM_BITS, grown.value) == (4096, 0.0)
    with pytest.raises(UndefinedValueError):
        apply(Operation.MULTIPLY, number(2**4000), number(2**4000))


@settings(max_examples=50)
@given(angle=st.floats(-1e4, 1e4), turns=st.integers(-3, 3))
def test_wrapped_angles_lie_in_the_half_open_turn(angle, turns):
    wrapped = wrap_angle(angle + turns * 2 * math.pi)
    assert -math.pi < wrapped <= math.pi
    # The same direction; 1e4 rad are known to 2e-12.
    assert math.cos(wrapped - angle) == pytest.approx(1, abs=1e-15)
    assert math.sin(wrapped - angle) == pytest.approx(0, abs=1e-11)


def test_half_turn_wraps_to_plus_pi():
    assert wrap_angle(-math.pi) == wrap_angle(math.pi) == math.pi


def test_folded_dimensions():
    assert expression("(* 3m 2m)").dimension == M**2
    assert expression("(/ 3m 2s)").dimension == M / S
    assert expression("(sqrt 9m^2)").dimension == M
    assert expression("(^ 8m^3 1/3)").dimension == M
    assert expression("(hypot 3m 4m)").dimension == M
    assert expression("(+ 3m 4)").dimension == M
    assert expression("(/ 3m 2m)").dimension == NONE
    assert expression("(sign -3m)").dimension == NONE
    assert expression("(+ 3 4)").dimension is None


def test_constant_values_go_through_constants_but_not_through_data_or_choices():
    h = Constant("h", 3.0)
    assert constant_value(expression("(* 2 (+ h 1))", {"h": h})) == 8
    assert constant_value(expression("(* x 1)")) is None
    assert constant_value(expression("(if (< h 1) h 2)", {"h": h})) is None
    assert constant_value(expression("(< h 1)", {"h": h})) is None
    with pytest.raises(UndefinedValueError):
        constant_value(expression("(/ 1 (- h 3))", {"h": h}))
