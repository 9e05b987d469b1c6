"""What the caller gives instead of what the file says."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

from mbm.expression.units import Unit
from mbm.problem.laws import NORMAL_LAW, Law
from mbm.text.types import Span
from mbm.values import dataclass


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
    that they are written in, ``dof`` are their degrees of freedom.
    """

    name: str
    values: tuple[float, ...]
    elements: tuple[str, ...]
    sigmas: tuple[float, ...] = ()
    unit: Unit | None = None
    dof: float = inf
    law: Law = NORMAL_LAW
    span: Span
