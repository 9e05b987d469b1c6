"""Dimensions as text: what is stuck to a number has to read back as the same quantity."""

from __future__ import annotations

import pytest

from mbm.expression.algebra import apply
from mbm.expression.nodes import Number, Operation
from mbm.expression.units import _NAMES, NONE, base, parse_unit

M, KG, S, A = (base(n) for n in ("m", "kg", "s", "A"))


@pytest.mark.parametrize(
    ("dimension", "symbol"),
    [
        (NONE, ""),
        (M, "m"),
        (M / S**2, "m/s^2"),
        (S**-1, "s^-1"),
        (M**-2 * S**-1, "m^-2*s^-1"),
    ],
)
def test_the_unit_that_is_shown_reads_back_alone_and_behind_a_number(dimension, symbol):
    assert dimension.symbol() == symbol
    if symbol:
        assert parse_unit(symbol).dimension == dimension
        assert not symbol[0].isdigit()


@pytest.mark.parametrize(
    ("unit", "described"),
    [("V", "a voltage (V)"), ("kN", "a force (N)"), ("hPa", "a pressure (Pa)"), ("kJ", "an energy or torque (J)"),
     ("mW", "a power (W)"), ("kohm", "a resistance (ohm)"), ("C", "a charge (C)")],
)  # fmt: skip
def test_common_dimensions_have_names(unit, described):
    assert parse_unit(unit).dimension.describe() == described


@pytest.mark.parametrize(
    ("operation", "left", "right", "dimension"),
    [
        (Operation.MULTIPLY, None, NONE, None),
        (Operation.MULTIPLY, NONE, None, None),
        (Operation.DIVIDE, None, NONE, None),
        (Operation.MULTIPLY, M, NONE, M),
    ],
)
def test_a_pure_number_leaves_an_open_dimension_open(operation, left, right, dimension):
    """`(* (sin 90deg) 3)`: what 3 is measured in is for its uses to say, so the product is a plain number too."""
    found = apply(operation, Number(6, left), Number(3, right))
    assert isinstance(found, Number)
    assert found.value == (18 if operation is Operation.MULTIPLY else 2)
    assert found.dimension == dimension


@pytest.mark.parametrize("text", [text for text in _NAMES.values() if "(" in text])
def test_names_of_dimensions_go_with_the_unit_in_brackets(text):
    unit = text[text.index("(") + 1 : -1]
    found = parse_unit(unit).dimension if not unit.startswith("1/") else NONE / parse_unit(unit[2:]).dimension
    assert found.describe() == text
