"""The closed list of units against Pint's registry, which was written from the same standards by others."""

from __future__ import annotations

import itertools
import math

import pint
import pytest

from mbm.expression.units import (
    NONE,
    PLAIN,
    PREFIXES,
    REFUSED,
    TAKE_PREFIXES,
    WITH_ZERO,
    Dimension,
    parse_unit,
    refused_unit,
    scale_of,
)

OURS_ALONE = {
    "px": "a pixel is a number here; Pint counts pixels as a dimension of their own",
    "ppb": "1e-9, which Pint does not know",
    "G": "the standard acceleration of gravity; Pint's G is the gauss",
}
"""Symbols that mean something else there."""
OTHER_NAMES = {"%": "percent", "rev": "revolution", "Torr": "torr"}
LONG = {
    "m": "meter", "s": "second", "g": "gram", "A": "ampere", "K": "kelvin", "mol": "mole", "cd": "candela",
    "rad": "radian", "Hz": "hertz", "N": "newton", "Pa": "pascal", "bar": "bar", "J": "joule", "eV": "electron_volt",
    "W": "watt", "C": "coulomb", "V": "volt", "ohm": "ohm", "S": "siemens", "F": "farad", "Wb": "weber", "T": "tesla",
    "H": "henry", "lm": "lumen", "lx": "lux", "kat": "katal", "Bq": "becquerel", "Gy": "gray", "Sv": "sievert",
    "L": "liter",
}  # fmt: skip
"""What Pint calls units that take prefixes; short names with prefixes mean other things there (``hbar``, ``mcd``)."""
BEFORE = {
    "q": "quecto", "r": "ronto", "y": "yocto", "z": "zepto", "a": "atto", "f": "femto", "p": "pico", "n": "nano",
    "u": "micro", "µ": "micro", "m": "milli", "c": "centi", "d": "deci", "": "", "da": "deca", "h": "hecto",
    "k": "kilo", "M": "mega", "G": "giga", "T": "tera", "P": "peta", "E": "exa", "Z": "zetta", "Y": "yotta",
    "R": "ronna", "Q": "quetta",
}  # fmt: skip
BASES = ("[length]", "[mass]", "[time]", "[current]", "[temperature]", "[substance]", "[luminosity]")


@pytest.fixture(scope="module")
def registry():
    return pint.UnitRegistry()


def quantity(registry, symbol):
    return registry.Quantity(1.0, OTHER_NAMES.get(symbol, symbol)).to_base_units()


def dimension_of(quantity):
    assert set(quantity.dimensionality) <= set(BASES)
    return Dimension(tuple(int(quantity.dimensionality.get(base, 0)) for base in BASES))


@pytest.mark.parametrize("symbol", sorted(set(PLAIN) - set(OURS_ALONE)))
def test_unit_is_the_one_of_pint(symbol, registry):
    theirs = quantity(registry, symbol)
    assert PLAIN[symbol].symbol == symbol
    # A factor is a product of a few doubles on either side.
    assert PLAIN[symbol].factor == pytest.approx(theirs.magnitude, rel=1e-15)
    assert PLAIN[symbol].dimension == dimension_of(theirs)


@pytest.mark.parametrize("unit", LONG)
def test_unit_with_prefixes_is_the_one_of_pint(unit, registry):
    for prefix, name in BEFORE.items():
        symbol = prefix + unit
        if symbol in REFUSED:
            continue
        ours, theirs = parse_unit(symbol), registry.Quantity(1.0, name + LONG[unit]).to_base_units()
        assert ours.symbol == symbol
        assert ours.factor == pytest.approx(theirs.magnitude, rel=1e-14)
        assert ours.dimension == dimension_of(theirs)


def test_prefixes_and_their_units_are_all_looked_at():
    assert set(PREFIXES) == set(BEFORE)
    assert set(TAKE_PREFIXES) == set(LONG)


def test_no_symbol_means_two_units():
    """With and without prefix; what is listed by itself comes first."""
    read = [prefix + unit for prefix in PREFIXES for unit in TAKE_PREFIXES]
    assert len(read) == len(set(read))
    assert set(read) & (set(PLAIN) | set(WITH_ZERO)) == set()


