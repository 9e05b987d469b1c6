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
    yield from (
        "/* The tables that are the same at all steps. */",
        "static void give(struct frame *f)",
        "{",
        "    f->given = GIVEN;",
    )
    for name in made.beside:
        table = made.blueprint.table(name)
        yield from (
            f"    f->given.{table.identifier}_{field} = f->memory->given.{table.identifier}_{field};"
            for field in ("rows", *(column.identifier for column in table.columns))
        )
    yield from ("}", "")


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
    yield from (
        "/* What is answered for the step whose arrays stand at `place`. */",
        f"static void answer_at(const struct frame *f, long place, {name}_result *result)",
        "{",
        "    double *const reals = f->memory->reals;",
        f"    const double *point = f->walk.points + place * {numbers};",
        "    long c;",
        "",
        f"    put_covariance({n}, f->walk.factors + place * {n * n}, f->walk.touched + place * {n},",
        "        reals + AT_COVARIANCE, reals + AT_DEVIATIONS);",
        f"    for (c = 0; c < {len(plan.column)}; c++)",
        "        reals[AT_SIGMAS + c] = COLUMN[c] < 0 ? 0.0 : reals[AT_DEVIATIONS + COLUMN[c]];",
        f"    for (c = 0; c < {numbers}; c++)",
        "        reals[AT_REPORTED + c] = point[c];",
        *(f"    reals[AT_REPORTED + {place}] = turned_to(point[{place}], 0.0);" for place in plan.angles),
        "    result->at = reals[AT_KEYS + place];",
        f"    result->innovation = {'NAN' if plan.smooth else 'f->walk.costs[place]'};",
        "    result->residuals = f->count;",
        "    result->hypotheses = f->walk.followed[place];",
        "    result->point = reals + AT_REPORTED;",
        "    result->covariance = reals + AT_COVARIANCE;",
        "    result->sigmas = reals + AT_SIGMAS;",
    )
    for unknown in blueprint.unknowns:
        part = plan.parts[unknown.name]
        yield from (
            f"    result->{unknown.identifier} = reals + AT_REPORTED + {part.number};",
            f"    result->{unknown.identifier}_sigma = reals + AT_SIGMAS + {part.coordinate};",
        )
    signed = (plan.parts[u.name].number + quaternion for u in blueprint.unknowns for quaternion in u.quaternions)
    yield from (
        *derived_answers(made),
        *(f"    sign_quaternion(reals + AT_REPORTED + {at});" for at in signed),
        "}",
        "",
    )


def _begin(made: FilterBlueprint, cells: Cells) -> Iterator[str]:
    plan, name = made.plan, made.blueprint.identifier
    n = plan.chain["n"]
    given = f", const {name}_given *given" if made.beside else ""
    yield from (
        f"void {name}_begin({name}_filter *filter{given})",
        "{",
        "    struct frame frame, *f = &frame;",
        "    long c;",
        "",
        "    memset(filter, 0, sizeof *filter);",
        "    memcpy(filter->integers + AT_SEEN_DATA, SEEN_DATA, sizeof SEEN_DATA);",
        "    memcpy(filter->integers + AT_MOVING_DATA, MOVING_DATA, sizeof MOVING_DATA);",
        "    filter->integers[AT_LEFT] = -1;",
        f"    for (c = 0; c < {plan.chain['held']}; c++)",
        "        filter->integers[AT_FOLLOWED + c] = 1;",
        "    open_frame(f, filter);",
        "    begin_walk(&f->walk);",
        f"    for (c = 0; c < {plan.chain['numbers']}; c++)",
        "        f->walk.point[c] = POINT[c];",
        f"    for (c = 0; c < {n * n}; c++)",
        "        f->walk.factor[c] = FACTOR[c];",
        f"    for (c = 0; c < {plan.open.size}; c++)" if plan.open.size else "    (void)OPEN;",
        *(("        f->walk.open[c] = OPEN[c];",) if plan.open.size else ()),
        f"    f->walk.open_count = {len(plan.open)};",
        *(("    filter->given = *given;",) if made.beside else ()),
        "    give(f);",
    )
    for table in map(made.blueprint.table, made.beside):
        rows = f"given->{table.identifier}_rows"
        yield from (
            f"    if ({rows} < 0 || {rows} > {capacity(made, table)}) {{",
            f"        filter->integers[AT_STOPPED] = {cells.status('TOO_MANY_ROWS')};",
            "        return;",
            "    }",
        )
    yield from (
        "    filter->integers[AT_STOPPED] = find_rows(f);",
        "    if (filter->integers[AT_STOPPED] == 0 && begin_all(f) != 0)",
        f"        filter->integers[AT_STOPPED] = {cells.status('BAD_NOISE')};",
        "    close_frame(f);",
        "}",
        "",
    )


