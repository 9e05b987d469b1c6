"""The units that mbm knows: a closed list. Quantities are kept in SI, so a unit is a scale and a dimension.

Factors: SI brochure, 9th edition (2019), tables 2, 4, 7 and 8; inch, foot, mile and pound by the international yard and
pound agreement; torr and psi follow from the standard atmosphere and the standard acceleration of gravity. Celsius and
Fahrenheit: SI brochure, 2.3.1, and NIST SP 811, B.8; they have a zero of their own, which differences do not have.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction
from math import inf, pi
from types import MappingProxyType

from mbm.expression.dimension import NONE, Dimension, base
from mbm.scales import SI, Scale
from mbm.values import dataclass


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit: what numbers in it are, and their dimension."""

    symbol: str
    factor: float
    dimension: Dimension
    zero: float = 0.0

    @property
    def scale(self) -> Scale:
        """Numbers in the unit and in SI."""
        return Scale(self.factor, self.zero)

    def exact_si(self, value: int | Fraction | float) -> int | Fraction | float:
        """A written number in SI. Decimal numbers are exact: 70cm is 0.7 m, and 20.1degC is 293.25 K."""
        if self.scale.is_si:
            return value
        return float(Fraction(str(value)) * Fraction(repr(self.factor)) + Fraction(repr(self.zero)))


_M, _KG, _S, _A, _K, _MOL, _CD = (base(n) for n in ("m", "kg", "s", "A", "K", "mol", "cd"))
_N = _M * _KG / _S**2
_J = _N * _M
_W = _J / _S
_V = _W / _A

_PREFIXES: tuple[tuple[str, int], ...] = (
    ("q", -30), ("r", -27), ("y", -24), ("z", -21), ("a", -18), ("f", -15), ("p", -12), ("n", -9), ("u", -6), ("µ", -6),
    ("m", -3), ("c", -2), ("d", -1), ("", 0), ("da", 1), ("h", 2), ("k", 3), ("M", 6), ("G", 9), ("T", 12), ("P", 15),
    ("E", 18), ("Z", 21), ("Y", 24), ("R", 27), ("Q", 30),
)  # fmt: skip
_PREFIXED: dict[str, tuple[str, int, Dimension]] = {
    "m": ("1", 0, _M), "s": ("1", 0, _S), "g": ("1", -3, _KG), "A": ("1", 0, _A), "K": ("1", 0, _K),
    "mol": ("1", 0, _MOL), "cd": ("1", 0, _CD), "rad": ("1", 0, NONE), "Hz": ("1", 0, _S**-1), "N": ("1", 0, _N),
    "Pa": ("1", 0, _N / _M**2), "bar": ("1", 5, _N / _M**2), "J": ("1", 0, _J), "eV": ("1.602176634", -19, _J),
    "W": ("1", 0, _W), "C": ("1", 0, _A * _S), "V": ("1", 0, _V), "ohm": ("1", 0, _V / _A), "S": ("1", 0, _A / _V),
    "F": ("1", 0, _A * _S / _V), "Wb": ("1", 0, _V * _S), "T": ("1", 0, _V * _S / _M**2), "H": ("1", 0, _V * _S / _A),
    "lm": ("1", 0, _CD), "lx": ("1", 0, _CD / _M**2), "kat": ("1", 0, _MOL / _S), "Bq": ("1", 0, _S**-1),
    "Gy": ("1", 0, _J / _KG), "Sv": ("1", 0, _J / _KG), "L": ("1", -3, _M**3),
}  # fmt: skip
"""Units that take the prefixes, and what one is in SI: digits and power of ten."""
_PLAIN: tuple[tuple[str, float, Dimension], ...] = (
    ("in", 0.0254, _M), ("ft", 0.3048, _M), ("mi", 1609.344, _M), ("min", 60.0, _S), ("h", 3600.0, _S),
    ("d", 86400.0, _S), ("t", 1e3, _KG), ("lb", 0.45359237, _KG), ("deg", pi / 180, NONE), ("arcmin", pi / 10800, NONE),
    ("arcsec", pi / 648000, NONE), ("rev", 2 * pi, NONE), ("px", 1.0, NONE), ("%", 1e-2, NONE), ("ppm", 1e-6, NONE),
    ("ppb", 1e-9, NONE), ("rpm", 2 * pi / 60, _S**-1), ("Torr", 101325 / 760, _N / _M**2),
    ("psi", 0.45359237 * 9.80665 / 0.0254**2, _N / _M**2), ("G", 9.80665, _M / _S**2), ("degR", 5 / 9, _K),
)  # fmt: skip

