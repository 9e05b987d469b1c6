"""C functions of a generated filter: the rows of a step, and of the transition to it, as the solver's arrays."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.cells import Cells
from mbm.emit.c.clauses import chosen_rows, count_of_rows
from mbm.emit.c.filter_clauses import ARRAYS, begin_function, take_function
from mbm.emit.c.filter_memory import capacity
from mbm.emit.filtering.types import FilterBlueprint, FilterGroup, FixedRows, Moment
from mbm.emit.foreign import Foreign
from mbm.emit.types import BlockCase, BlockShape
from mbm.machine.c import number
from mbm.problem.sequence.types import INTERVAL, PREVIOUS
from mbm.problem.types import BlockRole


def row_functions(made: FilterBlueprint) -> str:
    """``take_rows``, ``take_step``, ``take_transition``, and ``begin_all``, which puts what no row changes."""
    blueprint = made.blueprint
    cells = Cells(blueprint)
    block_of = {id(case): block for block in blueprint.blocks for case in block.cases}
    parts = [
        "\n".join(chosen_rows(blueprint, cells, block))
        for block in blueprint.blocks
        if any(_moment(made, case) is not None for case in block.cases)
    ]
    for cases, groups, moves in _systems(made):
        for k, (case, group) in enumerate(zip(cases, groups, strict=True)):
            if group.fixed is None:
                parts.append("\n".join(begin_function(made, cells, case, group, moves)))
                parts.append("\n".join(take_function(made, cells, block_of[id(case)], case, k, group, moves)))
    if any(group.fixed is not None for group in made.plan.seen.groups):
        parts.append("\n".join(_fixed(made)))
    parts += [
        "\n".join(_begin_all(made)),
        "\n".join(_take_rows(made, cells)),
        "\n".join(_take_step(made, cells, block_of)),
        "\n".join(_take_transition(made, cells, block_of)),
    ]
    if once(made):
        parts.append("\n".join(_remember(made)))
    return "\n".join(parts)


def once(made: FilterBlueprint) -> tuple[int, ...]:
    """The groups that have one row in all, by number."""
    return tuple(k for k, group in enumerate(made.plan.seen.groups) if group.moment is Moment.ONCE)


def _systems(
    made: FilterBlueprint,
) -> tuple[tuple[tuple[BlockCase, ...], tuple[FilterGroup, ...], bool], ...]:
    return (made.seen, made.plan.seen.groups, False), (made.moving, made.plan.moving.groups, True)


def _moment(made: FilterBlueprint, case: BlockCase) -> Moment | None:
    """When rows are taken from tables; None: they are the filter's own."""
    groups = (*made.plan.seen.groups, *made.plan.moving.groups)
    found = next(g for c, g in zip((*made.seen, *made.moving), groups, strict=True) if c is case)
    return found.moment if found.fixed is None else None


def _fixed(made: FilterBlueprint) -> Iterator[str]:
    """Rows that the filter itself has, at the one step that they belong to."""
    for k, group in enumerate(made.plan.seen.groups):
        if group.fixed is not None:
            for name, kind in (("parameters", "double"), ("weights", "double"), ("index", "long"), ("columns", "long")):
                values = getattr(group.fixed, name)
                shown = ", ".join(map(_number, values))
                if values:
                    yield f"static const {kind} FIXED_{k}_{name.upper()}[] = {{{shown}}};"
    yield from (
        "",
        "/* Rows that are known before, into the place of a step. */",
        "static void put_fixed(struct frame *f, struct data_set *set, long moment)",
        "{",
        "    struct data_block *own = blocks_of_data_set(set);",
        "",
    )
    for moment in (Moment.FIRST, Moment.BEGINNING):
        mine = [(k, g.fixed) for k, g in enumerate(made.plan.seen.groups) if g.moment is moment and g.fixed is not None]
        if mine:
            yield f"    if (moment == {int(moment is Moment.BEGINNING)}) {{"
            for k, fixed in mine:
                yield from (f"        {line}" for line in _copies(k, fixed))
            yield "    }"
    yield from ("}", "")


def _copies(k: int, fixed: FixedRows) -> Iterator[str]:
    for name, array in zip(ARRAYS, ("parameters", "whitening", "index", "columns"), strict=True):
        count = len(getattr(fixed, name))
        if count:
            kind = "double" if name in ("parameters", "weights") else "long"
            target = f"({kind} *)f->rows.{array} + own[{k}].{name}"
            yield f"memcpy({target}, FIXED_{k}_{name.upper()}, sizeof FIXED_{k}_{name.upper()});"
    yield f"own[{k}].rows = {fixed.count};"


def _number(value: float) -> str:
    return number(value) if isinstance(value, float) else str(value)


def _arrays(word: str, record: str) -> Iterator[str]:
    """Let the arrays of the frame be those of a step, or of a transition."""
    yield from (
        f"    f->parameters = f->memory->reals + AT_{word}_PARAMETERS;",
        f"    f->weights = f->{record}.whitening;",
        f"    f->index = f->memory->integers + AT_{word}_INDEX;",
        f"    f->columns = f->memory->integers + AT_{word}_COLUMNS;",
    )


