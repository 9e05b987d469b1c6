"""Physical dimensions: exponents over the base quantities of the SI."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

_BASES = ("m", "kg", "s", "A", "K", "mol", "cd")
_NAMES = {
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
}


@dataclass(frozen=True, slots=True)
class Dimension:
    """Exponents of metre, kilogram, second, ampere, kelvin, mole, candela, in that order."""

    exponents: tuple[Fraction, ...]

    def __mul__(self, other: Dimension) -> Dimension:
        return Dimension(tuple(a + b for a, b in zip(self.exponents, other.exponents, strict=True)))

    def __truediv__(self, other: Dimension) -> Dimension:
        return Dimension(tuple(a - b for a, b in zip(self.exponents, other.exponents, strict=True)))

    def __pow__(self, power: Fraction | int) -> Dimension:
        return Dimension(tuple(a * power for a in self.exponents))

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

    def describe(self) -> str:
        """How a message names the dimension."""
        key = tuple((base, int(e)) for base, e in zip(_BASES, self.exponents, strict=True) if e)
        return _NAMES.get(key, f"of dimension {self.symbol()}")


def _power(base: str, exponent: Fraction) -> str:
    if exponent == 1:
        return base
    return f"{base}^{exponent}" if exponent.denominator == 1 else f"{base}^({exponent})"


def base(name: str) -> Dimension:
    """The dimension of a base unit, by its symbol."""
    return Dimension(tuple(Fraction(int(b == name)) for b in _BASES))


NONE = Dimension((Fraction(0),) * len(_BASES))
"""A pure number."""
