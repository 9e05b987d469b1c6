"""``main.c`` of a generated filter, which goes through the steps of tables from files, and ``test.c``."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.filter_memory import DerivedRoom, derived_rooms
from mbm.emit.c.reading import DIFFERS, arguments_read, program_head, table_read, tables_head
from mbm.emit.c.text import in_unit, literal
from mbm.emit.filtering.types import FilterBlueprint
from mbm.emit.types import TableShape, UnknownShape
from mbm.machine.c import number


def _tables(made: FilterBlueprint) -> list[TableShape]:
    return [table for table in made.blueprint.tables if table.name in made.given]


def tables_file(made: FilterBlueprint) -> str:
    """``<problem>_tables.h``: tables from CSV files, and the rows of one step after the other from them."""
    return "\n".join([*_head(made), *_read(made), *_next(made)])


def _head(made: FilterBlueprint) -> Iterator[str]:
    name, tables = made.blueprint.identifier, _tables(made)
    yield from tables_head(made.blueprint, ": its tables from CSV files, step by step.", len(tables))
    yield "/* The files, the columns that were made of them, and the rows of each that are gone through. */"
    yield f"struct {name}_tables {{"
    yield f"    struct csv files[{len(tables)}];"
    yield f"    {name}_rows all, here;"
    yield f"    long done[{len(tables)}];"
    yield "};"
    yield ""


def _read(made: FilterBlueprint) -> Iterator[str]:
    name = made.blueprint.identifier
    yield "/* 0: a file cannot be read, or its rows are not in the order of their steps. */"
    yield f"static int {name}_read_tables(struct {name}_tables *tables, char *const *paths)"
    yield "{"
    yield f"    {name}_rows *all = &tables->all;"
    yield "    long i;"
    yield ""
    yield "    memset(tables, 0, sizeof *tables);"
    for position, table in enumerate(_tables(made)):
        yield from table_read(table, position, "all")
        key = _key(made, table)
        yield f"    for (i = 1; i < all->{table.identifier}_rows; i++)"
        yield f"        if (!({key.format('all', 'i - 1')} <= {key.format('all', 'i')})) {{"
        yield '            fputs("error: the rows are not in the order of ", stderr);'
        yield f"            fputs({literal(made.plan.key)}, stderr);"
        yield '            fputs("\\n", stderr);'
        yield "            return 0;"
        yield "        }"
    yield "    return 1;"
    yield "}"
    yield ""
    yield f"static void {name}_free_tables(struct {name}_tables *tables)"
    yield "{"
    for table in _tables(made):
        for column in table.columns:
            yield f"    free((void *)tables->all.{table.identifier}_{column.identifier});"
    yield f"    for (long i = 0; i < {name.upper()}_TABLES; i++)"
    yield "        csv_free(&tables->files[i]);"
    yield "}"
    yield ""


def _key(made: FilterBlueprint, table: TableShape) -> str:
    column = table.column(made.plan.key)
    return f"{{}}->{table.identifier}_{column.identifier}[{{}}]"


def _next(made: FilterBlueprint) -> Iterator[str]:
    name = made.blueprint.identifier
    yield "/* The rows of the next step, in `here`; 0: there is none. */"
    yield f"static int {name}_next_step(struct {name}_tables *tables)"
    yield "{"
    yield f"    const {name}_rows *all = &tables->all;"
    yield f"    {name}_rows *here = &tables->here;"
    yield "    int found = 0;"
    yield ""
    for position, table in enumerate(_tables(made)):
        key = _key(made, table).format("all", f"tables->done[{position}]")
        yield f"    if (tables->done[{position}] < all->{table.identifier}_rows"
        yield f"        && (!found || {key} < here->at)) {{"
        yield f"        here->at = {key};"
        yield "        found = 1;"
        yield "    }"
    for position, table in enumerate(_tables(made)):
        key = _key(made, table)
        yield f"    here->{table.identifier}_rows = 0;"
        for column in table.columns:
            held = f"{table.identifier}_{column.identifier}"
            yield f"    here->{held} = all->{held} + tables->done[{position}];"
        yield f"    while (tables->done[{position}] < all->{table.identifier}_rows"
        yield f"        && {key.format('all', f'tables->done[{position}]')} == here->at) {{"
        yield f"        here->{table.identifier}_rows++;"
        yield f"        tables->done[{position}]++;"
        yield "    }"
    yield "    return found;"
    yield "}"
    yield ""
    yield "#endif"
    yield ""


def _heads(made: FilterBlueprint, doc: str) -> Iterator[str]:
    yield from program_head(made.blueprint, doc)
    yield f"static {made.blueprint.identifier}_filter filter;"
    yield f"static struct {made.blueprint.identifier}_tables tables;"
    yield ""


def main_file(made: FilterBlueprint) -> str:
    """``main.c``."""
    return "\n".join([*_heads(made, "filters the tables of the files that it is given."), *_print(made), *_main(made)])


def _print(made: FilterBlueprint) -> Iterator[str]:
    blueprint = made.blueprint
    yield f"static void print_result(const {blueprint.identifier}_result *result)"
    yield "{"
    yield '    printf("%.17g,%.17g", result->at, result->innovation);'
    for unknown, members in _unknowns(made):
        for k in range(members):
            for c in range(unknown.size):
                place = k * unknown.size + c
                value = in_unit(f"result->{unknown.identifier}[{place}]", unknown.scale)
                yield f'    printf(",%.17g", {value});'
            factor = number(unknown.scale.factor)
            for c in range(0 if unknown.dimension else unknown.freedom):
                place = k * unknown.freedom + c
                yield f"    if (result->{unknown.identifier}_sigma[{place}] >= 0.0)"
                yield f'        printf(",%.17g", result->{unknown.identifier}_sigma[{place}] / {factor});'
                yield "    else"
                yield "        putchar(',');"
    for room in derived_rooms(made):
        yield from _print_derived(room)
    yield "    putchar('\\n');"
    yield "}"
    yield ""


def _print_derived(room: DerivedRoom) -> Iterator[str]:
    """Value and standard deviation of each number; nothing where there is no row."""
    name, scale = room.derived.identifier, room.derived.scale
    for place in range(room.rows * room.derived.size):
        here = "" if room.once else f"{place // room.derived.size} < result->{name}_rows"
        for suffix, value in (
            ("", in_unit(f"result->{name}[{place}]", scale)),
            ("_sigma", f"result->{name}_sigma[{place}] / {number(scale.factor)}"),
        ):
            known = " && ".join(filter(None, (here, f"result->{name}_sigma[{place}] >= 0.0" if suffix else "")))
            yield "    putchar(',');"
            yield from (f"    if ({known})",) if known else ()
            yield f'    {"    " if known else ""}printf("%.17g", {value});'


def _unknowns(made: FilterBlueprint) -> list[tuple[UnknownShape, int]]:
    """The unknowns with how many members each has."""
    return [
        (unknown, 1 if unknown.family is None else made.family_sizes[unknown.family])
        for unknown in made.blueprint.unknowns
    ]


def _columns(made: FilterBlueprint) -> Iterator[str]:
    """Statements that print the names of the columns."""
    yield f"    csv_put_text(stdout, {literal(made.plan.key)});"
    yield '    fputs(",innovation", stdout);'
    for unknown, members in _unknowns(made):
        for k in range(members):
            for word, count in (("", unknown.size), (" sigma", 0 if unknown.dimension else unknown.freedom)):
                for c in range(count):
                    member = f" {k + 1}" if unknown.family is not None else ""
                    component = f" {c + 1}" if count > 1 else ""
                    yield "    putchar(',');"
                    yield f"    csv_put_text(stdout, {literal(unknown.name, member, component, word)});"
    for room in derived_rooms(made):
        for k in range(room.rows):
            for c in range(room.derived.size):
                row = "" if room.once else f" {k + 1}"
                component = f" {c + 1}" if room.derived.size > 1 else ""
                for word in ("", " sigma"):
                    yield "    putchar(',');"
                    yield f"    csv_put_text(stdout, {literal(room.derived.name, row, component, word)});"
    yield "    putchar('\\n');"


def _main(made: FilterBlueprint) -> Iterator[str]:
    name = made.blueprint.identifier
    yield "int main(int argc, char **argv)"
    yield "{"
    yield f"    {name}_result result;"
    yield "    int status = 0;"
    yield ""
    yield from arguments_read(made.blueprint, _tables(made))
    yield from _columns(made)
    yield f"    {name}_begin(&filter);"
    yield f"    while (status <= {name.upper()}_WAITING && {name}_next_step(&tables)) {{"
    yield f"        status = {name}_step(&filter, &tables.here, &result);"
    yield f"        if (status == {name.upper()}_ESTIMATED)"
    yield "            print_result(&result);"
    yield f"        else if (status != {name.upper()}_WAITING)"
    yield f'            fprintf(stderr, "error at %.17g: %s\\n", tables.here.at, {name}_status_text(status));'
    yield "    }"
    if made.plan.smooth:
        yield f"    while ({name}_finish(&filter, &result) == {name.upper()}_ESTIMATED)"
        yield "        print_result(&result);"
    yield f"    {name}_free_tables(&tables);"
    yield f"    return status <= {name.upper()}_WAITING ? 0 : 2;"
    yield "}"
    yield ""


_KNOWN = """static double known(const struct csv *reference, long row, long column)
{
    const char *cell = csv_cell(reference, row, column);
    return *cell == 0 ? NAN : strtod(cell, NULL);
}

