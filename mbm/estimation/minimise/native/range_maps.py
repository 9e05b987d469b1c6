"""The closed form of ranges as the solver takes it, beside starts: `mbm.solver.range_form`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbm.equations.types import Floats, Indices
from mbm.machine.records import inside, put
from mbm.solver.range_form import RangeForm
from mbm.solver.spheres import MOST_PLACES, SCRATCH, Ranges
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RangeMaps:
    """Ranges that give all numbers which are estimated, and what of the data tells them.

    ``dimension`` is 2 or 3, ``offset`` and ``even`` as `Ranges` has them, ``rooted`` as `RangeForm`; ``places`` (m,)
    are those of the numbers.
    ``map_places`` has for each unit of each group of residuals where its map begins in ``maps``, -1: nothing is known.
    The numbers ``fixed`` (F,) are not estimated: maps take them as data, or hold (``held``) where they are ``values``.
    ``stated``: the noise is stated.
    """

    dimension: int
    offset: bool
    even: bool
    rooted: bool
    places: Indices
    map_places: Indices
    maps: Floats
    fixed: Indices
    values: Floats
    held: bool
    stated: bool

    @property
    def whole(self) -> bool:
        """Whether nothing but ranges is measured, which might lead elsewhere, and the maps hold for all data."""
        return bool((self.map_places >= 0).all()) and not (self.held and len(self.fixed))

    def hand(self, form: Any, numbers: int, rows: int) -> tuple[NDArray[Any], ...]:
        """Let a `RangeForm` have it, with scratch for so many numbers and rows; what is to be kept alive."""
        m, units = self.dimension + self.offset, rows * len(self.map_places) + 1
        spheres, weights = np.empty(units * (self.dimension + 3)), np.empty(units)
        scratch, found, points = np.empty(SCRATCH), np.empty(MOST_PLACES * m), np.empty((2, numbers))
        put(
            inside(form, RangeForm, "ranges"),
            Ranges,
            d=self.dimension,
            offset=int(self.offset),
            even=int(self.even),
            spheres=spheres,
            weights=weights,
            scratch=scratch,
        )
        put(
            form,
            RangeForm,
            rooted=int(self.rooted),
            stated=int(self.stated),
            places=self.places,
            map_places=self.map_places,
            maps=self.maps,
            fixed_count=len(self.fixed),
            fixed=self.fixed,
            values=self.values,
            held=int(self.held),
            found=found,
            point=points[0],
            other=points[1],
        )
        return spheres, weights, scratch, found, points
