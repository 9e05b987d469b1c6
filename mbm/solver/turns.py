"""Angles by whole turns: which of the angles that mean the same is taken."""

from __future__ import annotations

from math import ceil, isfinite, pi
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mbm.machine.words import Real


def turned_to(angle: Real, middle: Real) -> Real:
    """An angle by whole turns in (middle − π, middle + π]."""
    return angle - 2.0 * pi * ceil((angle - middle) / (2.0 * pi) - 0.5)


def within_turn(angle: Real, lower: Real, upper: Real) -> Real:
    """An angle by whole turns nearest to the middle of its bounds; as it is where there are none."""
    found = angle
    if isfinite(lower) and isfinite(upper):
        found = turned_to(angle, (lower + upper) / 2.0)
    return found