"""
_COMPARE = """/* Compares an answer with a row of `reference.csv`; how many numbers differ. */
static long compare(const {name}_result *result, const struct csv *reference, long row, long *compared)
{{
    const long numbers = {upper}_NUMBERS, n = {upper}_FREE;
    long i, j, wrong = 0;
    double variance = 0.0, spread;

    wrong += result->at != known(reference, row, 0);
    for (i = 0; i < n; i++)
        if (result->covariance[i * n + i] > variance)
            variance = result->covariance[i * n + i];
    spread = sqrt(variance);
    for (i = 0; i < numbers; i++)
        wrong += differs(result->point[i], known(reference, row, 1 + i), spread);
    for (i = 0; i < n; i++) {{
        for (j = 0; j < n; j++) {{
            const double found = result->covariance[i * n + j];
            const double expected = known(reference, row, 1 + numbers + i * n + j);
            const double size = sqrt(result->covariance[i * n + i] * result->covariance[j * n + j]);
            wrong += isnan(expected) ? !isnan(found) : differs(found, expected, size);
        }}
    }}
    if (!isnan(result->innovation))
        wrong += differs(result->innovation, known(reference, row, 1 + numbers + n * n), 1.0);
    *compared += 1 + numbers + n * n;
{derived}    return wrong;
}}
"""
_COMPARE_DERIVED = """/* Compares a derived quantity, `size` numbers in each of at most `most` rows, from a `column`. */
static long compare_derived(long rows, long most, long size, const double *found, const double *sigma,
    const double *covariance, const struct csv *reference, long row, long column)
{
    long i, j, k, wrong = (double)rows != known(reference, row, column);

    for (i = 0; i < rows && i < most; i++) {
        for (j = i * size; j < (i + 1) * size; j++) {
            const double value = known(reference, row, column + 1 + j);
            wrong += isnan(value) ? !isnan(found[j]) : differs(found[j], value, sigma[j]);
            for (k = 0; k < size; k++) {
                const double c = known(reference, row, column + 1 + (most + j) * size + k);
                const double own = covariance[j * size + k];
                wrong += isnan(c) ? !isnan(own) : differs(own, c, sigma[j] * sigma[i * size + k]);
                if (i * size + k == j)
                    wrong += isnan(c) ? sigma[j] >= 0.0 : differs(sigma[j], sqrt(c), 0.0);
            }
        }
    }
    return wrong;
}

