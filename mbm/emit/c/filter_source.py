"""The text of ``<problem>.c`` of a generated filter: what it is made of, and the functions that its caller calls."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.cells import Cells
from mbm.emit.c.filter_derived import derived_answers, derived_functions
from mbm.emit.c.filter_header import STATUSES
from mbm.emit.c.filter_memory import capacity, data_text, memory_text
from mbm.emit.c.filter_rows import once, row_functions
from mbm.emit.c.tables import table_functions
from mbm.emit.c.text import doubles, literal, longs, opening, status_text
from mbm.emit.filtering.types import FilterBlueprint
from mbm.emit.foreign import told


def filter_source(made: FilterBlueprint) -> str:
    """``<problem>.c``."""
    blueprint, plan = made.blueprint, made.plan
    name = blueprint.identifier
    chain = ", ".join(f".{field} = {value}" for field, value in plan.chain.items())
    rows = row_functions(made)
    parts = [
        *opening(name, told(blueprint.name, ": from the rows of a step to the arrays of the filter, and back.")),
        longs("SEEN", plan.seen.problem, "The equations of a step, as the filter wants them."),
        doubles("SEEN_CONSTANTS", plan.seen.constants, "Bounds, and parameters of losses."),
        longs("SEEN_DATA", plan.seen.data, "Where the rows of each clause stand."),
        longs("MOVING", plan.moving.problem, "The equations of a transition."),
        doubles("MOVING_CONSTANTS", plan.moving.constants, "Their constants."),
        longs("MOVING_DATA", plan.moving.data, "Where their rows stand."),
        f"static const struct chain CHAIN = {{\n    {chain}\n}};\n",
        longs("RATES", plan.rates, "Of each coordinate that of its rate."),
        doubles("POINT", plan.point.tolist(), "Where the first step begins,"),
        doubles("FACTOR", plan.factor.ravel().tolist(), "a factor U of its covariance U'U,"),
        doubles("OPEN", plan.open.ravel().tolist(), "and the directions that have no prior."),
        longs("COLUMN", plan.column, "Of each coordinate of a step its place among those that are estimated."),
        *([longs("PAIR_COLUMN", plan.pair_column, "The same of a transition.")] if "PAIR_COLUMN[" in rows else []),
        data_text(made),
        *_given(made),
        memory_text(made),
        *_give(made),
        table_functions(blueprint, frozenset(plan.joined)),
        rows,
        derived_functions(made),
        *_public(made),
        "",
    ]
    return "\n".join(parts)


def _given(made: FilterBlueprint) -> Iterator[str]:
    """The tables that are the same at all steps."""
    blueprint, plan = made.blueprint, made.plan
    rows = {table.name: table for table in blueprint.given}
    fields = []
    for table in blueprint.tables:
        if table.name in (*made.given, *made.beside, plan.steps, plan.reached):
            continue
        columns = rows[table.name].columns
        fields.append(f".{table.identifier}_rows = {len(next(iter(columns.values())))}")
        for column in table.columns:
            held = f"GIVEN_{table.identifier}_{column.identifier}"
            values = columns[column.name]
            if isinstance(values, tuple):
                shown = ", ".join(literal(value) for value in values) or "0"
                yield f"static const char *const {held}[] = {{{shown}}};\n"
            else:
                yield doubles(held, values.tolist(), "A column.")
            fields.append(f".{table.identifier}_{column.identifier} = {held}")
    yield f"static const {blueprint.identifier}_data GIVEN = {{{', '.join(fields) or '0'}}};\n"


def _give(made: FilterBlueprint) -> Iterator[str]:
    """``give``: the tables that are the same at all steps, those of the caller among them."""
    yield "/* The tables that are the same at all steps. */"
    yield "static void give(struct frame *f)"
    yield "{"
    yield "    f->given = GIVEN;"
    for name in made.beside:
        table = made.blueprint.table(name)
        for field in ("rows", *(column.identifier for column in table.columns)):
            yield f"    f->given.{table.identifier}_{field} = f->memory->given.{table.identifier}_{field};"
    yield "}"
    yield ""


def _public(made: FilterBlueprint) -> Iterator[str]:
    cells = Cells(made.blueprint)
    yield from _answer(made)
    yield from _begin(made, cells)
    yield from _step(made, cells)
    if made.plan.smooth:
        yield from _finish(made, cells)
    name = made.blueprint.identifier
    yield from status_text(name, {cells.status(word): sentence for word, sentence in STATUSES.items()})


def _answer(made: FilterBlueprint) -> Iterator[str]:
    blueprint, plan = made.blueprint, made.plan
    name = blueprint.identifier
    n, numbers = plan.chain["n"], plan.chain["numbers"]
    yield "/* What is answered for the step whose arrays stand at `place`. */"
    yield f"static void answer_at(const struct frame *f, long place, {name}_result *result)"
    yield "{"
    yield "    double *const reals = f->memory->reals;"
    yield f"    const double *point = f->walk.points + place * {numbers};"
    yield "    long c;"
    yield ""
    yield f"    put_covariance({n}, f->walk.factors + place * {n * n}, f->walk.touched + place * {n},"
    yield "        reals + AT_COVARIANCE, reals + AT_DEVIATIONS);"
    yield f"    for (c = 0; c < {len(plan.column)}; c++)"
    yield "        reals[AT_SIGMAS + c] = COLUMN[c] < 0 ? 0.0 : reals[AT_DEVIATIONS + COLUMN[c]];"
    yield f"    for (c = 0; c < {numbers}; c++)"
    yield "        reals[AT_REPORTED + c] = point[c];"
    for place in plan.angles:
        yield f"    reals[AT_REPORTED + {place}] = turned_to(point[{place}], 0.0);"
    yield "    result->at = reals[AT_KEYS + place];"
    yield f"    result->innovation = {'NAN' if plan.smooth else 'f->walk.costs[place]'};"
    yield "    result->residuals = f->count;"
    yield "    result->hypotheses = f->walk.followed[place];"
    yield "    result->point = reals + AT_REPORTED;"
    yield "    result->covariance = reals + AT_COVARIANCE;"
    yield "    result->sigmas = reals + AT_SIGMAS;"
    for unknown in blueprint.unknowns:
        part = plan.parts[unknown.name]
        yield f"    result->{unknown.identifier} = reals + AT_REPORTED + {part.number};"
        yield f"    result->{unknown.identifier}_sigma = reals + AT_SIGMAS + {part.coordinate};"
    yield from derived_answers(made)
    yield "}"
    yield ""


def _begin(made: FilterBlueprint, cells: Cells) -> Iterator[str]:
    plan, name = made.plan, made.blueprint.identifier
    n = plan.chain["n"]
    given = f", const {name}_given *given" if made.beside else ""
    yield f"void {name}_begin({name}_filter *filter{given})"
    yield "{"
    yield "    struct frame frame, *f = &frame;"
    yield "    long c;"
    yield ""
    yield "    memset(filter, 0, sizeof *filter);"
    yield "    memcpy(filter->integers + AT_SEEN_DATA, SEEN_DATA, sizeof SEEN_DATA);"
    yield "    memcpy(filter->integers + AT_MOVING_DATA, MOVING_DATA, sizeof MOVING_DATA);"
    yield "    filter->integers[AT_LEFT] = -1;"
    yield f"    for (c = 0; c < {plan.chain['held']}; c++)"
    yield "        filter->integers[AT_FOLLOWED + c] = 1;"
    yield "    open_frame(f, filter);"
    yield "    begin_walk(&f->walk);"
    yield f"    for (c = 0; c < {plan.chain['numbers']}; c++)"
    yield "        f->walk.point[c] = POINT[c];"
    yield f"    for (c = 0; c < {n * n}; c++)"
    yield "        f->walk.factor[c] = FACTOR[c];"
    yield f"    for (c = 0; c < {plan.open.size}; c++)" if plan.open.size else "    (void)OPEN;"
    yield from ("        f->walk.open[c] = OPEN[c];",) if plan.open.size else ()
    yield f"    f->walk.open_count = {len(plan.open)};"
    yield from ("    filter->given = *given;",) if made.beside else ()
    yield "    give(f);"
    for table in map(made.blueprint.table, made.beside):
        rows = f"given->{table.identifier}_rows"
        yield f"    if ({rows} < 0 || {rows} > {capacity(made, table)}) {{"
        yield f"        filter->integers[AT_STOPPED] = {cells.status('TOO_MANY_ROWS')};"
        yield "        return;"
        yield "    }"
    yield "    filter->integers[AT_STOPPED] = find_rows(f);"
    yield "    if (filter->integers[AT_STOPPED] == 0 && begin_all(f) != 0)"
    yield f"        filter->integers[AT_STOPPED] = {cells.status('BAD_NOISE')};"
    yield "    close_frame(f);"
    yield "}"
    yield ""


def _step(made: FilterBlueprint, cells: Cells) -> Iterator[str]:
    plan, name = made.plan, made.blueprint.identifier
    held, lag = plan.chain["held"], plan.chain["lag"]
    routine = "lag_steps" if plan.smooth else "filter_steps"
    yield f"int {name}_step({name}_filter *filter, const {name}_rows *rows, {name}_result *result)"
    yield "{"
    yield "    struct frame frame, *f = &frame;"
    yield "    long k = filter->integers[AT_STEP];"
    yield ""
    yield "    result->status = (int)filter->integers[AT_STOPPED];"
    yield "    if (result->status != 0)"
    yield "        return result->status;"
    yield "    open_frame(f, filter);"
    yield "    result->status = take_rows(f, rows, k);"
    yield "    if (result->status == 0)"
    yield "        result->status = find_rows(f);"
    yield "    if (result->status == 0)"
    yield "        result->status = take_step(f, k);"
    yield "    if (result->status == 0 && k > 0)"
    yield "        result->status = take_transition(f, k);"
    if made.blueprint.derived:
        yield "    if (result->status == 0)"
        yield f"        result->status = keep_derived(f, k % {held});"
    yield "    if (result->status != 0)"
    yield "        return result->status;"
    yield "    if (f->chain.begin == k)"
    yield "        filter->integers[AT_OBSERVED] = 1;"
    if once(made):
        yield "    remember(f, k);"
    yield f"    filter->reals[AT_KEYS + k % {held}] = rows->at;"
    yield f"    if ({routine}(&f->walk, k, k + 1) != 1) {{"
    yield f"        filter->integers[AT_STOPPED] = {cells.status('STOPPED')};"
    yield f"        result->status = {cells.status('STOPPED')};"
    yield "        return result->status;"
    yield "    }"
    if plan.smooth:
        yield f"    result->status = k < {lag} ? {cells.status('WAITING')} : {cells.status('ESTIMATED')};"
        yield f"    if (k >= {lag})"
        yield f"        answer_at(f, (k - {lag}) % {held}, result);"
        yield "    k++;"
        yield f"    if (f->walk.base >= {held}) {{    /* steps are counted round */"
        yield f"        f->walk.base -= {held};"
        yield f"        k -= {held};"
        yield "    }"
        yield "    filter->integers[AT_STEP] = k;"
    else:
        yield f"    result->status = {cells.status('ESTIMATED')};"
        yield "    answer_at(f, 0, result);"
        yield "    filter->integers[AT_STEP] = 1;    /* steps are counted round: only the first one is another */"
    yield "    close_frame(f);"
    yield "    return result->status;"
    yield "}"
    yield ""


def _finish(made: FilterBlueprint, cells: Cells) -> Iterator[str]:
    plan, name = made.plan, made.blueprint.identifier
    held, lag = plan.chain["held"], plan.chain["lag"]
    yield f"int {name}_finish({name}_filter *filter, {name}_result *result)"
    yield "{"
    yield "    struct frame frame, *f = &frame;"
    yield "    const long k = filter->integers[AT_STEP];"
    yield ""
    yield f"    result->status = {cells.status('STOPPED')};"
    yield "    open_frame(f, filter);"
    yield "    if (filter->integers[AT_LEFT] < 0) {"
    yield "        if (filter->integers[AT_STOPPED] != 0)"
    yield "            return result->status;"
    yield f"        filter->integers[AT_STOPPED] = {cells.status('STOPPED')};"
    yield f"        filter->integers[AT_LEFT] = k > {lag} ? k - {lag} : 0;"
    yield "        if (k > 0 && lag_end(&f->walk, k - 1) == 0) {"
    yield "            filter->integers[AT_LEFT] = k;"
    yield "            return result->status;"
    yield "        }"
    yield "        close_frame(f);"
    yield "    }"
    yield f"    result->status = {cells.status('NO_STEP')};"
    yield "    if (filter->integers[AT_LEFT] >= k)"
    yield "        return result->status;"
    yield "    f->count = 0;"
    yield f"    answer_at(f, filter->integers[AT_LEFT]++ % {held}, result);"
    yield f"    result->status = {cells.status('ESTIMATED')};"
    yield "    return result->status;"
    yield "}"
    yield ""