def _begin_all(made: FilterBlueprint) -> Iterator[str]:
    yield from (
        "/* What no row changes. 0; -1: some stated noise is none. */",
        "static int begin_all(struct frame *f)",
        "{",
        "    const struct data_block *own;",
        "    int status = 0;",
        "",
    )
    for (cases, groups, _), word, record in zip(_systems(made), ("SEEN", "MOVING"), ("rows", "moves"), strict=True):
        yield from (
            *_arrays(word, record),
            f"    own = blocks_of_data_set(f->{record}.data);",
            "    (void)own;",
        )
        for k, (case, group) in enumerate(zip(cases, groups, strict=True)):
            if group.fixed is None:
                yield from (
                    *(f"    f->{used}_used = own[{k}].{used};" for used in ("weights", "index", "columns")),
                    f"    if ({case.identifier}_begin(f) != 0)",
                    "        status = -1;",
                )
    yield from ("    return status;", "}", "")


def _take_rows(made: FilterBlueprint, cells: Cells) -> Iterator[str]:
    blueprint, plan = made.blueprint, made.plan
    name = blueprint.identifier
    yield from (
        "/* The tables of the step that is given. */",
        f"static int take_rows(struct frame *f, const {name}_rows *rows, long k)",
        "{",
        "    long i;",
        "",
        "    give(f);",
    )
    most = max((capacity(made, t) for t in blueprint.tables), default=1)
    yield from (
        f"    for (i = 0; i < {most}; i++)",
        "        f->keys[i] = rows->at;",
        f"    f->previous = f->memory->reals[AT_KEYS + {_round(made, '(k - 1)')}];",
        "    f->dt = rows->at - f->previous;",
        "    if (!isfinite(rows->at) || (k > 0 && !(f->dt > 0.0)))",
        f"        return {cells.status('OUT_OF_ORDER')};",
    )
    for table in blueprint.tables:
        own = table.identifier
        if table.name == plan.steps:
            yield from (
                f"    f->given.{own}_rows = 1;",
                *(f"    f->given.{own}_{column.identifier} = f->keys;" for column in table.columns),
            )
        elif table.name == plan.reached:
            yield f"    f->given.{own}_rows = k > 0 ? 1 : 0;"
            for column in table.columns:
                source = {plan.key: "f->keys", Foreign(PREVIOUS): "&f->previous", Foreign(INTERVAL): "&f->dt"}
                yield f"    f->given.{own}_{column.identifier} = {source[column.name]};"
        elif table.name in made.given:
            yield from (
                f"    if (rows->{own}_rows < 0 || rows->{own}_rows > {capacity(made, table)})",
                f"        return {cells.status('TOO_MANY_ROWS')};",
                f"    f->given.{own}_rows = rows->{own}_rows;",
            )
            for column in table.columns:
                held = f"{own}_{column.identifier}"
                yield f"    f->given.{held} = rows->{held};"
                if column.is_text:
                    continue
                if column.name == plan.key:
                    yield from (f"    if (rows->{held} == NULL)", f"        f->given.{held} = f->keys;")
                yield f"    for (i = 0; i < rows->{own}_rows; i++)"
                if column.name == plan.key:
                    yield from (
                        f"        if (f->given.{held}[i] != rows->at)",
                        f"            return {cells.status('OTHER_STEP')};",
                    )
                else:
                    yield from (
                        f"        if (!isfinite(rows->{held}[i]))",
                        f"            return {cells.status('NOT_A_NUMBER')};",
                    )
    yield from ("    return 0;", "}", "")


def _round(made: FilterBlueprint, k: str) -> str:
    """The place of a step."""
    held = made.plan.chain["held"]
    return f"({k} + {held}) % {held}"


def _taken_when(
    made: FilterBlueprint, cells: Cells, block_of: dict[int, BlockShape], moments: set[Moment]
) -> Iterator[str]:
    """Statements that take the rows of the clauses that have theirs at some moments."""
    only = {Moment.FIRST: "k > 0", Moment.BEGINNING: "f->chain.begin != k"}
    done: set[str] = set()
    for case in made.seen:
        block, moment = block_of[id(case)], _moment(made, case)
        if block.identifier in done or moment not in moments:
            continue
        done.add(block.identifier)
        yield from count_of_rows(block)
        if moment in only:
            yield from (f"    if ({only[moment]})", "        count = 0;")
        for each in block.cases:
            yield from _taken(cells, each, "BAD_NOISE")
        yield from ("    if (all != count)", f"        return {cells.status('UNKNOWN_CASE')};")
        if block.role is BlockRole.OBSERVATION:
            yield "    observed += all;"


def _taken(cells: Cells, case: BlockCase, wrong: str) -> Iterator[str]:
    yield from (
        f"    rows = {case.identifier}_take(f, set, count);",
        "    if (rows < 0)",
        f"        return {cells.status(wrong)};",
        "    all += rows;",
    )


