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
    text = [
        longs("RANGE_PLACES", ranges.places, "Where what the ranges give stands among the numbers."),
        longs("RANGE_MAP_PLACES", ranges.map_places, "Of each kind of unit: where its map begins, -1: no range."),
        doubles("RANGE_MAPS", ranges.maps, "From the data of a row to station, length, addition and slope."),
        longs("RANGE_FIXED", ranges.fixed or (0,), "Numbers that are not estimated …"),
        doubles("RANGE_VALUES", ranges.values or (0.0,), "… and what they were."),
    ]
    return "\n".join(text)


def range_fields() -> Iterator[str]:
    """Arrays of the frame."""
    yield from (
        "    struct range_form form;    /* what the ranges say of where to begin */",
        "    int startless;",
    )


def range_room(blueprint: Blueprint, ranges: RangeMaps) -> Iterator[str]:
    """How much the arrays take at most."""
    cells = Cells(blueprint)
    yield from ("    {    /* ranges */", "        long units = 1;")
    for block in blueprint.blocks:
        if block.role is not BlockRole.CONSTRAINT:
            rows = "1" if block.table is None else cells.rows(block.table)
            yield f"        units += {rows} * {max((len(case.equations) for case in block.cases), default=0)};"
    yield from (
        f"        f->form.ranges.spheres = reals_of(a, {ranges.dimension + 3} * units);",
        "        f->form.ranges.weights = reals_of(a, units);",
        f"        f->form.ranges.scratch = reals_of(a, {SCRATCH});",
        f"        f->form.found = reals_of(a, {MOST_PLACES * len(ranges.places)});",
        "        f->form.point = reals_of(a, numbers);",
        "        f->form.other = reals_of(a, numbers);",
        "    }",
    )


def range_beginning(blueprint: Blueprint, ranges: RangeMaps) -> Iterator[str]:
    """Statements of ``prepare``."""
    unknowns = (blueprint.unknowns[i] for i in sorted(ranges.startless))
    tests = " || ".join(f"data->start_{unknown.identifier} == NULL" for unknown in unknowns)
    yield from (
        f"    f->form.ranges.d = {ranges.dimension};",
        f"    f->form.ranges.offset = {int(ranges.offset)};",
        f"    f->form.ranges.even = {int(ranges.even)};",
        f"    f->form.rooted = {int(ranges.rooted)};",
        f"    f->form.stated = {int(ranges.stated)};",
        "    f->form.places = RANGE_PLACES;",
        "    f->form.map_places = RANGE_MAP_PLACES;",
        "    f->form.maps = RANGE_MAPS;",
        f"    f->form.held = {int(ranges.held)};",
        f"    f->form.fixed_count = {len(ranges.fixed)};",
        "    f->form.fixed = RANGE_FIXED;",
        "    f->form.values = RANGE_VALUES;",
        f"    f->startless = {tests or '0'};",
    )


def range_solve(ranges: RangeMaps, no_start: str) -> Iterator[str]:
    """Statements of the solve: from the start, or where the ranges lead; ``no_start`` is a status."""
    if ranges.startless:
        yield from (
            "    if (f->startless && begin_at_ranges(f->system, f->start, &f->form, &f->work) == 0)",
            f"        return result->status = {no_start};",
        )
    yield "    solve_from(f->system, f->data_set, 0, f->start, &f->form, &f->work);"
