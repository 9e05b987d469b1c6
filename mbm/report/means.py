"""A root mean square of raw residuals, and what it is over."""

from __future__ import annotations

from mbm.values import dataclass

OVER_ROWS, OVER_POINTS, COORDINATE = "row", "point", "coordinate"
"""What the mean of a number is over, and those of a vector."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RootMean:
    """A root mean square of raw residuals in their ``unit`` (None: none is known); ``value`` None: it is not finite.

    ``per`` says over what: ``row`` (of numbers), ``point`` (of the lengths of vectors), ``coordinate`` (of all their
    components), ``coordinate 2`` (of one), ``coordinates 1-3`` (of the lengths of these, which have one unit).
    ``equation`` counts from 1 where the clause has several. ``brief``: tables show it, not documents alone.
    """

    per: str
    value: float | None
    unit: str | None
    equation: int | None = None
    brief: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class RawResiduals:
    """What is said of raw residuals: their root means, and the rows (from 1 in the unfiltered table) that see a point
    behind its camera.
    """

    means: tuple[RootMean, ...] = ()
    behind: tuple[int, ...] = ()
