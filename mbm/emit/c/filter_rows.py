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
    parts += ["\n".join(_begin_all(made)), "\n".join(_take_rows(made, cells))]
    parts += ["\n".join(_take_step(made, cells, block_of)), "\n".join(_take_transition(made, cells, block_of))]
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
    yield ""
    yield "/* Rows that are known before, into the place of a step. */"
    yield "static void put_fixed(struct frame *f, struct data_set *set, long moment)"
    yield "{"
    yield "    struct data_block *own = blocks_of_data_set(set);"
    yield ""
    for moment in (Moment.FIRST, Moment.BEGINNING):
        mine = [(k, g.fixed) for k, g in enumerate(made.plan.seen.groups) if g.moment is moment and g.fixed is not None]
        if mine:
            yield f"    if (moment == {int(moment is Moment.BEGINNING)}) {{"
            for k, fixed in mine:
                yield from (f"        {line}" for line in _copies(k, fixed))
            yield "    }"
    yield "}"
    yield ""


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
    yield f"    f->parameters = f->memory->reals + AT_{word}_PARAMETERS;"
    yield f"    f->weights = f->{record}.whitening;"
    yield f"    f->index = f->memory->integers + AT_{word}_INDEX;"
    yield f"    f->columns = f->memory->integers + AT_{word}_COLUMNS;"


def _begin_all(made: FilterBlueprint) -> Iterator[str]:
    yield "/* What no row changes. 0; -1: some stated noise is none. */"
    yield "static int begin_all(struct frame *f)"
    yield "{"
    yield "    const struct data_block *own;"
    yield "    int status = 0;"
    yield ""
    for (cases, groups, _), word, record in zip(_systems(made), ("SEEN", "MOVING"), ("rows", "moves"), strict=True):
        yield from _arrays(word, record)
        yield f"    own = blocks_of_data_set(f->{record}.data);"
        yield "    (void)own;"
        for k, (case, group) in enumerate(zip(cases, groups, strict=True)):
            if group.fixed is None:
                for used in ("weights", "index", "columns"):
                    yield f"    f->{used}_used = own[{k}].{used};"
                yield f"    if ({case.identifier}_begin(f) != 0)"
                yield "        status = -1;"
    yield "    return status;"
    yield "}"
    yield ""


def _take_rows(made: FilterBlueprint, cells: Cells) -> Iterator[str]:
    blueprint, plan = made.blueprint, made.plan
    name = blueprint.identifier
    yield "/* The tables of the step that is given. */"
    yield f"static int take_rows(struct frame *f, const {name}_rows *rows, long k)"
    yield "{"
    yield "    long i;"
    yield ""
    yield "    give(f);"
    most = max((capacity(made, t) for t in blueprint.tables), default=1)
    yield f"    for (i = 0; i < {most}; i++)"
    yield "        f->keys[i] = rows->at;"
    yield f"    f->previous = f->memory->reals[AT_KEYS + {_round(made, '(k - 1)')}];"
    yield "    f->dt = rows->at - f->previous;"
    yield "    if (!isfinite(rows->at) || (k > 0 && !(f->dt > 0.0)))"
    yield f"        return {cells.status('OUT_OF_ORDER')};"
    for table in blueprint.tables:
        own = table.identifier
        if table.name == plan.steps:
            yield f"    f->given.{own}_rows = 1;"
            for column in table.columns:
                yield f"    f->given.{own}_{column.identifier} = f->keys;"
        elif table.name == plan.reached:
            yield f"    f->given.{own}_rows = k > 0 ? 1 : 0;"
            for column in table.columns:
                source = {plan.key: "f->keys", Foreign(PREVIOUS): "&f->previous", Foreign(INTERVAL): "&f->dt"}
                yield f"    f->given.{own}_{column.identifier} = {source[column.name]};"
        elif table.name in made.given:
            yield f"    if (rows->{own}_rows < 0 || rows->{own}_rows > {capacity(made, table)})"
            yield f"        return {cells.status('TOO_MANY_ROWS')};"
            yield f"    f->given.{own}_rows = rows->{own}_rows;"
            for column in table.columns:
                held = f"{own}_{column.identifier}"
                yield f"    f->given.{held} = rows->{held};"
                if column.is_text:
                    continue
                if column.name == plan.key:
                    yield f"    if (rows->{held} == NULL)"
                    yield f"        f->given.{held} = f->keys;"
                yield f"    for (i = 0; i < rows->{own}_rows; i++)"
                if column.name == plan.key:
                    yield f"        if (f->given.{held}[i] != rows->at)"
                    yield f"            return {cells.status('OTHER_STEP')};"
                else:
                    yield f"        if (!isfinite(rows->{held}[i]))"
                    yield f"            return {cells.status('NOT_A_NUMBER')};"
    yield "    return 0;"
    yield "}"
    yield ""


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
            yield f"    if ({only[moment]})"
            yield "        count = 0;"
        for each in block.cases:
            yield from _taken(cells, each, "BAD_NOISE")
        yield "    if (all != count)"
        yield f"        return {cells.status('UNKNOWN_CASE')};"
        if block.role is BlockRole.OBSERVATION:
            yield "    observed += all;"


def _taken(cells: Cells, case: BlockCase, wrong: str) -> Iterator[str]:
    yield f"    rows = {case.identifier}_take(f, set, count);"
    yield "    if (rows < 0)"
    yield f"        return {cells.status(wrong)};"
    yield "    all += rows;"


