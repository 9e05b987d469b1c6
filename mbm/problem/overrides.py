"""Values that are given: constants with the laws that they follow, and what the caller says instead of the file."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

from mbm.expression.nodes import Expression
from mbm.expression.units import Unit
from mbm.text.types import Span
from mbm.values import dataclass

NORMAL, RECTANGULAR, TRIANGULAR, TRAPEZOIDAL = "normal", "rectangular", "triangular", "trapezoidal"
ARCSINE, STUDENT, LOGNORMAL = "arcsine", "student", "lognormal"
"""The names of the laws, as LANGUAGE §10 has them."""


@dataclass(frozen=True, slots=True)
class Law:
    """The law of (X − mean)/sigma, which location and scale leave: its name, and the ``shape`` of those that have one.

    The shape is the ratio of top to base (trapezoidal), the degrees of freedom (student), or the geometric standard
    deviation (lognormal). Without a variance, ``sigma`` stands for the scale.
    """

    name: str = NORMAL
    shape: float = 1.0

    @property
    def has_variance(self) -> bool:
        """Whether there is a standard deviation."""
        return self.name != STUDENT or self.shape > 2.0


NORMAL_LAW = Law()


@dataclass(frozen=True, slots=True, kw_only=True)
class Override:
    """A constant or start given from outside: as a form of the language, or as numbers in SI.

    ``computed``: mbm's own numbers, and kelvin even for a constant in degC, where a user may mean another number.
    """

    name: str
    text: str | None = None
    values: tuple[float, ...] | None = None
    computed: bool = False


Overrides = Mapping[str, Override]
"""What the caller gives instead of what the file says, by name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantValue:
    """A constant of the problem with its elements (one for a number) and their names in expressions.

    ``sigmas`` are their standard deviations (empty where it is exact), and ``law`` what they follow. ``unit`` is one
    that they are written in, ``dof`` are their degrees of freedom. ``made`` are the names of elements that are
    made of other constants, and how.
    """

    name: str
    values: tuple[float, ...]
    elements: tuple[str, ...]
    sigmas: tuple[float, ...] = ()
    unit: Unit | None = None
    dof: float = inf
    law: Law = NORMAL_LAW
    made: tuple[tuple[str, Expression], ...] = ()
    span: Span
