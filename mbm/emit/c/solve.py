"""The functions of a generated solver in C that its caller calls."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.agreement import agreement_answer, agreement_beginning, agreement_function, range_beginning, range_solve
from mbm.emit.c.cells import Cells
from mbm.emit.c.derived import estimates
from mbm.emit.c.frame import lossy
from mbm.emit.c.header import STATUSES
from mbm.emit.c.text import status_text
from mbm.emit.routines.noises import SCATTER, SQUARES, TOLD
from mbm.emit.routines.untold import ASSUMPTIONS
from mbm.emit.system import StaticSystem, kinds_of_units
from mbm.emit.types import Blueprint
from mbm.solver import description as at
from mbm.solver.consensus_records import Verdict

_GIVEN = {
    "constants": "constants",
    "data": "data_set",
    "parameters": "parameters",
    "whitening": "weights",
    "index": "index",
    "columns": "columns",
}
"""Arrays of the frame, by the fields of `Rows` that are they."""

_ANSWER = {
    "numbers": "point",
    **{name: name for name in ("results", "states", "sides", "triangle", "covariance", "multipliers")},
}
"""The same for `Answer`."""


def _spread(group: int, what: int) -> str:
    """What the residuals of a group of noise say at the end."""
    return f"spread_of_group(f->system, &f->work, f->point, f->kappa, {group}, {what}, f->spare)"


def solve_functions(blueprint: Blueprint, static: StaticSystem) -> str:
    """From the prepared arrays to the answer."""
    cells = Cells(blueprint)
    agreement = blueprint.agreement
    parts = [
        *_prepare(blueprint, static, cells),
        *(() if agreement is None else (agreement_function(blueprint, agreement, len(static.prefix)),)),
        *_answer(blueprint, static, cells),
        *_status_of(blueprint, cells),
        *_public(blueprint, static, cells),
    ]
    return "\n".join(parts)


def _prepare(blueprint: Blueprint, static: StaticSystem, cells: Cells) -> Iterator[str]:
    count = len(blueprint.unknowns)
    yield from (
        "/* Everything of a data set that the solver is handed. */",
        f"static int prepare(struct frame *f, const {blueprint.identifier}_data *data,",
        f"    {blueprint.identifier}_workspace *workspace)",
        "{",
        "    struct arena a = {0};",
        "    long b, c, count;",
        "    int status;",
        "",
        "    lay_out(f, data, &a);",
        "    if (a.reals_used > workspace->reals_size || a.integers_used > workspace->integers_size)",
        f"        return {cells.status('WORKSPACE_TOO_SMALL')};",
        "    a.reals = workspace->reals;",
        "    a.integers = workspace->integers;",
        "    a.reals_used = a.integers_used = 0;",
        "    lay_out(f, data, &a);",
        "    status = find_rows(f);",
        "    if (status != 0)",
        "        return status;",
        f"    place_unknowns(UNKNOWNS, {count}, f->members, f->offsets, f->firsts);",
        "    status = set_up(f);",
        "    if (status == 0)",
        "        status = assemble(f);",
        "    if (status != 0)",
        "        return status;",
        f"    for (c = 0; c < {len(static.prefix)}; c++)",
        "        ((long *)f->system)[c] = SYSTEM[c];",
        f"    count = f->firsts[{count}];",
        "    for (c = 0; c < count; c++)",
        "        f->used[c] = 0;",
        f"    for (b = 0; b < {len(blueprint.cases)}; b++) {{",
        "        const struct data_block *own = &blocks_of_data_set(f->data_set)[b];",
        "        mark_used(&blocks_of_problem(f->system)[b], own->rows, f->columns + own->columns, f->used);",
        "    }",
        f"    c = free_coordinates(UNKNOWNS, {count}, f->members, f->firsts, f->used, f->fixed, f->column);",
        "    renumber(f->columns_used, f->column, f->columns);",
        "    f->system->n = c;",
        f"    set_coordinates((long *)f->system, {len(static.prefix)}, UNKNOWNS, {count}, f->members, f->offsets,",
        "        f->firsts, f->column);",
        "    f->data_set->count = set_capacities(f->system, f->data_set);",
        "    set_constants(f->system, f->constants, count, f->column, f->lower, f->upper, TOLERANCE, LOSSES);",
        "    share_out(f->system, &f->work);",
    )
    for record, arrays in (("rows", _GIVEN), ("answer", _ANSWER)):
        yield from (f"    f->work.{record}.{name} = f->{array};" for name, array in arrays.items())
    yield from (
        "    for (b = 0; b < count; b++)",
        "        if (f->column[b] >= 0)",
        "            f->coordinates[f->column[b]] = b;",
    )
    if static.told:
        yield from (f"    for (b = 0; b < {ASSUMPTIONS}; b++)", "        f->apart[b] = 0.0;")
    yield from (
        f"    for (b = 0; b < {2 * max(kinds_of_units(blueprint), 1)}; b++)",
        "        f->kappa[b] = 1.0;",
    )
    if blueprint.agreement is not None:
        yield from agreement_beginning(blueprint, blueprint.agreement)
    if blueprint.ranges is not None:
        yield from range_beginning(blueprint, blueprint.ranges)
    yield from ("    return 0;", "}", "")


def _answer(blueprint: Blueprint, static: StaticSystem, cells: Cells) -> Iterator[str]:
    name = blueprint.identifier
    yield from (
        "/* Where the answer stands; `sigma` of what is not determined or at a bound is negative, of what stays 0. */",
        f"static void answer(struct frame *f, {name}_result *result)",
        "{",
        f"    const long n = f->system->n, all = f->firsts[{len(blueprint.unknowns)}];",
        "    long c;",
        "",
        *_reported(blueprint),
    )
    for derived in blueprint.derived:
        yield from (
            f"    if (!derive_{derived.identifier}(f))",
            f"        result->status = {cells.status('UNKNOWN_CASE')};",
            f"    result->{derived.identifier} = f->derived_{derived.identifier};",
            f"    result->{derived.identifier}_sigma = f->derived_{derived.identifier}_sigma;",
        )
        if derived.table is not None:
            yield f"    result->{derived.identifier}_rows = f->derived_{derived.identifier}_count;"
    for number, unknown in enumerate(blueprint.unknowns):
        for quaternion in unknown.quaternions:
            yield from (
                f"    for (c = f->offsets[{number}] + {quaternion}; c < f->offsets[{number + 1}]; c += {unknown.size})",
                "        sign_quaternion(f->estimates + c);",
            )
    yield from (
        f"    if (f->states[{at.DEFICIENT}] != 0)",
        "        mask_undetermined(f->system, &f->work, f->covariance);",
    )
    if static.told:
        yield "    mask_untold(n, f->apart, f->covariances, f->covariance);"
    yield from (
        "    for (c = 0; c < all; c++)",
        "        f->sigma[c] = f->fixed[c] ? 0.0 : -1.0;",
        "    for (c = 0; c < n; c++) {",
        "        const double variance = f->covariance[c * n + c];",
        "        f->sigma[f->coordinates[c]] = variance >= 0.0 && f->sides[c] == 0 ? sqrt(variance) : -1.0;",
        "    }",
        f"    result->numbers = f->offsets[{len(blueprint.unknowns)}];",
        "    result->point = f->point;",
        "    result->free = n;",
        "    result->coordinates = f->coordinates;",
        "    result->covariance = f->covariance;",
        "    result->sigmas = f->sigma;",
    )
    for number, unknown in enumerate(blueprint.unknowns):
        if unknown.family is not None:
            family = blueprint.families[unknown.family]
            yield from (
                f"    result->{unknown.identifier}_members = f->members[{number}];",
                f"    result->{unknown.identifier}_rows = f->{family.identifier};",
            )
        yield from (
            f"    result->{unknown.identifier} = f->{estimates(blueprint)} + f->offsets[{number}];",
            f"    result->{unknown.identifier}_sigma = f->sigma + f->firsts[{number}];",
        )
    if blueprint.agreement is not None:
        yield from agreement_answer(blueprint.agreement)
    yield from ("}", "")


def _status_of(blueprint: Blueprint, cells: Cells) -> Iterator[str]:
    yield from (
        "/* What the reason of the solver means to the caller. */",
        "static int status_of(const struct frame *f)",
        "{",
        f"    const long reason = f->states[{at.REASON}];",
        "",
        f"    if (reason == {at.NOT_FINITE_AT_START})",
        f"        return {cells.status('NOT_FINITE')};",
        f"    if (reason == {at.INFEASIBLE})",
        f"        return {cells.status('INFEASIBLE')};",
    )
    if blueprint.agreement is not None and blueprint.agreement.kept:
        yield from (
            f"    if (f->agreement[{Verdict.agreed}] == 1 && 2 * f->agreement[{Verdict.inliers}] < f->units)",
            f"        return {cells.status('NO_AGREEMENT')};",
        )
    yield from (
        f"    if (f->states[{at.DEFICIENT}] != 0)",
        f"        return {cells.status('UNOBSERVABLE')};",
        f"    if (reason < {at.SMALL_OFFSET} || reason > {at.ONE_STEP})",
        f"        return {cells.status('NOT_CONVERGED')};",
        f"    return {cells.status('CONVERGED')};",
        "}",
        "",
    )


def _reported(blueprint: Blueprint) -> Iterator[str]:
    """The estimates, where they are not the numbers of the solver: angles in (-pi, pi]; signs come last."""
    if estimates(blueprint) == "point":
        return
    yield from (
        f"    for (c = 0; c < f->offsets[{len(blueprint.unknowns)}]; c++)",
        "        f->estimates[c] = f->point[c];",
    )
    for number, unknown in enumerate(blueprint.unknowns):
        for angle in unknown.angles:
            yield from (
                f"    for (c = f->offsets[{number}] + {angle}; c < f->offsets[{number + 1}]; c += {unknown.size})",
                "        f->estimates[c] = turned_to(f->point[c], 0.0);",
            )


def _public(blueprint: Blueprint, static: StaticSystem, cells: Cells) -> Iterator[str]:
    name = blueprint.identifier
    yield from (
        f"void {name}_workspace_size(const {name}_data *data, {name}_workspace *workspace)",
        "{",
        "    struct frame f;",
        "    struct arena a = {0};",
        "",
        "    lay_out(&f, data, &a);",
        "    workspace->reals_size = a.reals_used;",
        "    workspace->integers_size = a.integers_used;",
        "}",
        "",
        *_solve(blueprint, static, cells),
        *_begin(name),
        *_functions(name),
        *status_text(name, {cells.status(word): sentence for word, sentence in STATUSES.items()}),
    )


def _solve(blueprint: Blueprint, static: StaticSystem, cells: Cells) -> Iterator[str]:
    name = blueprint.identifier
    yield from (
        f"int {name}_solve(const {name}_data *data, {name}_result *result, {name}_workspace *workspace)",
        "{",
        "    struct frame frame, *f = &frame;",
    )
    factors = bool(static.noises) or blueprint.agreement is not None
    yield from (f"    double factors[{max(len(static.noises), 1)}];",) if factors else ()
    yield from (
        *((f"    double told[{static.told * TOLD}];",) if static.told else ()),
        *(("    long c;",) if factors or static.scaled else ()),
        *(("    long n;",) if static.scaled else ()),
        *(("    double scatter;",) if static.scaled else ()),
        "",
        "    result->settled = 1;",
        "    result->status = prepare(f, data, workspace);",
        "    if (result->status != 0)",
        "        return result->status;",
        *(("    n = f->system->n;",) if static.scaled else ()),
    )
    if factors:
        yield from (f"    for (c = 0; c < {max(len(static.noises), 1)}; c++)", "        factors[c] = 1.0;")
    if blueprint.agreement is not None:
        yield from (
            "    result->status = agree_on(f, factors);",
            "    if (result->status != 0)",
            "        return result->status;",
        )
    if blueprint.ranges is None:
        yield "    solve_alone(f->system, f->data_set, f->start, &f->work);"
    else:
        yield from range_solve(blueprint.ranges, cells.status("NO_START"))
    if static.told:
        yield from (
            "    result->settled = settle_noises(f->system, &f->work, f->kappa, factors, told, f->spare);",
            "    set_assumptions(f->system, &f->work, told, f->apart, f->covariances);",
        )
    yield from (
        *_found(blueprint, static),
        "    result->status = status_of(f);",
        f"    result->iterations = f->states[{at.STEPS}];",
        f"    result->evaluations = f->states[{at.EVALUATIONS}];",
        f"    result->robust_cost = f->results[{at.COST}];",
        f"    result->freedom = f->states[{at.FREEDOM}];",
        "    result->sigma0 = result->freedom > 0 ? sqrt(result->cost / (double)result->freedom) : 0.0;",
    )
    if static.scaled:
        yield from (
            "    for (c = 0; c < n * n; c++)",
            "        f->covariance[c] *= result->freedom > 0 ? scatter / (double)result->freedom : 0.0;",
            "    if (result->freedom <= 0)",
            "        undetermined(n, f->sides, f->covariance);",
        )
    yield from ("    answer(f, result);", "    return result->status;", "}", "")


def _found(blueprint: Blueprint, static: StaticSystem) -> Iterator[str]:
    """The cost, and the covariance of losses and consensus."""
    yield f"    result->cost = f->results[{at.PLAIN_COST}];"
    if len(static.noises) == 1:
        yield from (
            "    /* one unknown factor counts as 1 in the cost */",
            f"    result->cost += (factors[0] * factors[0] - 1.0) * {_spread(0, SQUARES)};",
        )
    if static.scaled:
        yield from (
            "    /* all residuals share one unknown factor: the noise is as large as the residuals say */",
            f"    scatter = {_spread(-1, SCATTER)};",
        )
    if lossy(blueprint):
        yield from (
            f"    if (f->states[{at.REASON}] != {at.NOT_FINITE_AT_START}",
            "        && !sandwich(f->system, &f->work, f->point, f->sides, f->spare, f->covariance))",
            f"        f->states[{at.DEFICIENT}] = 1;",
        )
    elif blueprint.agreement is not None and blueprint.agreement.kept:
        yield from (
            f"    if (f->states[{at.REASON}] != {at.NOT_FINITE_AT_START} && f->states[{at.REASON}] != {at.INFEASIBLE}",
            "        && !inform(f->system, f->kappa, &f->work))",
            f"        f->states[{at.DEFICIENT}] = 1;",
        )


def _begin(name: str) -> Iterator[str]:
    yield from (
        f"int {name}_begin(const {name}_data *data, {name}_result *result, {name}_workspace *workspace)",
        "{",
        "    struct frame frame, *f = &frame;",
        "    long c, n;",
        "",
        "    memset(result, 0, sizeof *result);",
        "    result->status = prepare(f, data, workspace);",
        "    if (result->status != 0)",
        "        return result->status;",
        "    n = f->system->n;",
        "    for (c = 0; c < n * n; c++)",
        "        f->covariance[c] = NAN;",
        "    for (c = 0; c < f->system->numbers; c++)",
        "        f->point[c] = f->start[c];",
        f"    f->states[{at.DEFICIENT}] = f->work.penalised = 0;",
        "    for (c = 0; c < n; c++)",
        "        f->sides[c] = 0;",
        "    answer(f, result);",
        "    return result->status;",
        "}",
        "",
    )


def _functions(name: str) -> Iterator[str]:
    yield from (
        f"long {name}_residual_count(const {name}_data *data, {name}_workspace *workspace)",
        "{",
        "    struct frame f;",
        "",
        "    return prepare(&f, data, workspace) == 0 ? f.data_set->count : 0;",
        "}",
        "",
    )
    for word, slopes in (("residuals", 0), ("jacobian", 1)):
        yield from (
            f"void {name}_{word}(const {name}_data *data, const double *point, double *{word},",
            f"    {name}_workspace *workspace)",
            "{",
            "    struct frame frame, *f = &frame;",
            "",
            "    if (prepare(f, data, workspace) != 0)",
            "        return;",
            f"    all_rows(f->system, &f->work.rows, point, {slopes},",
            f"        f->spare, f->spare + row_scratch(f->system), {word});",
            "}",
            "",
        )
    yield from (
        f"int {name}_covariance(const {name}_data *data, const double *point, double *covariance,",
        f"    {name}_workspace *workspace)",
        "{",
        "    struct frame frame, *f = &frame;",
        "    long c;",
        "",
        "    if (prepare(f, data, workspace) != 0)",
        "        return 0;",
        "    load_rows(f->system, &f->work.rows);",
        "    sweep(f->system, point, 0, 0, &f->work.rows, f->constants, f->triangle);",
        "    for (c = 0; c < f->system->n; c++)",
        "        f->sides[c] = 0;",
        "    c = set_covariance(f->system, f->triangle, f->sides, 0, f->constants, &f->work, covariance)",
        "        < 1e300;",
        "    mask_undetermined(f->system, &f->work, covariance);",
        "    return (int)c;",
        "}",
        "",
    )
