"""Physical dimensions, exponents over the base quantities of the SI; and the units that mbm knows, a closed list."""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction
from functools import lru_cache
from math import inf, pi
from types import MappingProxyType
from typing import TypeAlias

from mbm.scales import SI, Scale
from mbm.values import dataclass

_BASES = ("m", "kg", "s", "A", "K", "mol", "cd")
_NAMES: dict[tuple[tuple[str, int | Fraction], ...], str] = {
    (): "no dimension",
    (("m", 1),): "a length (m)",
    (("m", 2),): "an area (m^2)",
    (("m", 3),): "a volume (m^3)",
    (("kg", 1),): "a mass (kg)",
    (("s", 1),): "a time (s)",
    (("s", -1),): "a rate or frequency (1/s)",
    (("m", 1), ("s", -1)): "a speed (m/s)",
    (("m", 1), ("s", -2)): "an acceleration (m/s^2)",
    (("K", 1),): "a temperature (K)",
    (("A", 1),): "a current (A)",
    (("m", 1), ("kg", 1), ("s", -2)): "a force (N)",
    (("m", -1), ("kg", 1), ("s", -2)): "a pressure (Pa)",
    (("m", 2), ("kg", 1), ("s", -2)): "an energy or torque (J)",
    (("m", 2), ("kg", 1), ("s", -3)): "a power (W)",
    (("s", 1), ("A", 1)): "a charge (C)",
    (("m", 2), ("kg", 1), ("s", -3), ("A", -1)): "a voltage (V)",
    (("m", 2), ("kg", 1), ("s", -3), ("A", -2)): "a resistance (ohm)",
}


_DERIVED: tuple[tuple[str, tuple[int, ...]], ...] = (
    ("N", (1, 1, -2, 0, 0, 0, 0)),
    ("Pa", (-1, 1, -2, 0, 0, 0, 0)),
    ("J", (2, 1, -2, 0, 0, 0, 0)),
    ("W", (2, 1, -3, 0, 0, 0, 0)),
    ("C", (0, 0, 1, 1, 0, 0, 0)),
    ("V", (2, 1, -3, -1, 0, 0, 0)),
    ("ohm", (2, 1, -3, -2, 0, 0, 0)),
    ("S", (-2, -1, 3, 2, 0, 0, 0)),
    ("F", (-2, -1, 4, 2, 0, 0, 0)),
    ("H", (2, 1, -2, -2, 0, 0, 0)),
    ("Wb", (2, 1, -2, -1, 0, 0, 0)),
    ("T", (0, 1, -2, -1, 0, 0, 0)),
)
"""Units with names of their own (SI brochure, table 4), those that people prefer first."""

LARGEST_SHOWN = 10**9
"""Exponents beyond are not spelt out: powers of powers have thousands of digits."""

Exponent: TypeAlias = int | Fraction
"""Whole exponents are plain integers: nearly all are, and they are ten times faster."""


def whole(value: Exponent) -> Exponent:
    """The plain form of an exponent."""
    return int(value) if isinstance(value, Fraction) and value.denominator == 1 else value


@dataclass(frozen=True, slots=True)
class Dimension:
    """Exponents of metre, kilogram, second, ampere, kelvin, mole, candela, in that order."""

    exponents: tuple[Exponent, ...]

    def __mul__(self, other: Dimension) -> Dimension:
        if other is NONE or self is NONE:
            return self if other is NONE else other
        return Dimension(tuple([a + b for a, b in zip(self.exponents, other.exponents, strict=True)]))

    def __truediv__(self, other: Dimension) -> Dimension:
        if other is NONE:
            return self
        return Dimension(tuple([a - b for a, b in zip(self.exponents, other.exponents, strict=True)]))

    def __pow__(self, power: Exponent) -> Dimension:
        if self is NONE or power == 1:
            return self
        return Dimension(tuple([whole(a * power) for a in self.exponents]))

    @property
    def is_none(self) -> bool:
        """Whether this is a pure number."""
        return not any(self.exponents)

    @lru_cache(maxsize=256)  # noqa: B019 - a small value, of which there are few
    def symbol(self) -> str:
        """The SI unit as text, such as ``m/s^2``, ``W/m/K`` or ``s^-1``; empty for a pure number. It reads back,
        alone and stuck to a number.

        A unit with a name of its own stands for what would be longer without it.
        """
        shortest, length = self._of_bases(), self._length()
        if not any(self.exponents[i] for i in range(len(_BASES)) if _BASES[i] not in ("m", "s")):
            return shortest  # speeds and accelerations are said in lengths and times
        for above in (True, False):
            for name, exponents in _DERIVED:
                beside = Dimension(exponents if above else tuple(-e for e in exponents))
                rest = self / beside
                known = rest._length(1)
                if known < length and rest.exponents[_BASES.index("kg")] in (-1, 0, 1):
                    shortest, length = rest._of_bases(name, above), known
        return shortest

    def _length(self, named: int = 0) -> tuple[Exponent, int]:
        """How many factors the unit has beside ``named`` ones: written without powers, and with them."""
        powers: list[Exponent] = [e if e > 0 else -e for e in self.exponents if e]
        return sum(powers, start=named), named + len(powers)

    def _of_bases(self, name: str = "", name_above: bool = True) -> str:
        """The base units as text, beside a unit with a name."""
        above = [_power(base, e) for base, e in zip(_BASES, self.exponents, strict=True) if e > 0]
        below = [(base, -e) for base, e in zip(_BASES, self.exponents, strict=True) if e < 0]
        if name:
            above, below = ([name, *above], below) if name_above else (above, [(name, 1), *below])
        if not above:  # the `1` of `1/s` would join the number that the unit is stuck to
            return "*".join(_power(unit, -e) for unit, e in below)
        return "/".join(["*".join(above), *(_power(unit, e) for unit, e in below)])

    def describe(self) -> str:
        """How a message names the dimension."""
        key = tuple((base, e) for base, e in zip(_BASES, self.exponents, strict=True) if e)
        return _NAMES.get(key, f"of dimension {self.symbol()}")


def _power(base: str, power: Exponent) -> str:
    if power == 1:
        return base
    if max(abs(power.numerator), power.denominator) > LARGEST_SHOWN:
        return f"{base}^…"
    return f"{base}^{power}" if power.denominator == 1 else f"{base}^({power})"


def base(name: str) -> Dimension:
    """The dimension of a base unit, by its symbol."""
    return Dimension(tuple(int(b == name) for b in _BASES))


NONE = Dimension((0,) * len(_BASES))
"""A pure number."""


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
