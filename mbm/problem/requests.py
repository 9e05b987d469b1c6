"""What a request says of starts and windows, and asks of interval methods."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from enum import StrEnum
from types import MappingProxyType

from mbm.expression.nodes import Number
from mbm.text.types import Span
from mbm.values import dataclass


class Contractor(StrEnum):
    """How boxes are contracted; the value is the name in ``:contract``."""

    FORWARD = "forward"
    HC4 = "hc4"
    HULL = "hull"


MOST_BOXES = 50_000
"""Boxes that a solve examines if nothing else is asked."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Enclosing:
    """``(interval :contract C :width W :boxes n)``.

    ``fraction`` is that of each side to which boxes are bisected; ``widths`` (SI, by name) hold for some unknowns
    instead, one number for each coordinate of a member. ``boxes`` limits those that are examined.
    """

    contractor: Contractor = Contractor.HC4
    fraction: float = 0.01
    widths: Mapping[str, tuple[Number, ...]] = field(default_factory=lambda: MappingProxyType({}))
    boxes: int = MOST_BOXES


@dataclass(frozen=True, slots=True, kw_only=True)
class RandomStarts:
    """``:starts (random n :seed s)``; ``seed`` None: that of the solve."""

    count: int
    seed: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenStarts:
    """``:starts (given ((name value)…)…)``: each start names some unknowns, with one number per component in SI."""

    starts: tuple[Mapping[str, tuple[float, ...]], ...]


ROUNDING = 1e-9
"""Part of a step by which times may miss the end of a window: steps such as 0.1 are not exact in binary."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """``(window COLUMN :length L :step S :min-rows n)``, in SI: rows with ``end − length < column ≤ end``.

    ``carry``: each begins with what is known of its first step by the rows that have left.
    """

    column: str
    length: float
    step: float
    min_rows: int = 1
    carry: bool = False
    span: Span


def divided_by(for_each: tuple[str, ...], window: Window | None) -> tuple[str, ...]:
    """The columns that make several data sets of the rows."""
    return for_each if window is None else (*for_each, window.column)
