"""A value and its standard deviation → text with the digits that the uncertainty allows (GUM 7.2.6: two of sigma)."""

from __future__ import annotations

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal

from mbm.values import dataclass

SIGNIFICANT = 6
"""Digits of a value whose uncertainty is unknown."""

EXACT = 10
"""Digits of a value that was not estimated."""

_LARGE, _SMALL = 1e7, 1e-3
"""From here on numbers are written with a power of ten,"""

_LARGE_AND_KNOWN = 1e13
"""or only from here on, if the uncertainty is below 1000, so that few of the digits would be filling zeros."""

_MOST_DIGITS = 15
"""Digits that a double has whatever its value."""


@dataclass(frozen=True, slots=True)
class Measured:
    """A number as text. ``value`` and ``sigma`` have the same decimals; ``sigma`` is empty where there is none.

    With a power of ten ``value`` begins with a bracket and ``sigma`` ends with ``)e-07``.
    """

    value: str
    sigma: str = ""

    @property
    def alone(self) -> str:
        """The value without its uncertainty, and with the power of ten that both have."""
        return self.value[1:] + self.sigma.partition(")")[2] if self.value.startswith("(") else self.value

    def __str__(self) -> str:
        return f"{self.value} ± {self.sigma}" if self.sigma else self.value


def measured(value: float, sigma: float, *, exact: bool = False) -> Measured:
    """``1.2346 ± 0.0012``, ``(1.2346 ± 0.0012)e-07``; ``± ?`` for a sigma of NaN, none for an ``exact`` value."""
    if not math.isfinite(value):
        return Measured("undefined")
    if exact:
        return Measured(plain(value, EXACT))
    if not math.isfinite(sigma):
        return Measured(plain(value, SIGNIFICANT), "?")
    if sigma <= 0:
        return Measured(plain(value, EXACT), "0")
    place = _place(sigma)
    size = max(abs(value), sigma)
    if _exponent(size) - place >= _MOST_DIGITS:
        return Measured(plain(value, _MOST_DIGITS), f"{sigma:.1e}")
    if _SMALL <= size < (_LARGE if place > 1 else _LARGE_AND_KNOWN):
        return Measured(_fixed(value, -place), _fixed(sigma, -place))
    power = _exponent(size)
    scale = 10.0**-power if abs(power) < 300 else 0.0
    if scale == 0.0:
        return Measured(f"{value:.5e}", f"{sigma:.1e}")
    decimals = max(power - place, 0)
    return Measured(f"({value * scale:.{decimals}f}", f"{sigma * scale:.{decimals}f})e{power:+03d}")


def enclosed(low: float, high: float) -> str:
    """``[1.2345, 1.2399]``: bounds with three digits of their width, rounded outwards, so that they still hold."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return "undefined"
    size = max(abs(low), abs(high))
    if size == 0.0 or high <= low or not math.isfinite(high - low):
        return f"[{plain(low, EXACT)}, {plain(high, EXACT)}]"
    place = _place(high - low) - 1
    ends = []
    for value, rounding in ((low, ROUND_FLOOR), (high, ROUND_CEILING)):
        shortest = Decimal(repr(float(value)))  # 0.12 is to stay 0.12
        if _SMALL <= size < _LARGE and _exponent(size) - place < _MOST_DIGITS:
            digits = Decimal(1).scaleb(min(place, 0))
            ends.append(f"{shortest.quantize(digits, rounding, Context(prec=60)):f}")
        else:
            most = min(max(_exponent(size) - place + 1, 1), _MOST_DIGITS + 2)
            ends.append(f"{float(Context(prec=most, rounding=rounding).create_decimal(shortest)):.{most - 1}e}")
    return f"[{ends[0]}, {ends[1]}]"


def plain(value: float, digits: int) -> str:
    """A number alone, with a power of ten where it is very large or very small."""
    if not math.isfinite(value):
        return "undefined"
    if value == 0 or _SMALL <= abs(value) < _LARGE:
        return f"{value:.{max(digits, len(f'{abs(value):.0f}'))}g}"
    mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
    if "." in mantissa:
        mantissa = mantissa.rstrip("0").rstrip(".")
    return f"{mantissa}e{power}"


def _place(sigma: float) -> int:
    """The power of ten of the second digit of ``sigma``, after rounding: -3 for 0.0123, -2 for 0.0996."""
    return int(f"{sigma:.1e}".partition("e")[2]) - 1


def _exponent(size: float) -> int:
    return int(f"{size:e}".partition("e")[2])


def _fixed(value: float, decimals: int) -> str:
    """With ``decimals`` digits behind the point; before it, digits beyond the uncertainty become zeros."""
    text = f"{round(value, decimals):.{max(decimals, 0)}f}"
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text