"""


def _compare(made: FilterBlueprint) -> str:
    """The functions that compare."""
    name, plan = made.blueprint.identifier, made.plan
    column = 2 + plan.chain["numbers"] + plan.chain["n"] ** 2
    lines = []
    for room in derived_rooms(made):
        own, size, most = room.derived.identifier, room.derived.size, room.rows
        rows = "1" if room.once else f"result->{own}_rows"
        count = 1 + most * size * (1 + size)
        lines.append(f"    wrong += compare_derived({rows}, {most}, {size}, result->{own}, result->{own}_sigma,")
        lines.append(f"        result->{own}_covariance, reference, row, {column});")
        lines.append(f"    *compared += {count};")
        column += count
    text = _COMPARE.format(name=name, upper=name.upper(), derived="".join(f"{line}\n" for line in lines))
    return f"{_KNOWN}{_COMPARE_DERIVED if lines else ''}{text}"


def test_file(made: FilterBlueprint) -> str:
    """``test.c``: filters the steps of ``data/`` and compares with ``reference.csv``."""
    name = made.blueprint.identifier
    paths = ", ".join(f'(char *)"data/{table.identifier}.csv"' for table in _tables(made))
    lines = [*_heads(made, "the numbers of `mbm solve` for the steps of `data/` must come again.")]
    lines += [DIFFERS + _compare(made), "int main(void)", "{"]
    lines += [f"    char *const paths[] = {{{paths}}};", "    struct csv reference;", f"    {name}_result result;"]
    lines += ["    long row = 0, wrong = 0, compared = 0;", ""]
    lines += ['    if (!csv_read(&reference, "reference.csv"))', "        return 2;"]
    lines += [f"    if (!{name}_read_tables(&tables, paths))", "        return 2;", f"    {name}_begin(&filter);"]
    lines += [f"    while (row < reference.rows && {name}_next_step(&tables)) {{"]
    lines += [f"        const int status = {name}_step(&filter, &tables.here, &result);"]
    lines += [f"        if (status == {name.upper()}_ESTIMATED)"]
    lines += ["            wrong += compare(&result, &reference, row++, &compared);"]
    lines += [f"        else if (status != {name.upper()}_WAITING) {{"]
    lines += [f'            fprintf(stderr, "%.17g: %s\\n", tables.here.at, {name}_status_text(status));']
    lines += ["            return 1;", "        }", "    }"]
    if made.plan.smooth:
        lines += [f"    while (row < reference.rows && {name}_finish(&filter, &result) == {name.upper()}_ESTIMATED)"]
        lines += ["        wrong += compare(&result, &reference, row++, &compared);"]
    lines += [f"    {name}_free_tables(&tables);", "    wrong += row < reference.rows;", "    csv_free(&reference);"]
    lines += ['    printf("%ld of %ld numbers differ\\n", wrong, compared);']
    lines += ["    return wrong == 0 && compared > 0 ? 0 : 1;", "}", ""]
    return "\n".join(lines)
