"""C text for the closed form of ranges beside a start: its arrays in the frame, and what is done with them."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.cells import Cells
from mbm.emit.c.text import doubles, longs
from mbm.emit.types import Blueprint
from mbm.problem.types import BlockRole
from mbm.solver.range_maps import RangeMaps
from mbm.solver.workspace import MOST_PLACES, SCRATCH


def range_constants(ranges: RangeMaps) -> str:
    """The arrays that do not depend on data."""
    text = [longs("RANGE_PLACES", ranges.places, "Where what the ranges give stands among the numbers.")]
    text += [longs("RANGE_MAP_PLACES", ranges.map_places, "Of each kind of unit: where its map begins, -1: no range.")]
    text += [doubles("RANGE_MAPS", ranges.maps, "From the data of a row to station, length, addition and slope.")]
    text += [longs("RANGE_FIXED", ranges.fixed or (0,), "Numbers that are not estimated …")]
    text += [doubles("RANGE_VALUES", ranges.values or (0.0,), "… and what they were.")]
    return "\n".join(text)


def range_fields() -> Iterator[str]:
    """Arrays of the frame."""
    yield "    struct range_form form;    /* what the ranges say of where to begin */"
    yield "    int startless;"


def range_room(blueprint: Blueprint, ranges: RangeMaps) -> Iterator[str]:
    """How much the arrays take at most."""
    cells = Cells(blueprint)
    yield "    {    /* ranges */"
    yield "        long units = 1;"
    for block in blueprint.blocks:
        if block.role is not BlockRole.CONSTRAINT:
            rows = "1" if block.table is None else cells.rows(block.table)
            yield f"        units += {rows} * {max((len(case.equations) for case in block.cases), default=0)};"
    yield f"        f->form.ranges.spheres = reals_of(a, {ranges.dimension + 3} * units);"
    yield "        f->form.ranges.weights = reals_of(a, units);"
    yield f"        f->form.ranges.scratch = reals_of(a, {SCRATCH});"
    yield f"        f->form.found = reals_of(a, {MOST_PLACES * len(ranges.places)});"
    yield "        f->form.point = reals_of(a, numbers);"
    yield "        f->form.other = reals_of(a, numbers);"
    yield "    }"


def range_beginning(blueprint: Blueprint, ranges: RangeMaps) -> Iterator[str]:
    """Statements of ``prepare``."""
    unknowns = (blueprint.unknowns[i] for i in sorted(ranges.startless))
    tests = " || ".join(f"data->start_{unknown.identifier} == NULL" for unknown in unknowns)
    yield f"    f->form.ranges.d = {ranges.dimension};"
    yield f"    f->form.ranges.offset = {int(ranges.offset)};"
    yield f"    f->form.ranges.even = {int(ranges.even)};"
    yield f"    f->form.rooted = {int(ranges.rooted)};"
    yield f"    f->form.stated = {int(ranges.stated)};"
    yield "    f->form.places = RANGE_PLACES;"
    yield "    f->form.map_places = RANGE_MAP_PLACES;"
    yield "    f->form.maps = RANGE_MAPS;"
    yield f"    f->form.held = {int(ranges.held)};"
    yield f"    f->form.fixed_count = {len(ranges.fixed)};"
    yield "    f->form.fixed = RANGE_FIXED;"
    yield "    f->form.values = RANGE_VALUES;"
    yield f"    f->startless = {tests or '0'};"


def range_solve(ranges: RangeMaps, no_start: str) -> Iterator[str]:
    """Statements of the solve: from the start, or where the ranges lead; ``no_start`` is a status."""
    if ranges.startless:
        yield "    if (f->startless && begin_at_ranges(f->system, f->start, &f->form, &f->work) == 0)"
        yield f"        return result->status = {no_start};"
    yield "    solve_from(f->system, f->data_set, 0, f->start, &f->form, &f->work);"
