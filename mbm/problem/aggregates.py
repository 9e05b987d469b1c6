"""Aggregates: one number made of a number in each row of a table."""

from __future__ import annotations

from dataclasses import field
from enum import StrEnum

from mbm.expression.nodes import Expression
from mbm.text.types import Span
from mbm.values import dataclass


class AggregateKind(StrEnum):
    """What one number is made of a number in each row of a table; the value is its name in the language."""

    MEAN = "mean"
    RMS = "rms"
    MEDIAN = "median"
    MINIMUM = "min"
    MAXIMUM = "max"
    QUANTILE = "quantile"
    COUNT = "count"


@dataclass(frozen=True, slots=True, kw_only=True)
class Aggregate:
    """``(rms TABLE FORM)``: ``kind`` of the values of FORM in all rows of ``table`` as the solve has them.

    ``cases`` hold FORM for the rows that have the values of static columns. Expressions hold the aggregate as the
    component of an unknown called ``name``, which no unknown can be called: it has a bracket. ``level`` lies between
    0 and 1 (quantiles; 1/2 for the median). ``angle``: FORM is an angle.
    """

    name: str
    kind: AggregateKind
    table: str
    cases: tuple[tuple[tuple[tuple[str, str | float], ...], Expression], ...] = field(repr=False)
    level: float = 0.5
    angle: bool = False
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenOut:
    """An aggregate in a constraint, which is a formula over the rows of ``table``."""

    kind: AggregateKind
    table: str
    span: Span


def is_aggregate(name: str) -> bool:
    """Whether a component of this name is an aggregate, no unknown."""
    return name.endswith(")")
