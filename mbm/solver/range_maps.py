"""The closed form of ranges for a problem, as plain values: what `range_form.RangeForm` is filled with."""

from __future__ import annotations

from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeMaps:
    """Ranges that give all numbers which are estimated, and what of the data tells them.

    ``dimension`` is 2 or 3, ``offset`` and ``even`` as `Ranges` has them, ``rooted`` as `RangeForm`; ``places`` (m,)
    are those of the numbers.
    ``map_places`` has for each unit of each block of residuals where its map begins in ``maps``, -1: nothing is known.
    The numbers ``fixed`` (F,) are not estimated: maps take them as data, or hold (``held``) where they are ``values``.
    ``stated``: the noise is stated. ``startless`` are the unknowns (positions) that begin at the ranges, unless a
    generated solver is given a start.
    """

    dimension: int
    offset: bool
    even: bool
    rooted: bool
    places: tuple[int, ...]
    map_places: tuple[int, ...]
    maps: tuple[float, ...]
    fixed: tuple[int, ...]
    values: tuple[float, ...]
    held: bool
    stated: bool
    startless: frozenset[int] = frozenset()

    @property
    def whole(self) -> bool:
        """Whether nothing but ranges is measured, which might lead elsewhere, and the maps hold for all data."""
        return min(self.map_places) >= 0 and not (self.held and self.fixed)
