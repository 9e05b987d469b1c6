"""The memory of a generated filter: what lasts from step to step, and the frame of a call that refers to it."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.frame import ends
from mbm.emit.c.text import remark
from mbm.emit.filtering.types import FilterBlueprint
from mbm.emit.types import Blueprint, DerivedShape, TableShape
from mbm.machine.c import number
from mbm.machine.kinds import Held
from mbm.machine.records import plans_of
from mbm.solver.filter_records import Walk
from mbm.values import dataclass

INTEGERS = ("STEP", "STOPPED", "OBSERVED", "LEFT", "SWAPPED")
"""What a filter remembers beside the walk: the step to come, counted round; whether no step may come any more, and one
with observations has; the next step of a smoother that is left, and whether its paths have changed places."""

_SWAP = """    if (integers[AT_SWAPPED] != 0) {
        double *const path = f->walk.path, *const noises = f->walk.noises;
        f->walk.path = f->walk.path_tried;
        f->walk.path_tried = path;
        f->walk.noises = f->walk.noises_tried;
        f->walk.noises_tried = noises;
    }"""


def saved() -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The reals and the integers of a walk that last from step to step."""
    values = [plan for plan in plans_of(Walk) if plan.held is Held.VALUE and plan.name not in ("skip", "tolerance")]
    return tuple(p.name for p in values if p.text == "Real"), tuple(p.name for p in values if p.text == "Integer")


@dataclass(frozen=True, slots=True, kw_only=True)
class DerivedRoom:
    """Room for quantity ``number``: at most so many ``rows``, each of which takes so many numbers (``given``) of
    tables and picks a member by each of the ``links``. ``once``: there is one row at every step.
    """

    derived: DerivedShape
    number: int
    rows: int
    given: int
    links: tuple[int, ...]
    once: bool

    @property
    def picked(self) -> int:
        """Integers of a row: its case, and its members."""
        return 1 + len(self.links)


def derived_rooms(made: FilterBlueprint) -> tuple[DerivedRoom, ...]:
    """Those of all quantities."""
    found = []
    for place, derived in enumerate(made.blueprint.derived):
        slots = (slot for case in derived.cases for slot in (*case.variables, *case.tangents))
        table = None if derived.table is None else made.blueprint.table(derived.table)
        found.append(
            DerivedRoom(
                derived=derived,
                number=place,
                rows=1 if table is None else capacity(made, table),
                given=max((len(case.parameters) for case in derived.cases), default=0),
                links=tuple(dict.fromkeys(slot.member for slot in slots if slot.member is not None)),
                once=derived.table in (None, made.plan.steps),
            )
        )
    return tuple(found)


