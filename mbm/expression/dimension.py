"""Physical dimensions: exponents over the base quantities of the SI."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
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
        """The SI unit as text, such as ``m/s^2`` or ``W/m/K``; empty for a pure number.

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
        below = [_power(base, -e) for base, e in zip(_BASES, self.exponents, strict=True) if e < 0]
        if name:
            (above if name_above else below).insert(0, name)
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
