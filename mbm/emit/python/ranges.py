"""Python text for the closed form of ranges beside a start: its constants, and the function that solves."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.python.text import literal
from mbm.emit.types import Blueprint
from mbm.solver.range_maps import RangeMaps
from mbm.solver.spheres import MOST_PLACES, SCRATCH

PLAIN = '''def solve_first(p: Prepared) -> None:
    """The solve from the start."""
    solve_alone(p.system, p.data, p.start, p.work)
'''
BESIDE = '''def solve_first(p: Prepared) -> None:
    """The solve from the start, or where the ranges lead if that is lower, or if no start is stated."""
    form, units = RangeForm(), 1 + sum(
        int(p.data[DATA_HEAD + DATA_BLOCK * b + DATA_ROWS]) for b in range(len(CASES))
    ) * len(RANGE_MAP_PLACES)
    ranges = form.ranges
    ranges.d, ranges.offset, ranges.even = RANGE_KIND
    ranges.spheres, ranges.weights, ranges.scratch = (
        reals((ranges.d + 3) * units), reals(units), reals(RANGE_SCRATCH)
    )
    form.rooted, form.held, form.stated = RANGE_ROOTED, RANGE_HELD, RANGE_STATED
    form.places, form.map_places, form.maps = RANGE_PLACES, RANGE_MAP_PLACES, RANGE_MAPS
    form.fixed_count, form.fixed, form.values = len(RANGE_FIXED), RANGE_FIXED, RANGE_VALUES
    numbers = p.offsets[len(NAMES)]
    form.found, form.point, form.other = reals(RANGE_FOUND), reals(numbers), reals(numbers)
    if any(name not in p.given for name in STARTLESS_ONES) and not begin_at_ranges(
        p.system, p.start, form, p.work
    ):
        raise DataError("the data give no start: state one")
    solve_from(p.system, p.data, 0, p.start, form, p.work)
'''


def range_constants(blueprint: Blueprint, ranges: RangeMaps) -> Iterator[tuple[str, str, str]]:
    """Names, values and documentation of what ranges say of the start."""
    startless = [literal(u.name) for i, u in enumerate(blueprint.unknowns) if i in ranges.startless]
    kind = f"({ranges.dimension}, {int(ranges.offset)}, {int(ranges.even)})"
    yield "RANGE_KIND", kind, "Dimensions, whether an offset is unknown, whether its sign is open."
    yield "RANGE_ROOTED", str(int(ranges.rooted)), "Whether the maps give the root of what is added."
    yield "RANGE_STATED", str(int(ranges.stated)), "Whether the noise is stated."
    doc = "Where what the ranges give stands among the numbers."
    yield "RANGE_PLACES", f"np.array({list(ranges.places)!r}, dtype=np.int64)", doc
    doc = "Of each kind of unit: where its map begins, -1: it is no range."
    yield "RANGE_MAP_PLACES", f"np.array({list(ranges.map_places)!r}, dtype=np.int64)", doc
    doc = "From the data of a row to station, length, addition and slope."
    yield "RANGE_MAPS", f"np.array({list(ranges.maps)!r})", doc
    yield "RANGE_FIXED", f"np.array({list(ranges.fixed)!r}, dtype=np.int64)", "Numbers that are not estimated …"
    yield "RANGE_HELD", str(int(ranges.held)), "Whether the maps hold only for numbers as they were."
    doc = "… and what they were."
    yield "RANGE_VALUES", f"np.array({list(ranges.values)!r}, dtype=float)", doc
    yield "RANGE_SCRATCH", str(SCRATCH), "Numbers of scratch."
    yield "RANGE_FOUND", str(MOST_PLACES * len(ranges.places)), "Numbers of the places that fit."
    yield (
        "STARTLESS_ONES",
        f"({''.join(f'{name}, ' for name in startless)})",
        "Unknowns that begin where the data say, unless a start is given.",
    )