def places(made: FilterBlueprint) -> tuple[dict[str, int], dict[str, int]]:
    """The sizes of the parts of the two arrays that a filter is, by name, in their order."""
    plan = made.plan
    held, n, numbers = (plan.chain[name] for name in ("held", "n", "numbers"))
    moving = n - plan.chain["still"]
    reals = {
        "WALK": plan.reals,
        "ROWS": plan.seen.reals,
        "MOVES": plan.moving.reals,
        "SEEN_PARAMETERS": plan.seen.sizes[0],
        "SEEN_WEIGHTS": plan.seen.sizes[1],
        "MOVING_PARAMETERS": plan.moving.sizes[0],
        "MOVING_WEIGHTS": plan.moving.sizes[1],
        "SPREADS": held * moving * plan.chain["noises"] + 1,
        "POINTS": held * numbers,
        "FACTORS": held * n * n,
        "COSTS": held,
        "KEYS": held,
        "COVARIANCE": n * n,
        "DEVIATIONS": n,
        "SIGMAS": len(plan.column),
        "REPORTED": numbers,
        "SAVED": len(saved()[0]),
    }
    rooms = derived_rooms(made)
    reals["SLOPES"] = 2 * n * max((room.derived.size for room in rooms), default=0)
    for room in rooms:
        size = room.derived.size
        reals[f"TAKEN_{room.number}"] = held * room.rows * room.given
        reals[f"DERIVED_{room.number}"] = reals[f"DERIVED_{room.number}_SIGMA"] = room.rows * size
        reals[f"DERIVED_{room.number}_COVARIANCE"] = room.rows * size * size
    integers = {
        "WALK_INTEGERS": plan.integers + 1,
        "SEEN_INDEX": plan.seen.sizes[2],
        "SEEN_COLUMNS": plan.seen.sizes[3],
        "SEEN_DATA": len(plan.seen.data),
        "MOVING_INDEX": plan.moving.sizes[2],
        "MOVING_COLUMNS": plan.moving.sizes[3],
        "MOVING_DATA": len(plan.moving.data),
        "OPENS": held,
        "TOUCHED": held * n,
        "FOLLOWED": held,
        "SAVED_INTEGERS": len(saved()[1]),
        "TOLD": len(plan.seen.groups),
        **dict.fromkeys(INTEGERS, 1),
        **{f"PICKED_{room.number}": held * room.rows * room.picked for room in rooms},
        **{f"COUNT_{room.number}": held for room in rooms},
    }
    return reals, integers


def capacity(made: FilterBlueprint, table: TableShape) -> int:
    """The most rows that a table has."""
    plan = made.plan
    if table.name in plan.rows:
        return plan.rows[table.name]
    given = next(each for each in made.blueprint.given if each.name == table.name)
    return 1 if table.name in (plan.steps, plan.reached) else max(len(next(iter(given.columns.values()))), 1)


def memory_text(made: FilterBlueprint) -> str:
    """The places of the parts, the tables that the filter is given, the frame, and what opens and closes it."""
    parts = ["/* Where the parts of a filter's two arrays begin. */", "enum {"]
    lines = []
    for sizes in places(made):
        first = 0
        for name, size in sizes.items():
            lines.append(f"    AT_{name} = {first}")
            first += size
    return "\n".join([*parts, ",\n".join(lines), "};", "", *_frame(made), *_open(made), *_close(), ""])


def data_text(made: FilterBlueprint) -> str:
    """The struct of all tables."""
    return "\n".join(_data(made))


def _data(made: FilterBlueprint) -> Iterator[str]:
    name = made.blueprint.identifier
    yield from (
        "/* All tables: those of the step at hand, and those that are the same at all steps. */",
        "typedef struct {",
    )
    for table in made.blueprint.tables:
        yield f"    long {table.identifier}_rows;    {remark(table.name)}"
        for column in table.columns:
            kind = "const char *const *" if column.is_text else "const double *"
            yield f"    {kind}{table.identifier}_{column.identifier};"
    yield from (f"}} {name}_data;", "")


def _frame(made: FilterBlueprint) -> Iterator[str]:
    blueprint: Blueprint = made.blueprint
    most = max(capacity(made, table) for table in blueprint.tables) if blueprint.tables else 1
    yield from (
        "/* What a call works with, beside the filter itself. */",
        "struct frame {",
        f"    {blueprint.identifier}_filter *memory;",
        f"    const {blueprint.identifier}_data *data;",
        f"    {blueprint.identifier}_data given;",
        "    struct chain chain;",
        "    struct walk walk;",
        "    struct rows rows, moves;",
        f"    double keys[{most}], previous, dt;",
        "    double *parameters, *weights, *spread;",
        f"    double scratch[{_widest(made)}];",
        "    long *index, *columns;",
        "    long parameters_used, weights_used, index_used, columns_used, count, moves_count;",
        f"    long chosen[{most}];",
    )
    yield from (
        f"    long kept_of_{table.identifier}[{capacity(made, table)}], kept_of_{table.identifier}_count;"
        for table in blueprint.tables
        if table.where is not None
    )
    yield from (f"    long {choice.value}_of_{blueprint.table(name).identifier};" for name, choice in ends(blueprint))
    for link in blueprint.links:
        rows = 1 if link.table is None else capacity(made, blueprint.table(link.table))
        yield f"    long {link.identifier}[{rows}];    {remark('the row of `', link.target, '` that each row names')}"
    yield from ("};", "")


