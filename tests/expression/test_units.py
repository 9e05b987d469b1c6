"""The closed list of units against Pint's registry, which was written from the same standards by others."""

from __future__ import annotations

import math

import pint
import pytest

from mbm.expression.dimension import NONE, Dimension
from mbm.expression.units import REFUSED, UNITS, parse_unit, refused_unit

OURS_ALONE = {
    "px": "a pixel is a number here; Pint counts pixels as a dimension of their own",
    "G": "the standard acceleration of gravity; Pint's G is the gauss",
}
"""Symbols that mean something else there."""
OTHER_NAMES = {"%": "percent", "rev": "revolution"}
BASES = ("[length]", "[mass]", "[time]", "[current]", "[temperature]", "[substance]", "[luminosity]")


@pytest.fixture(scope="module")
def registry():
    return pint.UnitRegistry()


def quantity(registry, symbol):
    return registry.Quantity(1.0, OTHER_NAMES.get(symbol, symbol)).to_base_units()


def dimension_of(quantity):
    assert set(quantity.dimensionality) <= set(BASES)
    return Dimension(tuple(int(quantity.dimensionality.get(base, 0)) for base in BASES))


@pytest.mark.parametrize("symbol", sorted(set(UNITS) - set(OURS_ALONE)))
def test_unit_is_the_one_of_pint(symbol, registry):
    theirs = quantity(registry, symbol)
    assert UNITS[symbol].symbol == symbol
    # A factor is a product of a few doubles on either side.
    assert UNITS[symbol].factor == pytest.approx(theirs.magnitude, rel=1e-15)
    assert UNITS[symbol].dimension == dimension_of(theirs)


def test_units_of_our_own(registry):
    assert (UNITS["px"].factor, UNITS["px"].dimension) == (1.0, NONE)
    gravity = registry.Quantity(1.0, "standard_gravity").to_base_units()
    assert (UNITS["G"].factor, UNITS["G"].dimension) == (gravity.magnitude, dimension_of(gravity))


@pytest.mark.parametrize(
    "text",
    ["m/s", "m/s^2", "1/s", "N*m", "km/h", "deg/s^2", "rev/min", "kg*m^2/s^3/A", "s^-2", "m^-1*kg", "mm^3", "1/m/s",
     "W/m^2/K", "V/ohm*s", "arcsec/d", "%/K"],
)  # fmt: skip
def test_compound_is_the_one_of_pint(text, registry):
    theirs = registry.Quantity(
        1.0, text.replace("%", "percent").replace("rev", "revolution").replace("^", "**")
    ).to_base_units()
    ours = parse_unit(text)
    # The factors of the parts, multiplied in another order.
    assert ours.factor == pytest.approx(theirs.magnitude, rel=2e-15)
    assert ours.dimension == dimension_of(theirs)


@pytest.mark.parametrize(
    "text", ["", "M", "meter", "m//s", "m/", "/s", "m s", "m^", "m^99", "2m", "m**2", "m^2.5", "m^0x"]
)
def test_what_is_no_unit(text):
    assert parse_unit(text) is None


@pytest.mark.parametrize("text", ["degC", "dBm", "degF/s", "W/degC"])
def test_offset_and_logarithmic_units_are_refused_with_a_hint(text):
    assert parse_unit(text) is None
    assert refused_unit(text) in REFUSED.values()


def test_refusals_and_units_are_apart():
    assert not set(REFUSED) & set(UNITS)
    assert refused_unit("m/s") is None


@pytest.mark.parametrize("unit", ["m/s^2", "N*m", "kHz", "V"])
def test_dimensions_are_a_group(unit):
    dimension = parse_unit(unit).dimension
    assert dimension / dimension == NONE
    assert dimension * dimension**-1 == NONE
    assert dimension**3 == dimension * dimension * dimension
    assert (dimension**-2) ** -1 == dimension**2


def test_factor_of_a_full_turn():
    assert parse_unit("rev/s").factor == 2 * math.pi
    assert parse_unit("rpm").factor == pytest.approx(parse_unit("rev/min").factor, rel=1e-15)
