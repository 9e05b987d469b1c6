"""The closed form of ranges as the solver takes it, beside starts: `mbm.solver.range_form`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbm.machine.records import inside, put
from mbm.solver.range_maps import RangeMaps
from mbm.solver.workspace import MOST_PLACES, SCRATCH, RangeForm, Ranges


def hand(ranges: RangeMaps, form: Any, numbers: int, rows: int) -> tuple[NDArray[Any], ...]:
    """Let a `RangeForm` have ``ranges``, with scratch for so many numbers and rows; what is to be kept alive."""
    m, units = ranges.dimension + ranges.offset, rows * len(ranges.map_places) + 1
    spheres, weights = np.empty(units * (ranges.dimension + 3)), np.empty(units)
    scratch, found, points = np.empty(SCRATCH), np.empty(MOST_PLACES * m), np.empty((2, numbers))
    places, map_places = np.array(ranges.places), np.array(ranges.map_places)
    fixed, maps, values = np.array(ranges.fixed, dtype=np.int64), np.array(ranges.maps), np.array(ranges.values)
    put(
        inside(form, RangeForm, "ranges"),
        Ranges,
        d=ranges.dimension,
        offset=int(ranges.offset),
        even=int(ranges.even),
        spheres=spheres,
        weights=weights,
        scratch=scratch,
    )
    put(
        form,
        RangeForm,
        rooted=int(ranges.rooted),
        stated=int(ranges.stated),
        places=places,
        map_places=map_places,
        maps=maps,
        fixed_count=len(ranges.fixed),
        fixed=fixed,
        values=values,
        held=int(ranges.held),
        found=found,
        point=points[0],
        other=points[1],
    )
    return spheres, weights, scratch, found, points, places, map_places, fixed, maps, values
