"""Degrees of freedom and hard limits of many solves in columns."""

from __future__ import annotations

from mbm.equations.spreads import Freedom, Limited
from mbm.equations.types import Mask
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DegreesColumns:
    """Of T solves the freedom (T, n) of the estimates, and (T, size) of each derived quantity.

    ``poor`` (T,): some intervals fall short even so. ``limited`` (T, n) are hard limits of the estimates (None: there
    are none).
    """

    estimates: Freedom
    derived: tuple[Freedom, ...]
    poor: Mask
    limited: Limited | None = None

    def first(self, count: int) -> DegreesColumns:
        """Those of the first ``count`` solves."""
        return DegreesColumns(
            estimates=self.estimates.first(count),
            derived=tuple(each.first(count) for each in self.derived),
            poor=self.poor[:count],
            limited=None if self.limited is None else self.limited.first(count),
        )