def _remember(made: FilterBlueprint) -> Iterator[str]:
    plan = made.plan
    stride = len(plan.seen.data) // plan.chain["held"]
    yield from (
        "/* Which of the clauses that hold once have had their row, after step k. */",
        "static void remember(struct frame *f, long k)",
        "{",
        "    struct data_set *set = (struct data_set *)(f->memory->integers + AT_SEEN_DATA",
        f"        + {_round(made, 'k')} * {stride});",
        "",
    )
    for k in once(made):
        yield from (
            f"    if (blocks_of_data_set(set)[{k}].rows > 0)",
            f"        f->memory->integers[AT_TOLD + {k}] = 1;",
        )
    yield from ("}", "")


def _take_step(made: FilterBlueprint, cells: Cells, block_of: dict[int, BlockShape]) -> Iterator[str]:
    plan = made.plan
    stride = len(plan.seen.data) // plan.chain["held"]
    yield from (
        "/* The rows of all clauses at step k. */",
        "static int take_step(struct frame *f, long k)",
        "{",
        "    struct data_set *set = (struct data_set *)(f->memory->integers + AT_SEEN_DATA",
        f"        + {_round(made, 'k')} * {stride});",
        "    const struct problem *seen = f->walk.seen;",
        "    struct data_block *own = blocks_of_data_set(set);",
        "    long b, count, rows, all, observed = 0;",
        "    int status = 0;",
        "",
        "    (void)count;",
        "    (void)rows;",
        "    (void)all;",
        *_arrays("SEEN", "rows"),
    )
    yield from (f"    own[{k}].rows = 0;" for k, group in enumerate(plan.seen.groups) if group.fixed is not None)
    yield from _taken_when(made, cells, block_of, {Moment.ALWAYS, Moment.ONCE, Moment.FIRST})
    for k in once(made):
        yield from (
            f"    if (own[{k}].rows > 0)",
            f"        own[{k}].rows = f->memory->integers[AT_TOLD + {k}] == 0 ? 1 : 0;",
        )
    fixed = [(g, block_of[id(c)].role) for g, c in zip(plan.seen.groups, made.seen, strict=True) if g.fixed is not None]
    moments = {group.moment for group, _ in fixed}
    if Moment.FIRST in moments:
        yield from ("    if (k == 0)", "        put_fixed(f, set, 0);")
    rows = sum(g.fixed.count for g, role in fixed if g.fixed is not None and role is BlockRole.OBSERVATION)
    if rows:
        yield f"    observed += k == 0 ? {rows} : 0;"
    yield from (
        "    f->chain.begin = -1;",
        "    if (observed > 0 && f->memory->integers[AT_OBSERVED] == 0) {",
        "        f->chain.begin = k;",
    )
    if Moment.BEGINNING in moments:
        yield "        put_fixed(f, set, 1);"
    yield from (
        "    }",
        *_taken_when(made, cells, block_of, {Moment.BEGINNING}),
        "    set->count = 0;",
        "    for (b = 0; b < seen->residual_blocks; b++)",
        "        set->count += own[b].rows * blocks_of_problem(f->walk.seen)[b].outputs;",
        "    f->count = set->count;",
        "    return status;",
        "}",
        "",
    )


def _take_transition(made: FilterBlueprint, cells: Cells, block_of: dict[int, BlockShape]) -> Iterator[str]:
    plan = made.plan
    held, noises = plan.chain["held"], plan.chain["noises"]
    moving = plan.chain["n"] - plan.chain["still"]
    stride = len(plan.moving.data) // held
    yield from (
        "/* The transition to step k. */",
        "static int take_transition(struct frame *f, long k)",
        "{",
        f"    const long place = {_round(made, '(k - 1)')};",
        f"    struct data_set *set = (struct data_set *)(f->memory->integers + AT_MOVING_DATA + place * {stride});",
        "    long i, count, rows, all;",
        "    int status = 0;",
        "",
        "    (void)set;",
        "    (void)count;",
        "    (void)rows;",
        "    (void)all;",
    )
    for name in plan.joined:
        table = made.blueprint.table(name)
        kept = cells.rows(table.name) if table.where is None else f"f->kept_of_{table.identifier}_count"
        yield from (
            f"    if ({kept.replace('data->', 'f->given.')} != 1)",
            f"        return {cells.status('NO_TRANSITION')};",
        )
    yield from (
        *_arrays("MOVING", "moves"),
        f"    f->spread = f->memory->reals + AT_SPREADS + place * {moving * noises};",
        "    f->moves_count = 0;",
        f"    for (i = 0; i < {moving * noises}; i++)",
        "        f->spread[i] = 0.0;",
    )
    done: set[str] = set()
    for case in made.moving:
        block = block_of[id(case)]
        if block.identifier in done:
            continue
        done.add(block.identifier)
        yield from count_of_rows(block)
        for each in block.cases:
            yield from _taken(cells, each, "BAD_NOISE")
    yield from (
        f"    if (f->moves_count != {moving})",
        f"        return {cells.status('UNKNOWN_CASE')};",
        f"    set->count = {moving};",
        "    return status;",
        "}",
        "",
    )