def _widest(made: FilterBlueprint) -> int:
    """Reals of the largest matrix of noise."""
    sizes = [e.last - e.first for case in (*made.seen, *made.moving) for e in case.equations]
    return max(sizes, default=1) ** 2


def _open(made: FilterBlueprint) -> Iterator[str]:
    plan, name = made.plan, made.blueprint.identifier
    reals, integers = saved()
    walk = {
        "reals": "reals + AT_WALK",
        "integers": "integers + AT_WALK_INTEGERS",
        "rows_reals": "reals + AT_ROWS",
        "moves_reals": "reals + AT_MOVES",
        "seen_data": "integers + AT_SEEN_DATA",
        "moves_data": "integers + AT_MOVING_DATA",
        "spreads": "reals + AT_SPREADS",
        "spread": "reals + AT_SPREADS",
        "points": "reals + AT_POINTS",
        "factors": "reals + AT_FACTORS",
        "costs": "reals + AT_COSTS",
        "opens": "integers + AT_OPENS",
        "touched": "integers + AT_TOUCHED",
        "followed": "integers + AT_FOLLOWED",
        "rates": "RATES",
        "chain": "&f->chain",
        "seen": "(struct problem *)SEEN",
        "moving": "(struct problem *)MOVING",
        "rows": "&f->rows",
        "moves": "&f->moves",
        "skip": number(plan.skip),
        "tolerance": number(plan.tolerance),
    }
    yield from (
        "/* Lets the frame refer to the filter. The descriptions of equations are only read. */",
        f"static void open_frame(struct frame *f, {name}_filter *memory)",
        "{",
        "    double *const reals = memory->reals;",
        "    long *const integers = memory->integers;",
        "",
        "    f->memory = memory;",
        "    f->data = &f->given;",
        "    f->chain = CHAIN;",
        *(f"    f->walk.{field} = {value};" for field, value in walk.items()),
    )
    for record, word in (("rows", "SEEN"), ("moves", "MOVING")):
        yield from (
            f"    f->{record}.constants = {word}_CONSTANTS;",
            f"    f->{record}.data = (struct data_set *)(integers + AT_{word}_DATA);",
        )
        for field, part in (
            ("parameters", "reals + AT_{}_PARAMETERS"),
            ("whitening", "reals + AT_{}_WEIGHTS"),
            ("index", "integers + AT_{}_INDEX"),
            ("columns", "integers + AT_{}_COLUMNS"),
        ):
            yield f"    f->{record}.{field} = {part.format(word)};"
        yield f"    f->{record}.fused = 0;"
    yield from (
        *(f"    f->walk.{field} = reals[AT_SAVED + {k}];" for k, field in enumerate(reals)),
        *(f"    f->walk.{field} = integers[AT_SAVED_INTEGERS + {k}];" for k, field in enumerate(integers)),
        "    share_out_walk(&f->walk);",
        *((_SWAP,) if plan.smooth else ()),
        "}",
        "",
    )


def _close() -> Iterator[str]:
    reals, integers = saved()
    yield from (
        "/* Keeps what lasts. */",
        "static void close_frame(struct frame *f)",
        "{",
        "    f->memory->integers[AT_SWAPPED] = f->walk.path > f->walk.path_tried;",
        *(f"    f->memory->reals[AT_SAVED + {k}] = f->walk.{field};" for k, field in enumerate(reals)),
        *(f"    f->memory->integers[AT_SAVED_INTEGERS + {k}] = f->walk.{field};" for k, field in enumerate(integers)),
        "}",
        "",
    )