def _remember(made: FilterBlueprint) -> Iterator[str]:
    plan = made.plan
    stride = len(plan.seen.data) // plan.chain["held"]
    yield "/* Which of the clauses that hold once have had their row, after step k. */"
    yield "static void remember(struct frame *f, long k)"
    yield "{"
    yield "    struct data_set *set = (struct data_set *)(f->memory->integers + AT_SEEN_DATA"
    yield f"        + {_round(made, 'k')} * {stride});"
    yield ""
    for k in once(made):
        yield f"    if (blocks_of_data_set(set)[{k}].rows > 0)"
        yield f"        f->memory->integers[AT_TOLD + {k}] = 1;"
    yield "}"
    yield ""


def _take_step(made: FilterBlueprint, cells: Cells, block_of: dict[int, BlockShape]) -> Iterator[str]:
    plan = made.plan
    stride = len(plan.seen.data) // plan.chain["held"]
    yield "/* The rows of all clauses at step k. */"
    yield "static int take_step(struct frame *f, long k)"
    yield "{"
    yield "    struct data_set *set = (struct data_set *)(f->memory->integers + AT_SEEN_DATA"
    yield f"        + {_round(made, 'k')} * {stride});"
    yield "    const struct problem *seen = f->walk.seen;"
    yield "    struct data_block *own = blocks_of_data_set(set);"
    yield "    long b, count, rows, all, observed = 0;"
    yield "    int status = 0;"
    yield ""
    yield "    (void)count;"
    yield "    (void)rows;"
    yield "    (void)all;"
    yield from _arrays("SEEN", "rows")
    for k, group in enumerate(plan.seen.groups):
        if group.fixed is not None:
            yield f"    own[{k}].rows = 0;"
    yield from _taken_when(made, cells, block_of, {Moment.ALWAYS, Moment.ONCE, Moment.FIRST})
    for k in once(made):
        yield f"    if (own[{k}].rows > 0)"
        yield f"        own[{k}].rows = f->memory->integers[AT_TOLD + {k}] == 0 ? 1 : 0;"
    fixed = [(g, block_of[id(c)].role) for g, c in zip(plan.seen.groups, made.seen, strict=True) if g.fixed is not None]
    moments = {group.moment for group, _ in fixed}
    if Moment.FIRST in moments:
        yield "    if (k == 0)"
        yield "        put_fixed(f, set, 0);"
    rows = sum(g.fixed.count for g, role in fixed if g.fixed is not None and role is BlockRole.OBSERVATION)
    if rows:
        yield f"    observed += k == 0 ? {rows} : 0;"
    yield "    f->chain.begin = -1;"
    yield "    if (observed > 0 && f->memory->integers[AT_OBSERVED] == 0) {"
    yield "        f->chain.begin = k;"
    if Moment.BEGINNING in moments:
        yield "        put_fixed(f, set, 1);"
    yield "    }"
    yield from _taken_when(made, cells, block_of, {Moment.BEGINNING})
    yield "    set->count = 0;"
    yield "    for (b = 0; b < seen->residual_blocks; b++)"
    yield "        set->count += own[b].rows * blocks_of_problem(f->walk.seen)[b].outputs;"
    yield "    f->count = set->count;"
    yield "    return status;"
    yield "}"
    yield ""


def _take_transition(made: FilterBlueprint, cells: Cells, block_of: dict[int, BlockShape]) -> Iterator[str]:
    plan = made.plan
    held, noises = plan.chain["held"], plan.chain["noises"]
    moving = plan.chain["n"] - plan.chain["still"]
    stride = len(plan.moving.data) // held
    yield "/* The transition to step k. */"
    yield "static int take_transition(struct frame *f, long k)"
    yield "{"
    yield f"    const long place = {_round(made, '(k - 1)')};"
    yield f"    struct data_set *set = (struct data_set *)(f->memory->integers + AT_MOVING_DATA + place * {stride});"
    yield "    long i, count, rows, all;"
    yield "    int status = 0;"
    yield ""
    yield "    (void)set;"
    yield "    (void)count;"
    yield "    (void)rows;"
    yield "    (void)all;"
    for name in plan.joined:
        table = made.blueprint.table(name)
        kept = cells.rows(table.name) if table.where is None else f"f->kept_of_{table.identifier}_count"
        yield f"    if ({kept.replace('data->', 'f->given.')} != 1)"
        yield f"        return {cells.status('NO_TRANSITION')};"
    yield from _arrays("MOVING", "moves")
    yield f"    f->spread = f->memory->reals + AT_SPREADS + place * {moving * noises};"
    yield "    f->moves_count = 0;"
    yield f"    for (i = 0; i < {moving * noises}; i++)"
    yield "        f->spread[i] = 0.0;"
    done: set[str] = set()
    for case in made.moving:
        block = block_of[id(case)]
        if block.identifier in done:
            continue
        done.add(block.identifier)
        yield from count_of_rows(block)
        for each in block.cases:
            yield from _taken(cells, each, "BAD_NOISE")
    yield f"    if (f->moves_count != {moving})"
    yield f"        return {cells.status('UNKNOWN_CASE')};"
    yield f"    set->count = {moving};"
    yield "    return status;"
    yield "}"
    yield ""
