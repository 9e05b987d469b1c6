"""``main.c``, which solves tables from files, and ``test.c``, which wants to see the reference numbers again."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.header import ANSWERS, UNSETTLED
from mbm.emit.c.reading import (
    arguments_read,
    each_data_set,
    key_text,
    program_head,
    reference_freed,
    reference_read,
)
from mbm.emit.c.text import bare, in_unit, literal, remark
from mbm.emit.foreign import Foreign
from mbm.emit.types import Blueprint, DerivedShape, UnknownShape
from mbm.machine.c import number
from mbm.scales import Scale

_RESERVE = """/* A workspace of the size that the data want. */
static int reserve(const {name}_data *data, {name}_workspace *workspace)
{{
    {name}_workspace_size(data, workspace);
    workspace->reals = malloc(sizeof(double) * (size_t)workspace->reals_size);
    workspace->integers = malloc(sizeof(long) * (size_t)workspace->integers_size);
    if (workspace->reals != NULL && workspace->integers != NULL)
        return 1;
    fprintf(stderr, "error: the workspace does not fit into the memory\\n");
    return 0;
}}

static void release({name}_workspace *workspace)
{{
    free(workspace->reals);
    free(workspace->integers);
}}
"""

_REST = """/* The end of a line: nothing stands where there is no standard deviation. */
static void print_rest(double sigma, const char *unit)
{
    if (sigma >= 0.0)
        printf("%.17g", sigma);
    putchar(',');
    csv_put_text(stdout, unit);
    putchar('\\n');
}
"""


def _heads(blueprint: Blueprint, doc: str) -> Iterator[str]:
    yield from program_head(blueprint, doc)
    yield _RESERVE.format(name=blueprint.identifier)


def main_file(blueprint: Blueprint) -> str:
    """``main.c``."""
    name = blueprint.identifier
    lines = [
        *_heads(blueprint, "solves the tables of the files that it is given."),
        *([_REST] if blueprint.derived or any(not u.dimension for u in blueprint.unknowns) else []),
        "/* One line for each number: estimate and standard deviation in the unit that the problem shows. */",
        f"static void print_result(const {name}_data *data, const {name}_result *result)",
        "{",
    ]
    if any(u.family is not None for u in blueprint.unknowns) or any(d.table for d in blueprint.derived):
        lines.append("    long m;")
    several = any(u.size > 1 or u.freedom > 1 or u.family is not None for u in blueprint.unknowns)
    if several or any(d.table or d.size > 1 for d in blueprint.derived):
        lines.append("    long c;")
    shapes: tuple[UnknownShape | DerivedShape, ...] = (*blueprint.unknowns, *blueprint.derived)
    printed = [line for shape in shapes for line in _printed(blueprint, shape)]
    if any("snprintf(key" in bare(line) for line in printed):
        lines.append("    char key[32];")
    lines += [
        "    (void)data;",
        *printed,
        "}",
        "",
        *_solve_one(blueprint),
        "int main(int argc, char **argv)",
        "{",
        f"    struct {name}_tables tables;",
        "    int worst = 0;",
        *(["    long row;", ""] if blueprint.for_each else [""]),
    ]
    lines += arguments_read(blueprint, blueprint.tables)
    for column in blueprint.for_each:
        lines += [f"    csv_put_text(stdout, {literal(column)});", "    putchar(',');"]
    lines += ['    puts("name,value,sigma,unit");']
    lines += each_data_set(blueprint, "worst = solve_one({data}, worst);")
    lines += [f"    {name}_free_tables(&tables);", "    return worst;", "}", ""]
    return "\n".join(lines)


def _solve_one(blueprint: Blueprint) -> Iterator[str]:
    name = blueprint.identifier
    yield from (
        "/* The worse of `worst` and the exit status of this solve: 0 solved, 1 not to be trusted, 2 wrong data. */",
        f"static int solve_one(const {name}_data *data, int worst)",
        "{",
        f"    {name}_workspace workspace;",
        f"    {name}_result result;",
        "    int status;",
        "",
        "    if (!reserve(data, &workspace))",
        "        return 2;",
        f"    status = {name}_solve(data, &result, &workspace);",
        f"    if (status < {ANSWERS}) {{",
        "        print_result(data, &result);",
        '        fprintf(stderr, "%s: chi2 %.9g, %ld degrees of freedom, sigma0 %.6g, %ld iterations\\n",',
        f"            {name}_status_text(status), result.cost, result.freedom, result.sigma0, result.iterations);",
    )
    yield from (
        "        if (!result.settled)",
        f'            fprintf(stderr, "{UNSETTLED}\\n");',
    )
    if blueprint.agreement is not None and blueprint.agreement.kept:
        yield from (
            '        fprintf(stderr, "%ld of %ld measurements agree%s\\n", result.inliers, result.units,',
            '            result.ambiguous ? ", but as many may agree elsewhere" : "");',
        )
    yield from (
        "    } else {",
        f'        fprintf(stderr, "error: %s\\n", {name}_status_text(status));',
        "    }",
        "    release(&workspace);",
        f"    status = status == 0 ? 0 : status < {ANSWERS} ? 1 : 2;",
        "    return status > worst ? status : worst;",
        "}",
        "",
    )


def _printed(blueprint: Blueprint, shape: UnknownShape | DerivedShape) -> Iterator[str]:
    """The lines of an unknown or a derived quantity: of each member or row ``m`` each number ``c``."""
    pad = "    "
    if isinstance(shape, UnknownShape):
        over, many, rows = shape.family is not None, shape.size > 1 or shape.freedom > 1, "members"
        key, lines = _member_key(blueprint, shape) if over else ("NULL", [])
    else:
        over, many, rows = shape.table is not None, shape.size > 1, "rows"
        key, lines = ("key", ['snprintf(key, sizeof key, "%ld", m + 1);']) if over else ("NULL", [])
    yield f"    {remark(shape.name)}"
    if over:
        yield f"    for (m = 0; m < result->{shape.identifier}_{rows}; m++)"
    if over or many:
        yield f"{pad}for (c = 0; c < {shape.size}; c++) {{"
        pad += "    "
    if blueprint.for_each:
        yield from key_text(blueprint, pad)
    yield from (pad + line for line in lines)
    place = f"{'m' if over else '0'} * {shape.size} + {'c' if over or many else '0'}"
    yield f"{pad}csv_put_name(stdout, {literal(shape.name)}, {key}, {'c + 1' if many else '0'});"
    if isinstance(shape, UnknownShape) and shape.dimension:
        # numbers of rotations and the like; their standard deviations belong to coordinates, which are others
        yield f'{pad}printf(",%.17g,,\\n", result->{shape.identifier}[{place}]);'
    else:
        yield from _value(shape.identifier, place, shape.scale, shape.unit, pad)
    if over or many:
        yield "    }"


def _value(identifier: str, place: str, scale: Scale, unit: Foreign, pad: str) -> Iterator[str]:
    """Estimate, standard deviation and unit, in that unit."""
    yield from (
        f'{pad}printf(",%.17g,", {in_unit(f"result->{identifier}[{place}]", scale)});',
        f"{pad}print_rest(result->{identifier}_sigma[{place}] / {number(scale.factor)}, {literal(unit)});",
    )


def _member_key(blueprint: Blueprint, unknown: UnknownShape) -> tuple[str, list[str]]:
    """The text of the key of member ``m``, and the statements that make it."""
    family = blueprint.families[unknown.family or 0]
    row = f"result->{unknown.identifier}_rows[m]"
    if family.key is None:
        return "key", [f'snprintf(key, sizeof key, "%ld", {row} + 1);']
    table = blueprint.table(family.table)
    column = table.column(family.key)
    cell = f"data->{table.identifier}_{column.identifier}[{row}]"
    if column.is_text:
        return cell, []
    return "key", [f'snprintf(key, sizeof key, "%.15g", {in_unit(cell, column.scale)});']


def test_file(blueprint: Blueprint) -> str:
    """``test.c``: solves the data of ``data/`` and compares with ``reference.csv``."""
    name = blueprint.identifier
    paths = [f'"data/{t.identifier}.csv"' for t in blueprint.tables] or ['""']
    lines = [*_heads(blueprint, "the numbers of `mbm solve` for the data of `data/` must come again.")]
    names = [unknown.identifier for unknown in blueprint.unknowns]
    starts = "\n".join(f"        data->start_{each} = start + (result.{each} - result.{names[0]});" for each in names)
    derived = "\n".join(
        f"    case {i}:\n        return sigma ? result->{d.identifier}_sigma[j] : result->{d.identifier}[j];"
        for i, d in enumerate(blueprint.derived)
    )
    lines += [
        _COMPARE.format(name=name, answers=ANSWERS, starts=starts, derived=derived),
        "int main(void)",
        "{",
    ]
    written = ", ".join(f"(char *){path}" for path in paths)
    lines += [
        f"    char *const paths[] = {{{written}}};",
        f"    struct {name}_tables tables;",
        "    struct csv reference;",
        "    long solve = 0, wrong = 0, compared = 0;",
        *(["    long row;", ""] if blueprint.for_each else [""]),
    ]
    lines += reference_read(blueprint)
    lines += each_data_set(blueprint, "wrong += compare({data}, solve++, &reference, &compared);")
    lines += reference_freed(blueprint)
    lines += [
        '    printf("%ld of %ld numbers differ\\n", wrong, compared);',
        "    return wrong == 0 && compared > 0 ? 0 : 1;",
        "}",
        "",
    ]
    return "\n".join(lines)


_COMPARE = """/* Number j of derived quantity i, or its standard deviation. */
static double derived_of(const {name}_result *result, const char *what, long i, long j)
{{
    const int sigma = strcmp(what, "derived sigma") == 0;

    (void)result;
    (void)j;
    switch (i) {{
{derived}
    default:
        return sigma ? -1.0 : HUGE_VAL;
    }}
}}

