"""C functions of a generated filter that compute quantities from the estimates of a step.

What a row takes of the tables, and which members it picks, is kept with its step: smoothers answer later.
"""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.cells import Cells
from mbm.emit.c.derived import evaluated, found_number, patterns, slopes, tests
from mbm.emit.c.filter_clauses import placed
from mbm.emit.c.filter_memory import DerivedRoom, derived_rooms
from mbm.emit.c.text import remark
from mbm.emit.filtering.types import FilterBlueprint
from mbm.emit.types import BlockCase, SlotPlace


def derived_functions(made: FilterBlueprint) -> str:
    """What keeps the rows of each quantity, and what evaluates it."""
    cells = Cells(made.blueprint)
    rooms = derived_rooms(made)
    parts = ["\n".join((*_keep(cells, room), *_derive(made, room))) for room in rooms]
    return "\n".join([*parts, *_keep_all(cells, rooms)]) if rooms else ""


def derived_answers(made: FilterBlueprint) -> Iterator[str]:
    """Statements that answer the quantities of the step whose arrays stand at `place`."""
    for room in derived_rooms(made):
        name = room.derived.identifier
        yield f"    derive_{name}(f, place);"
        if not room.once:
            yield f"    result->{name}_rows = f->memory->integers[AT_COUNT_{room.number} + place];"
        yield from (
            f"    result->{name}{suffix} = reals + AT_DERIVED_{room.number}{part};"
            for suffix, part in (("", ""), ("_sigma", "_SIGMA"), ("_covariance", "_COVARIANCE"))
        )


def _keep(cells: Cells, room: DerivedRoom) -> Iterator[str]:
    derived = room.derived
    filtered = derived.table is not None and cells.blueprint.table(derived.table).where is not None
    yield from (
        remark("Keeps what the rows of `", derived.name, "` take; 0: one is in none of its cases."),
        f"static int keep_{derived.identifier}(struct frame *f, long place)",
        "{",
        f"    const {cells.blueprint.identifier}_data *data = f->data;",
        f"    double *const given = f->memory->reals + AT_TAKEN_{room.number} + place * {room.rows * room.given};",
        f"    long *const picked = f->memory->integers + AT_PICKED_{room.number} + place * {room.rows * room.picked};",
        f"    long {'' if derived.table is None else 'i, ' if filtered else 'row, '}used = 0;",
        "",
        "    (void)data;",
        "    (void)given;",
    )
    opened, closed = cells.loop(derived.table)
    yield from opened
    yield from ("        (void)row;",) if derived.table is not None else ()
    for number, case in enumerate(derived.cases):
        yield from (f"        {line}" for line in _kept(cells, room, case, number))
    if any(case.static for case in derived.cases):
        yield "        return 0;"
    yield from (
        *closed,
        f"    f->memory->integers[AT_COUNT_{room.number} + place] = used;",
        "    return 1;",
        "}",
        "",
    )


def _kept(cells: Cells, room: DerivedRoom, case: BlockCase, number: int) -> Iterator[str]:
    test = tests(cells, case)
    yield from (f"if ({test}) {{" if test else "{", f"    picked[used * {room.picked}] = {number};")
    for i, link in enumerate(room.links, start=1):
        if any(slot.member == link for slot in (*case.variables, *case.tangents)):
            yield f"    picked[used * {room.picked} + {i}] = {cells.member(link)};"
    yield from (
        *(f"    given[used * {room.given} + {i}] = {cells.input(value)};" for i, value in enumerate(case.parameters)),
        "    used++;",
        *(("    continue;",) if test else ()),
        "}",
    )


def _derive(made: FilterBlueprint, room: DerivedRoom) -> Iterator[str]:
    derived, number, n = room.derived, room.number, made.plan.chain["n"]
    size = derived.size
    yield from (
        remark("`", derived.name, "` of the step whose arrays stand at `place`."),
        f"static void derive_{derived.identifier}(const struct frame *f, long place)",
        "{",
        "    double *const reals = f->memory->reals;",
        "    const double *const point = reals + AT_REPORTED;",
        f"    const long count = f->memory->integers[AT_COUNT_{number} + place];",
        *patterns(derived),
        "    long row;",
        "",
        "    (void)point;",
        "    for (row = 0; row < count; row++) {",
        f"        const double *const given = reals + AT_TAKEN_{number} + (place * {room.rows} + row) * {room.given};",
        f"        const long *const picked = f->memory->integers + AT_PICKED_{number}",
        f"            + (place * {room.rows} + row) * {room.picked};",
        f"        double *const found = reals + AT_DERIVED_{number} + row * {size};",
        "",
        "        (void)given;",
    )
    for k, case in enumerate(derived.cases):
        yield from (
            f"        if (picked[0] == {k}) {{",
            *(f"            {line}" for line in _evaluated(made, room, case)),
            f"            for (c = 0; c < {size}; c++) {{",
            f"                found[c] = {found_number(derived)};",
            f"                gather_gradient({n}, c, {slopes(derived, k)}, reals + AT_SLOPES + c * {n});",
            "            }",
            "        }",
        )
    yield from (
        f"        put_spread({n}, {size}, f->walk.factors + place * {n * n}, f->walk.touched + place * {n},",
        f"            reals + AT_SLOPES, reals + AT_DERIVED_{number}_COVARIANCE + row * {size * size},",
        f"            reals + AT_DERIVED_{number}_SIGMA + row * {size});",
        "    }",
        "}",
        "",
    )


def _evaluated(made: FilterBlueprint, room: DerivedRoom, case: BlockCase) -> Iterator[str]:
    def place(slot: SlotPlace, *, index: bool) -> str:
        member = "" if slot.member is None else f"picked[{1 + room.links.index(slot.member)}]"
        return placed(made, slot, member, index=index, moves=False)

    variables = (f"point[{place(slot, index=True)}]" for slot in case.variables)
    columns = (place(slot, index=False) for slot in case.tangents)
    return evaluated(case, variables, (f"given[{i}]" for i in range(len(case.parameters))), columns)


def _keep_all(cells: Cells, rooms: tuple[DerivedRoom, ...]) -> Iterator[str]:
    yield from (
        "/* What the rows of all quantities of a step take. */",
        "static int keep_derived(struct frame *f, long place)",
        "{",
    )
    kept = "\n        && ".join(f"keep_{room.derived.identifier}(f, place)" for room in rooms)
    yield from (
        f"    return {kept}",
        f"        ? 0 : {cells.status('UNKNOWN_CASE')};",
        "}",
        "",
    )