def test_units_of_our_own(registry):
    assert (PLAIN["px"].factor, PLAIN["px"].dimension) == (1.0, NONE)
    assert (PLAIN["ppb"].factor, PLAIN["ppb"].dimension) == (1e-9, NONE)
    gravity = registry.Quantity(1.0, "standard_gravity").to_base_units()
    assert (PLAIN["G"].factor, PLAIN["G"].dimension) == (gravity.magnitude, dimension_of(gravity))


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


@pytest.mark.parametrize("text", ["dBm", "dB/m", "pH"])
def test_logarithmic_units_are_refused_with_a_hint(text):
    assert parse_unit(text) is None
    assert refused_unit(text) in REFUSED.values()


@pytest.mark.parametrize(("symbol", "name"), [("degC", "degC"), ("°C", "degC"), ("degF", "degF"), ("°F", "degF")])
@pytest.mark.parametrize("value", [-273.15, -40.0, 0.0, 20.1, 98.6, 1064.18])
def test_temperatures_with_a_zero_are_those_of_pint(symbol, name, value, registry):
    kelvin = registry.Quantity(value, name).to("kelvin").magnitude
    scale = WITH_ZERO[symbol].scale
    # A few roundings of numbers of the size of the zero.
    assert scale.to_si(value) == pytest.approx(kelvin, abs=3e-13)
    assert scale.from_si(kelvin) == pytest.approx(value, abs=3e-13)
    step = registry.Quantity(value, f"delta_{name}").to("kelvin").magnitude
    assert scale.difference_to_si(value) == pytest.approx(step, rel=1e-15)
    assert scale.difference_from_si(step) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "factor"), [("mV/degC", 1e-3), ("1/degF", 1.8), ("degC/min", 1 / 60), ("W/m^2/°C", 1)]
)
def test_within_a_compound_a_temperature_is_a_difference(text, factor):
    assert parse_unit(text).factor == pytest.approx(factor, rel=1e-15)
    assert parse_unit(text).scale.zero == 0.0


def test_written_temperatures_are_exact():
    """20.1 °C is the double nearest to 293.25 K, which 20.1 + 273.15 in doubles is not everywhere."""
    assert WITH_ZERO["degC"].exact_si(20.1) == 293.25
    assert WITH_ZERO["degC"].exact_si(-0.05) == 273.1
    assert scale_of(None).is_si
    assert scale_of("no unit").is_si


def test_refusals_and_units_are_apart():
    assert all(parse_unit(symbol) is None for symbol in REFUSED)
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


@pytest.mark.parametrize(
    ("unit", "shown"),
    [("V/A", "ohm"), ("N*m", "J"), ("W/m^2/K", "W/m^2/K"), ("kg/m^3", "kg/m^3"), ("m/s^2", "m/s^2"),
     ("J/kg/K", "J/kg/K"), ("kg/s^2", "N/m"), ("kg/m/s", "Pa*s"), ("A/V", "S"), ("m^2/s^2", "m^2/s^2"),
     ("m^3/kg/s^2", "m^3/kg/s^2"), ("V*s", "Wb"), ("1/V", "V^-1"), ("A*s", "C"), ("F/m", "F/m"),
     ("kg", "kg"), ("1/s", "s^-1"), ("1/m^2/s", "m^-2*s^-1"), ("1/A/s", "C^-1")],
)  # fmt: skip
def test_dimensions_are_said_in_the_unit_that_a_person_would_write(unit, shown):
    dimension = parse_unit(unit).dimension
    assert dimension.symbol() == shown
    assert parse_unit(shown).factor == 1.0
    assert parse_unit(shown).dimension == dimension


def test_every_symbol_is_read_back():
    for exponents in itertools.product(range(-2, 3), repeat=4):
        dimension = Dimension((*exponents, 0, 0, 0))
        if not dimension.is_none:
            back = parse_unit(dimension.symbol())
            assert (back.factor, back.dimension) == (1.0, dimension)
