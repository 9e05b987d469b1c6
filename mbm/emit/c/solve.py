"""The functions of a generated solver in C that its caller calls."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mbm.emit.c.agreement import agreement_answer, agreement_beginning, agreement_function
from mbm.emit.c.cells import Cells
from mbm.emit.c.derived import estimates
from mbm.emit.c.header import STATUSES
from mbm.emit.c.ranges import range_beginning, range_solve
from mbm.emit.c.sizes import lossy
from mbm.emit.c.text import status_text
from mbm.emit.routines.noises import SCATTER, SQUARES, TOLD
from mbm.emit.routines.untold import ASSUMPTIONS
from mbm.emit.system import StaticSystem, kinds_of_units
from mbm.emit.types import BlockCase, Blueprint
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
    "results": "results",
    "states": "states",
    "sides": "sides",
    "triangle": "triangle",
    "covariance": "covariance",
    "multipliers": "multipliers",
}
"""The same for `Answer`."""


def _spread(group: int, what: int) -> str:
    """What the residuals of a group of noise say at the end."""
    given = "f->system, &f->work.rows, f->point, f->covariance, f->kappa"
    return f"spread_of_group({given},\n        {group}, {what}, f->spare)"


def call_kernel(cases: Sequence[BlockCase]) -> str:
    """``call_kernel``: which function a number means."""
    lines = ["/* Kernel 2k gives the values of kernel k, 2k + 1 the values and the derivatives; `rows` of them. */"]
    lines += ["static void call_kernel(long kernel, const double *inputs, double *outputs, long rows)", "{"]
    lines += ["    long row;", "", "    switch (kernel) {"]
    for number, case in enumerate(cases):
        wide = len(case.variables) + len(case.parameters)
        for shift, word, count in (
            (0, "values", case.kernel.outputs),
            (1, "slopes", case.kernel.outputs + len(case.kernel.jacobian_rows)),
        ):
            lines += [f"    case {2 * number + shift}:", "        for (row = 0; row < rows; row++)"]
            lines.append(f"            {case.identifier}_{word}(inputs + row * {wide}, outputs + row * {count});")
            lines.append("        break;")
    return "\n".join([*lines, "    default:", "        break;", "    }", "}", ""])


def solve_functions(blueprint: Blueprint, static: StaticSystem) -> str:
    """From the prepared arrays to the answer."""
    cells = Cells(blueprint)
    agreement = blueprint.agreement
    parts = [
        *_prepare(blueprint, static, cells),
        *(() if agreement is None else (agreement_function(blueprint, agreement, len(static.prefix)),)),
        *_answer(blueprint, static, cells),
        *_public(blueprint, static, cells),
    ]
    return "\n".join(parts)


def _prepare(blueprint: Blueprint, static: StaticSystem, cells: Cells) -> Iterator[str]:
    count = len(blueprint.unknowns)
    yield "/* Everything of a data set that the solver is handed. */"
    yield f"static int prepare(struct frame *f, const {blueprint.identifier}_data *data,"
    yield f"    {blueprint.identifier}_workspace *workspace)"
    yield "{"
    yield "    struct arena a = {0};"
    yield "    long b, c, count;"
    yield "    int status;"
    yield ""
    yield "    lay_out(f, data, &a);"
    yield "    if (a.reals_used > workspace->reals_size || a.integers_used > workspace->integers_size)"
    yield f"        return {cells.status('WORKSPACE_TOO_SMALL')};"
    yield "    a.reals = workspace->reals;"
    yield "    a.integers = workspace->integers;"
    yield "    a.reals_used = a.integers_used = 0;"
    yield "    lay_out(f, data, &a);"
    yield "    status = find_rows(f);"
    yield "    if (status != 0)"
    yield "        return status;"
    yield f"    place_unknowns(UNKNOWNS, {count}, f->members, f->offsets, f->firsts);"
    yield "    status = set_up(f);"
    yield "    if (status == 0)"
    yield "        status = assemble(f);"
    yield "    if (status != 0)"
    yield "        return status;"
    yield f"    for (c = 0; c < {len(static.prefix)}; c++)"
    yield "        ((long *)f->system)[c] = SYSTEM[c];"
    yield f"    count = f->firsts[{count}];"
    yield "    for (c = 0; c < count; c++)"
    yield "        f->used[c] = 0;"
    yield f"    for (b = 0; b < {len(blueprint.cases)}; b++) {{"
    yield "        const struct data_block *own = &blocks_of_data_set(f->data_set)[b];"
    yield "        mark_used(&blocks_of_problem(f->system)[b], own->rows, f->columns + own->columns, f->used);"
    yield "    }"
    yield f"    c = free_coordinates(UNKNOWNS, {count}, f->members, f->firsts, f->used, f->fixed, f->column);"
    yield "    renumber(f->columns_used, f->column, f->columns);"
    yield "    f->system->n = c;"
    yield f"    set_coordinates((long *)f->system, {len(static.prefix)}, UNKNOWNS, {count}, f->members, f->offsets,"
    yield "        f->firsts, f->column);"
    yield "    f->data_set->count = set_capacities(f->system, f->data_set);"
    yield "    set_constants(f->system, f->constants, count, f->column, f->lower, f->upper, TOLERANCE, LOSSES);"
    yield "    share_out(f->system, &f->work);"
    for record, arrays in (("rows", _GIVEN), ("answer", _ANSWER)):
        for name, array in arrays.items():
            yield f"    f->work.{record}.{name} = f->{array};"
    yield "    for (b = 0; b < count; b++)"
    yield "        if (f->column[b] >= 0)"
    yield "            f->coordinates[f->column[b]] = b;"
    if static.told:
        yield f"    for (b = 0; b < {ASSUMPTIONS}; b++)"
        yield "        f->apart[b] = 0.0;"
    yield f"    for (b = 0; b < {max(kinds_of_units(blueprint), 1)}; b++)"
    yield "        f->kappa[b] = 1.0;"
    if blueprint.agreement is not None:
        yield from agreement_beginning(blueprint, blueprint.agreement)
    if blueprint.ranges is not None:
        yield from range_beginning(blueprint, blueprint.ranges)
    yield "    return 0;"
    yield "}"
    yield ""


def _answer(blueprint: Blueprint, static: StaticSystem, cells: Cells) -> Iterator[str]:
    name = blueprint.identifier
    yield "/* Where the answer stands; `sigma` of what is not determined is negative, of what stays 0. */"
    yield f"static void answer(struct frame *f, {name}_result *result)"
    yield "{"
    yield f"    const long n = f->system->n, all = f->firsts[{len(blueprint.unknowns)}];"
    yield "    long c;"
    yield ""
    yield from _reported(blueprint)
    for derived in blueprint.derived:
        yield f"    if (!derive_{derived.identifier}(f))"
        yield f"        result->status = {cells.status('UNKNOWN_CASE')};"
        yield f"    result->{derived.identifier} = f->derived_{derived.identifier};"
        yield f"    result->{derived.identifier}_sigma = f->derived_{derived.identifier}_sigma;"
        if derived.table is not None:
            yield f"    result->{derived.identifier}_rows = f->derived_{derived.identifier}_count;"
    yield f"    if (f->states[{at.DEFICIENT}] != 0)"
    yield "        mask_undetermined(f->system, &f->work, f->covariance);"
    if static.told:
        yield "    mask_untold(n, f->apart, f->covariances, f->covariance);"
    yield "    for (c = 0; c < all; c++)"
    yield "        f->sigma[c] = f->fixed[c] ? 0.0 : -1.0;"
    yield "    for (c = 0; c < n; c++) {"
    yield "        const double variance = f->covariance[c * n + c];"
    yield "        f->sigma[f->coordinates[c]] = variance >= 0.0 ? sqrt(variance) : -1.0;"
    yield "    }"
    yield f"    result->numbers = f->offsets[{len(blueprint.unknowns)}];"
    yield "    result->point = f->point;"
    yield "    result->free = n;"
    yield "    result->coordinates = f->coordinates;"
    yield "    result->covariance = f->covariance;"
    yield "    result->sigmas = f->sigma;"
    for number, unknown in enumerate(blueprint.unknowns):
        if unknown.family is not None:
            family = blueprint.families[unknown.family]
            yield f"    result->{unknown.identifier}_members = f->members[{number}];"
            yield f"    result->{unknown.identifier}_rows = f->{family.identifier};"
        yield f"    result->{unknown.identifier} = f->{estimates(blueprint)} + f->offsets[{number}];"
        yield f"    result->{unknown.identifier}_sigma = f->sigma + f->firsts[{number}];"
    if blueprint.agreement is not None:
        yield from agreement_answer(blueprint.agreement)
    yield "}"
    yield ""
    yield "/* What the reason of the solver means to the caller. */"
    yield "static int status_of(const struct frame *f)"
    yield "{"
    yield f"    const long reason = f->states[{at.REASON}];"
    yield ""
    yield f"    if (reason == {at.NOT_FINITE_AT_START})"
    yield f"        return {cells.status('NOT_FINITE')};"
    yield f"    if (reason == {at.INFEASIBLE})"
    yield f"        return {cells.status('INFEASIBLE')};"
    if blueprint.agreement is not None and blueprint.agreement.kept:
        yield f"    if (f->agreement[{Verdict.agreed}] == 1 && 2 * f->agreement[{Verdict.inliers}] < f->units)"
        yield f"        return {cells.status('NO_AGREEMENT')};"
    yield f"    if (f->states[{at.DEFICIENT}] != 0)"
    yield f"        return {cells.status('UNOBSERVABLE')};"
    yield f"    if (reason < {at.SMALL_OFFSET} || reason > {at.ONE_STEP})"
    yield f"        return {cells.status('NOT_CONVERGED')};"
    yield f"    return {cells.status('CONVERGED')};"
    yield "}"
    yield ""


def _reported(blueprint: Blueprint) -> Iterator[str]:
    """The estimates, where they are not the numbers of the solver: angles in (-pi, pi]."""
    angles = [number for number, unknown in enumerate(blueprint.unknowns) if unknown.angle]
    if not angles:
        return
    yield f"    for (c = 0; c < f->offsets[{len(blueprint.unknowns)}]; c++)"
    yield "        f->estimates[c] = f->point[c];"
    for number in angles:
        yield f"    for (c = f->offsets[{number}]; c < f->offsets[{number + 1}]; c++)"
        yield "        f->estimates[c] = turned_to(f->point[c], 0.0);"


def _public(blueprint: Blueprint, static: StaticSystem, cells: Cells) -> Iterator[str]:
    name = blueprint.identifier
    yield f"void {name}_workspace_size(const {name}_data *data, {name}_workspace *workspace)"
    yield "{"
    yield "    struct frame f;"
    yield "    struct arena a = {0};"
    yield ""
    yield "    lay_out(&f, data, &a);"
    yield "    workspace->reals_size = a.reals_used;"
    yield "    workspace->integers_size = a.integers_used;"
    yield "}"
    yield ""
    yield from _solve(blueprint, static, cells)
    yield from _begin(name)
    yield from _functions(name)
    yield from status_text(name, {cells.status(word): sentence for word, sentence in STATUSES.items()})


def _solve(blueprint: Blueprint, static: StaticSystem, cells: Cells) -> Iterator[str]:
    name = blueprint.identifier
    yield f"int {name}_solve(const {name}_data *data, {name}_result *result, {name}_workspace *workspace)"
    yield "{"
    yield "    struct frame frame, *f = &frame;"
    factors = bool(static.noises) or blueprint.agreement is not None
    yield from (f"    double factors[{max(len(static.noises), 1)}];",) if factors else ()
    yield from (f"    double told[{static.told * TOLD}];",) if static.told else ()
    yield from ("    long c;",) if factors or static.scaled else ()
    yield from ("    long n;",) if static.scaled else ()
    yield from ("    double scatter;",) if static.scaled else ()
    yield ""
    yield "    result->status = prepare(f, data, workspace);"
    yield "    if (result->status != 0)"
    yield "        return result->status;"
    yield from ("    n = f->system->n;",) if static.scaled else ()
    if factors:
        yield f"    for (c = 0; c < {max(len(static.noises), 1)}; c++)"
        yield "        factors[c] = 1.0;"
    if blueprint.agreement is not None:
        yield "    result->status = agree_on(f, factors);"
        yield "    if (result->status != 0)"
        yield "        return result->status;"
    if blueprint.ranges is None:
        yield "    solve_alone(f->system, f->data_set, f->start, &f->work);"
    else:
        yield from range_solve(blueprint.ranges, cells.status("NO_START"))
    if static.told:
        yield "    settle_noises(f->system, &f->work, f->kappa, factors, told, f->spare);"
        yield "    set_assumptions(f->system, &f->work, told, f->apart, f->covariances);"
    yield f"    result->cost = f->results[{at.PLAIN_COST}];"
    if len(static.noises) == 1:
        yield "    /* one unknown factor counts as 1 in the cost */"
        yield f"    result->cost += (factors[0] * factors[0] - 1.0) * {_spread(0, SQUARES)};"
    if static.scaled:
        yield "    /* all residuals share one unknown factor: the noise is as large as the residuals say */"
        yield f"    scatter = {_spread(-1, SCATTER)};"
    if lossy(blueprint):
        yield f"    if (f->states[{at.REASON}] != {at.NOT_FINITE_AT_START}"
        yield "        && !sandwich(f->system, &f->work.rows, f->point, f->sides,"
        yield f"            f->states[{at.DEFICIENT}] != 0 ? f->work.rank : -1,"
        yield "            f->work.part, f->spare, f->covariance))"
        yield f"        f->states[{at.DEFICIENT}] = 1;"
    elif blueprint.agreement is not None and blueprint.agreement.kept:
        yield f"    if (f->states[{at.REASON}] != {at.NOT_FINITE_AT_START}"
        yield "        && !inform(f->system, f->kappa, &f->work))"
        yield f"        f->states[{at.DEFICIENT}] = 1;"
    yield "    result->status = status_of(f);"
    yield f"    result->iterations = f->states[{at.STEPS}];"
    yield f"    result->evaluations = f->states[{at.EVALUATIONS}];"
    yield f"    result->robust_cost = f->results[{at.COST}];"
    yield f"    result->freedom = f->states[{at.FREEDOM}];"
    yield "    result->sigma0 = result->freedom > 0 ? sqrt(result->cost / (double)result->freedom) : 0.0;"
    if static.scaled:
        yield "    for (c = 0; c < n * n; c++)"
        yield "        f->covariance[c] *= result->freedom > 0 ? scatter / (double)result->freedom : 0.0;"
        yield "    if (result->freedom <= 0)"
        yield "        undetermined(n, f->sides, f->covariance);"
    yield "    answer(f, result);"
    yield "    return result->status;"
    yield "}"
    yield ""


def _begin(name: str) -> Iterator[str]:
    yield f"int {name}_begin(const {name}_data *data, {name}_result *result, {name}_workspace *workspace)"
    yield "{"
    yield "    struct frame frame, *f = &frame;"
    yield "    long c, n;"
    yield ""
    yield "    memset(result, 0, sizeof *result);"
    yield "    result->status = prepare(f, data, workspace);"
    yield "    if (result->status != 0)"
    yield "        return result->status;"
    yield "    n = f->system->n;"
    yield "    for (c = 0; c < n * n; c++)"
    yield "        f->covariance[c] = NAN;"
    yield "    for (c = 0; c < f->system->numbers; c++)"
    yield "        f->point[c] = f->start[c];"
    yield f"    f->states[{at.DEFICIENT}] = 0;"
    yield "    answer(f, result);"
    yield "    return result->status;"
    yield "}"
    yield ""


def _functions(name: str) -> Iterator[str]:
    yield f"long {name}_residual_count(const {name}_data *data, {name}_workspace *workspace)"
    yield "{"
    yield "    struct frame f;"
    yield ""
    yield "    return prepare(&f, data, workspace) == 0 ? f.data_set->count : 0;"
    yield "}"
    yield ""
    for word, slopes in (("residuals", 0), ("jacobian", 1)):
        yield f"void {name}_{word}(const {name}_data *data, const double *point, double *{word},"
        yield f"    {name}_workspace *workspace)"
        yield "{"
        yield "    struct frame frame, *f = &frame;"
        yield ""
        yield "    if (prepare(f, data, workspace) != 0)"
        yield "        return;"
        yield f"    all_rows(f->system, &f->work.rows, point, {slopes},"
        yield f"        f->spare, f->spare + row_scratch(f->system), {word});"
        yield "}"
        yield ""
    yield f"int {name}_covariance(const {name}_data *data, const double *point, double *covariance,"
    yield f"    {name}_workspace *workspace)"
    yield "{"
    yield "    struct frame frame, *f = &frame;"
    yield "    long c;"
    yield ""
    yield "    if (prepare(f, data, workspace) != 0)"
    yield "        return 0;"
    yield "    load_rows(f->system, &f->work.rows);"
    yield "    sweep(f->system, point, 0, 0, &f->work.rows, f->constants, f->triangle);"
    yield "    for (c = 0; c < f->system->n; c++)"
    yield "        f->sides[c] = 0;"
    yield "    c = set_covariance(f->system, f->triangle, f->sides, 0, f->constants, &f->work, covariance)"
    yield "        < 1e300;"
    yield "    mask_undetermined(f->system, &f->work, covariance);"
    yield "    return (int)c;"
    yield "}"
    yield ""