/* Begins at the `start` of `reference.csv`, where it has one for this solve: numbers to be freed. */
static double *begin_elsewhere({name}_data *data, long solve, const struct csv *reference, {name}_workspace *workspace)
{{
    {name}_result result;
    double *start;
    long row, i, given = 0;

    if ({name}_begin(data, &result, workspace) != 0)
        return NULL;
    start = malloc(sizeof *start * (size_t)result.numbers);
    if (start == NULL)
        return NULL;
    for (i = 0; i < result.numbers; i++)
        start[i] = result.point[i];
    for (row = 0; row < reference->rows; row++) {{
        if (atol(csv_cell(reference, row, 0)) != solve + 1 || strcmp(csv_cell(reference, row, 1), "start") != 0)
            continue;
        start[atol(csv_cell(reference, row, 2))] = strtod(csv_cell(reference, row, 4), NULL);
        given = 1;
    }}
    if (given) {{
{starts}
    }}
    return start;
}}

/* Solves one data set and counts the numbers that differ from the rows of `reference.csv` for it. */
static long compare(const {name}_data *data, long solve, const struct csv *reference, long *compared)
{{
    {name}_workspace workspace;
    {name}_result result;
    {name}_data begun = *data;
    double *start;
    long row, wrong = 0;

    if (!reserve(data, &workspace))
        return 1;
    start = begin_elsewhere(&begun, solve, reference, &workspace);
    if ({name}_solve(&begun, &result, &workspace) >= {answers}) {{
        fprintf(stderr, "solve %ld: %s\\n", solve + 1, {name}_status_text(result.status));
        free(start);
        release(&workspace);
        return 1;
    }}
    for (row = 0; row < reference->rows; row++) {{
        const char *what = csv_cell(reference, row, 1);
        const long i = atol(csv_cell(reference, row, 2)), j = atol(csv_cell(reference, row, 3));
        const double expected = strtod(csv_cell(reference, row, 4), NULL);
        const double allowed = strtod(csv_cell(reference, row, 5), NULL);
        double found = 0.0;
        if (atol(csv_cell(reference, row, 0)) != solve + 1 || strcmp(what, "start") == 0)
            continue;
        if (strcmp(what, "status") == 0)
            found = (double)result.status;
        else if (strcmp(what, "number") == 0)
            found = i < result.numbers ? result.point[i] : HUGE_VAL;
        else if (strcmp(what, "covariance") == 0)
            found = i < result.free && j < result.free ? result.covariance[i * result.free + j] : HUGE_VAL;
        else if (strcmp(what, "freedom") == 0)
            found = (double)result.freedom;
        else if (strcmp(what, "cost") == 0)
            found = result.cost;
        else
            found = derived_of(&result, what, i, j);
        (*compared)++;
        if (!(fabs(found - expected) <= allowed)) {{
            fprintf(stderr, "solve %ld: %s %ld %ld: %.17g, wanted %.17g\\n", solve + 1, what, i, j, found, expected);
            wrong++;
        }}
    }}
    free(start);
    release(&workspace);
    return wrong;
}}
"""
