"""C functions that set an unknown up: where its numbers begin, their bounds, which of its coordinates stay."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.cells import Cells
from mbm.emit.c.text import remark
from mbm.emit.types import Blueprint, RowPrograms, UnknownShape
from mbm.machine.c import number as written
from mbm.problem.types import UnknownKind


def unknown_functions(blueprint: Blueprint) -> str:
    """One function for each unknown, and one that calls them all."""
    cells = Cells(blueprint)
    parts = ["\n".join(_function(blueprint, cells, i, u)) for i, u in enumerate(blueprint.unknowns)]
    calls = [
        "/* Starts, bounds and what stays, of all unknowns. */",
        "static int set_up(struct frame *f)",
        "{",
        "    int status = 0;",
        "",
    ]
    for unknown in blueprint.unknowns:
        calls += ["    if (status == 0)", f"        status = set_up_{unknown.identifier}(f);"]
    return "\n".join([*parts, *calls, "    return status;", "}", ""])


def _function(blueprint: Blueprint, cells: Cells, position: int, unknown: UnknownShape) -> Iterator[str]:
    yield from (
        remark("`", unknown.name, "`", *((": ", unknown.doc) if unknown.doc else ()), "."),
        f"static int set_up_{unknown.identifier}(struct frame *f)",
        "{",
        f"    const {blueprint.identifier}_data *data = f->data;",
    )
    programs = _programs(unknown)
    wide = max((len(c.inputs) for p in programs for c in p.cases), default=0)
    if wide or programs:
        yield f"    double inputs[{max(wide, 1)}];"
    yield from (
        f"    double stated[{_stated_width(unknown)}];",
        f"    double lower[{unknown.freedom}], upper[{unknown.freedom}];",
    )
    if unknown.start_range is not None:
        yield f"    double least[{unknown.freedom}], greatest[{unknown.freedom}];"
    if unknown.fixed is not None:
        yield f"    double fixed[{unknown.freedom}];"
    if unknown.lower is not None or unknown.upper is not None:
        yield f"    double bounds[{len(unknown.bounded)}];"
    yield from ("    long m, c;", "", "    (void)stated;")
    if not any(c.inputs for p in programs for c in p.cases) and programs:
        yield "    inputs[0] = 0.0;"
    yield f"    for (m = 0; m < f->members[{position}]; m++) {{"
    if unknown.family is not None:
        yield f"        const long row = f->{blueprint.families[unknown.family].identifier}[m];"
    yield from (
        f"        const long number = f->offsets[{position}] + m * {unknown.size};",
        f"        const long first = f->firsts[{position}] + m * {unknown.freedom};",
        *(f"        {line}" for line in _member(cells, unknown)),
        "    }",
        "    return 0;",
        "}",
        "",
    )


def _programs(unknown: UnknownShape) -> list[RowPrograms]:
    every = (unknown.start, *(unknown.start_range or ()), unknown.lower, unknown.upper, unknown.fixed)
    return [p for p in every if p is not None]


def _stated_width(unknown: UnknownShape) -> int:
    return max(unknown.size, unknown.start.width if unknown.start is not None else 0)


def _member(cells: Cells, unknown: UnknownShape) -> Iterator[str]:
    """Statements for member ``m``."""
    if unknown.family is not None:
        yield "(void)row;"
    yield from (
        f"for (c = 0; c < {unknown.freedom}; c++) {{",
        "    lower[c] = -HUGE_VAL;",
        "    upper[c] = HUGE_VAL;",
        "}",
    )
    for programs, target in ((unknown.lower, "lower"), (unknown.upper, "upper")):
        if programs is not None:
            yield from cells.call(programs, "bounds", "")
            yield from (f"{target}[{coordinate}] = bounds[{i}];" for i, coordinate in enumerate(unknown.bounded))
    if unknown.fixed is not None:
        yield from cells.call(unknown.fixed, "fixed", "")
    if unknown.start_range is not None:
        yield from _range(cells, unknown)
    yield from (
        f"for (c = 0; c < {unknown.freedom}; c++) {{",
        "    if (!(lower[c] < upper[c]))",
        f"        return {cells.status('BAD_BOUNDS')};",
        "    f->lower[first + c] = lower[c];",
        "    f->upper[first + c] = upper[c];",
        f"    f->fixed[first + c] = {'fixed[c] == 1.0' if unknown.fixed is not None else '0'};",
        "}",
        f"if (data->start_{unknown.identifier} != NULL) {{",
        f"    for (c = 0; c < {unknown.size}; c++)",
        f"        f->start[number + c] = data->start_{unknown.identifier}[m * {unknown.size} + c];",
        "    continue;",
        "}",
        *_start(cells, unknown),
    )


def _range(cells: Cells, unknown: UnknownShape) -> Iterator[str]:
    """The range of starts, (−∞, ∞) for what has none."""
    assert unknown.start_range is not None  # noqa: S101 - the caller has asked
    for programs, target, far in zip(
        unknown.start_range, ("least", "greatest"), ("-HUGE_VAL", "HUGE_VAL"), strict=True
    ):
        yield from (
            f"for (c = 0; c < {unknown.freedom}; c++)",
            f"    {target}[c] = {far};",
            *cells.call(programs, "stated", ""),
            *(f"{target}[{coordinate}] = stated[{i}];" for i, coordinate in enumerate(unknown.bounded)),
        )


def _start(cells: Cells, unknown: UnknownShape) -> Iterator[str]:
    if unknown.falls_back:
        fallback = unknown.fallback or (float("nan"),) * unknown.size
        yield from (f"f->start[number + {i}] = {written(value)};" for i, value in enumerate(fallback))
        return
    if unknown.start is None:
        yield from (f"stated[{i}] = HUGE_VAL;" for i in range(unknown.size))
    else:
        yield from cells.call(unknown.start, "stated", "")
    if unknown.dimension:
        yield from _turned(unknown)
        return
    ends = "least[c], greatest[c]" if unknown.start_range is not None else "-HUGE_VAL, HUGE_VAL"
    yield from (
        f"for (c = 0; c < {unknown.size}; c++) {{",
        f"    const double found = begun(stated[c], {ends}, lower[c], upper[c]);",
    )
    within = "within_turn(found, lower[c], upper[c])" if unknown.angles else "found"
    yield f"    f->start[number + c] = {within};"
    if unknown.positive:
        yield from ("    if (!(found > 0.0))", f"        return {cells.status('BAD_START')};")
    yield "}"


def _turned(unknown: UnknownShape) -> Iterator[str]:
    """Directions, rotations, poses and similarities: stated as a vector, or as a matrix and what follows it."""
    if unknown.kind is UnknownKind.DIRECTION:
        yield "unit_vector(stated, f->start + number);"
        return
    square = unknown.dimension**2
    if unknown.dimension == 3:
        yield "quaternion_of_matrix(stated, f->start + number);"
    else:
        yield "f->start[number] = angle_of_matrix(stated);"
    held = 4 if unknown.dimension == 3 else 1
    yield from (f"f->start[number + {held + i}] = stated[{square + i}];" for i in range(unknown.size - held))
