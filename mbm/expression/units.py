"""The units that mbm knows: a closed list. Quantities are kept in SI, so a unit is a factor and a dimension.

Factors: SI brochure, 9th edition (2019), tables 2, 4 and 8; inch, foot and mile by the international yard agreement.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import inf, pi
from types import MappingProxyType

from mbm.expression.dimension import NONE, Dimension, base
from mbm.values import dataclass


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit: ``value in SI = factor · value in the unit``."""

    symbol: str
    factor: float
    dimension: Dimension


_M, _KG, _S, _A, _K, _MOL, _CD = (base(n) for n in ("m", "kg", "s", "A", "K", "mol", "cd"))
_N = _M * _KG / _S**2
_J = _N * _M
_W = _J / _S
_V = _W / _A

_PLAIN: tuple[tuple[str, float, Dimension], ...] = (
    ("m", 1.0, _M), ("km", 1e3, _M), ("dm", 1e-1, _M), ("cm", 1e-2, _M), ("mm", 1e-3, _M), ("um", 1e-6, _M),
    ("µm", 1e-6, _M), ("nm", 1e-9, _M), ("in", 0.0254, _M), ("ft", 0.3048, _M), ("mi", 1609.344, _M),
    ("s", 1.0, _S), ("ms", 1e-3, _S), ("us", 1e-6, _S), ("µs", 1e-6, _S), ("ns", 1e-9, _S), ("min", 60.0, _S),
    ("h", 3600.0, _S), ("d", 86400.0, _S),
    ("kg", 1.0, _KG), ("g", 1e-3, _KG), ("mg", 1e-6, _KG), ("t", 1e3, _KG),
    ("A", 1.0, _A), ("mA", 1e-3, _A), ("K", 1.0, _K), ("mK", 1e-3, _K), ("mol", 1.0, _MOL), ("mmol", 1e-3, _MOL),
    ("cd", 1.0, _CD),
    ("rad", 1.0, NONE), ("mrad", 1e-3, NONE), ("urad", 1e-6, NONE), ("deg", pi / 180, NONE),
    ("arcmin", pi / 10800, NONE), ("arcsec", pi / 648000, NONE), ("rev", 2 * pi, NONE), ("px", 1.0, NONE),
    ("%", 1e-2, NONE), ("ppm", 1e-6, NONE),
    ("Hz", 1.0, _S**-1), ("kHz", 1e3, _S**-1), ("MHz", 1e6, _S**-1), ("GHz", 1e9, _S**-1),
    ("rpm", 2 * pi / 60, _S**-1),
    ("N", 1.0, _N), ("mN", 1e-3, _N), ("kN", 1e3, _N), ("Pa", 1.0, _N / _M**2), ("hPa", 1e2, _N / _M**2),
    ("kPa", 1e3, _N / _M**2), ("MPa", 1e6, _N / _M**2), ("bar", 1e5, _N / _M**2), ("mbar", 1e2, _N / _M**2),
    ("J", 1.0, _J), ("kJ", 1e3, _J), ("W", 1.0, _W), ("mW", 1e-3, _W), ("kW", 1e3, _W),
    ("C", 1.0, _A * _S), ("V", 1.0, _V), ("mV", 1e-3, _V), ("uV", 1e-6, _V), ("kV", 1e3, _V),
    ("ohm", 1.0, _V / _A), ("kohm", 1e3, _V / _A), ("F", 1.0, _A * _S / _V), ("uF", 1e-6, _A * _S / _V),
    ("nF", 1e-9, _A * _S / _V), ("pF", 1e-12, _A * _S / _V), ("H", 1.0, _V * _S / _A), ("mH", 1e-3, _V * _S / _A),
    ("T", 1.0, _V * _S / _M**2), ("mT", 1e-3, _V * _S / _M**2), ("uT", 1e-6, _V * _S / _M**2),
    ("L", 1e-3, _M**3), ("mL", 1e-6, _M**3), ("G", 9.80665, _M / _S**2),
)  # fmt: skip

UNITS: Mapping[str, Unit] = MappingProxyType({s: Unit(s, f, d) for s, f, d in _PLAIN})
"""Every unit symbol that may stand alone or in a compound such as ``m/s^2``."""

REFUSED: Mapping[str, str] = MappingProxyType(
    {
        "degC": "Celsius has an offset: state kelvin (K), or the difference of temperatures",
        "degF": "Fahrenheit has an offset: state kelvin (K)",
        "°C": "Celsius has an offset: state kelvin (K), or the difference of temperatures",
        "dB": "a logarithmic unit: give the column no unit and write the logarithm in the equation",
        "dBm": "a logarithmic unit: give the column no unit and write the logarithm in the equation",
        "dBi": "a logarithmic unit: give the column no unit and write the logarithm in the equation",
        "pH": "a logarithmic unit: give the column no unit and write the logarithm in the equation",
    }
)
"""Units that people write and that are no factor times SI, with what to do instead."""

_FACTOR = r"(?P<name>1|[^\W\d_]+|%)(?:\^(?P<power>-?\d{1,2}))?"


def parse_unit(text: str) -> Unit | None:
    """The unit that ``text`` names (``m``, ``m/s^2``, ``1/s``, ``N*m``), or None if it is not on the list."""
    if text in UNITS:
        return UNITS[text]
    factor, dimension = 1.0, NONE
    position, sign = 0, 1
    pattern = re.compile(_FACTOR)
    while True:
        match = pattern.match(text, position)
        if match is None:
            return None
        power = sign * int(match["power"] or 1)
        if match["name"] != "1":
            unit = UNITS.get(match["name"])
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


def refused_unit(text: str) -> str | None:
    """Why a unit that people write is refused, or None."""
    for part in re.split(r"[*/^]", text):
        if part in REFUSED:
            return REFUSED[part]
    return None
