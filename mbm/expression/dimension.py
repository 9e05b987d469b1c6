"""Physical dimensions: exponents over the base quantities of the SI."""

from __future__ import annotations

from fractions import Fraction
from typing import TypeAlias

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
    (("m", 2), ("kg", 1), ("s", -2)): "an energy or torque (N*m)",
    (("m", 2), ("kg", 1), ("s", -3)): "a power (W)",
    (("m", 2), ("kg", 1), ("s", -3), ("A", -1)): "a voltage (V)",
    (("m", 2), ("kg", 1), ("s", -3), ("A", -2)): "a resistance (ohm)",
}


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

    def symbol(self) -> str:
        """The SI unit as text, such as ``m/s^2``; empty for a pure number."""
        above = [_power(base, e) for base, e in zip(_BASES, self.exponents, strict=True) if e > 0]
        below = [_power(base, -e) for base, e in zip(_BASES, self.exponents, strict=True) if e < 0]
        if not above and not below:
            return ""
        return "/".join(["*".join(above) or "1", *below])

    def suffix(self) -> str:
        """The SI unit as it is stuck to a number: ``s^-2`` where ``symbol`` says ``1/s^2``, which would add a digit."""
        if any(e > 0 for e in self.exponents):
            return self.symbol()
        return "*".join(_power(base, e) for base, e in zip(_BASES, self.exponents, strict=True) if e)

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