def _step(made: FilterBlueprint, cells: Cells) -> Iterator[str]:
    plan, name = made.plan, made.blueprint.identifier
    held, lag = plan.chain["held"], plan.chain["lag"]
    routine = "lag_steps" if plan.smooth else "filter_steps"
    yield from (
        f"int {name}_step({name}_filter *filter, const {name}_rows *rows, {name}_result *result)",
        "{",
        "    struct frame frame, *f = &frame;",
        "    long k = filter->integers[AT_STEP];",
        "",
        "    result->status = (int)filter->integers[AT_STOPPED];",
        "    if (result->status != 0)",
        "        return result->status;",
        "    open_frame(f, filter);",
        "    result->status = take_rows(f, rows, k);",
        "    if (result->status == 0)",
        "        result->status = find_rows(f);",
        "    if (result->status == 0)",
        "        result->status = take_step(f, k);",
        "    if (result->status == 0 && k > 0)",
        "        result->status = take_transition(f, k);",
    )
    if made.blueprint.derived:
        yield from ("    if (result->status == 0)", f"        result->status = keep_derived(f, k % {held});")
    yield from (
        "    if (result->status != 0)",
        "        return result->status;",
        "    if (f->chain.begin == k)",
        "        filter->integers[AT_OBSERVED] = 1;",
    )
    if once(made):
        yield "    remember(f, k);"
    yield from (
        f"    filter->reals[AT_KEYS + k % {held}] = rows->at;",
        f"    if ({routine}(&f->walk, k, k + 1) != 1) {{",
        f"        filter->integers[AT_STOPPED] = {cells.status('STOPPED')};",
        f"        result->status = {cells.status('STOPPED')};",
        "        return result->status;",
        "    }",
    )
    if plan.smooth:
        yield from (
            f"    result->status = k < {lag} ? {cells.status('WAITING')} : {cells.status('ESTIMATED')};",
            f"    if (k >= {lag})",
            f"        answer_at(f, (k - {lag}) % {held}, result);",
            "    k++;",
            f"    if (f->walk.base >= {held}) {{    /* steps are counted round */",
            f"        f->walk.base -= {held};",
            f"        k -= {held};",
            "    }",
            "    filter->integers[AT_STEP] = k;",
        )
    else:
        yield from (
            f"    result->status = {cells.status('ESTIMATED')};",
            "    answer_at(f, 0, result);",
            "    filter->integers[AT_STEP] = 1;    /* steps are counted round: only the first one is another */",
        )
    yield from ("    close_frame(f);", "    return result->status;", "}", "")


def _finish(made: FilterBlueprint, cells: Cells) -> Iterator[str]:
    plan, name = made.plan, made.blueprint.identifier
    held, lag = plan.chain["held"], plan.chain["lag"]
    yield from (
        f"int {name}_finish({name}_filter *filter, {name}_result *result)",
        "{",
        "    struct frame frame, *f = &frame;",
        "    const long k = filter->integers[AT_STEP];",
        "",
        f"    result->status = {cells.status('STOPPED')};",
        "    open_frame(f, filter);",
        "    if (filter->integers[AT_LEFT] < 0) {",
        "        if (filter->integers[AT_STOPPED] != 0)",
        "            return result->status;",
        f"        filter->integers[AT_STOPPED] = {cells.status('STOPPED')};",
        f"        filter->integers[AT_LEFT] = k > {lag} ? k - {lag} : 0;",
        "        if (k > 0)",
        "            lag_end(&f->walk, k - 1);",
        "        close_frame(f);",
        "    }",
        f"    result->status = {cells.status('NO_STEP')};",
        "    if (filter->integers[AT_LEFT] >= k)",
        "        return result->status;",
        "    f->count = 0;",
        f"    answer_at(f, filter->integers[AT_LEFT]++ % {held}, result);",
        f"    result->status = {cells.status('ESTIMATED')};",
        "    return result->status;",
        "}",
        "",
    )