_FAHRENHEIT = (5 / 9, 459.67 * 5 / 9)
_WITH_ZERO: tuple[tuple[str, float, float], ...] = (
    ("degC", 1.0, 273.15), ("°C", 1.0, 273.15), ("degF", *_FAHRENHEIT), ("°F", *_FAHRENHEIT),
)  # fmt: skip

REFUSED: Mapping[str, str] = MappingProxyType(
    {
        "dB": "a logarithmic unit: give the column no unit and write the logarithm in the equation",
        "dBm": "a logarithmic unit: give the column no unit and write the logarithm in the equation",
        "dBi": "a logarithmic unit: give the column no unit and write the logarithm in the equation",
        "pH": "a logarithmic unit: give the column no unit and write the logarithm in the equation",
    }
)
"""Units that people write and that mbm does not read, with what to do instead."""


PREFIXES: Mapping[str, int] = MappingProxyType(dict(_PREFIXES))
"""The power of ten that each prefix stands for; µ and u are the same."""

TAKE_PREFIXES: Mapping[str, Unit] = MappingProxyType(
    {symbol: Unit(symbol, float(f"{one}e{power}"), dimension) for symbol, (one, power, dimension) in _PREFIXED.items()}
)
"""Units that may have a prefix, or none."""

PLAIN: Mapping[str, Unit] = MappingProxyType({s: Unit(s, f, d) for s, f, d in _PLAIN})
"""Units that take no prefix."""

WITH_ZERO: Mapping[str, Unit] = MappingProxyType({s: Unit(s, f, _K, zero) for s, f, zero in _WITH_ZERO})
"""Temperatures on a scale with a zero of its own. Within a compound (``mV/degC``) they are differences."""


def unit_called(symbol: str) -> Unit | None:
    """The unit with a symbol that may stand alone or in a compound such as ``m/s^2``, or None."""
    if symbol in PLAIN:
        return PLAIN[symbol]
    if symbol in WITH_ZERO:
        return WITH_ZERO[symbol]
    for width in range(3):
        prefix, rest = symbol[:width], symbol[width:]
        if rest in _PREFIXED and prefix in PREFIXES and symbol not in REFUSED:
            one, power, dimension = _PREFIXED[rest]
            return Unit(symbol, float(f"{one}e{power + PREFIXES[prefix]}"), dimension)
    return None


_FACTOR = r"(?P<name>1|[^\W\d_]+|%|°[CF])(?:\^(?P<power>-?\d{1,2}))?"


def parse_unit(text: str) -> Unit | None:
    """The unit that ``text`` names (``m``, ``m/s^2``, ``1/s``, ``N*m``), or None if it is not on the list."""
    alone = unit_called(text)
    if alone is not None:
        return alone
    factor, dimension = 1.0, NONE
    position, sign = 0, 1
    pattern = re.compile(_FACTOR)
    while True:
        match = pattern.match(text, position)
        if match is None:
            return None
        power = sign * int(match["power"] or 1)
        if match["name"] != "1":
            unit = unit_called(match["name"])
            if unit is None or abs(power) > 12:
                return None
            factor *= unit.factor**power
            dimension *= unit.dimension**power
        position = match.end()
        if not 0.0 < factor < inf:
            return None
        if position == len(text):
            return Unit(text, factor, dimension)
        if text[position] not in "*/":
            return None
        sign = 1 if text[position] == "*" else -1
        position += 1


def scale_of(symbol: str | None) -> Scale:
    """The scale of a unit on the list, by what `parse_unit` reads; SI for None and what is not on the list."""
    unit = parse_unit(symbol) if symbol else None
    return SI if unit is None else unit.scale


def refused_unit(text: str) -> str | None:
    """Why a unit that people write is refused, or None."""
    for part in re.split(r"[*/^]", text):
        if part in REFUSED:
            return REFUSED[part]
    return None
