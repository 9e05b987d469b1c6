"""``main.c`` of a generated filter, which goes through the steps of tables from files. ``test.c`` of a generated
filter, which wants to see the answers of `mbm solve` again.
"""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.filter_memory import DerivedRoom, derived_rooms
from mbm.emit.c.filter_tables import begun, each_window, heads
from mbm.emit.c.reading import arguments_read, each_data_set, key_text, reference_freed, reference_read
from mbm.emit.c.text import in_unit, literal
from mbm.emit.filtering.types import FilterBlueprint
from mbm.emit.foreign import told
from mbm.emit.types import TableColumn, UnknownShape
from mbm.machine.c import number


def main_file(made: FilterBlueprint) -> str:
    """``main.c``."""
    return "\n".join([*heads(made, "filters the tables of the files that it is given."), *_print(made), *_main(made)])


def _print(made: FilterBlueprint) -> Iterator[str]:
    blueprint = made.blueprint
    yield from (
        f"static void print_result(const {blueprint.identifier}_data *whole, double end,",
        f"    const {blueprint.identifier}_result *result)",
        "{",
        "    (void)whole;",
        "    (void)end;",
        *(line.replace("data->", "whole->") for line in key_text(made.files, "    ")),
    )
    if made.window is not None:
        yield f"""    printf("%.15g,", {in_unit("end", _window_column(made).scale)});"""
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
                yield from (
                    f"    if (result->{unknown.identifier}_sigma[{place}] >= 0.0)",
                    f'        printf(",%.17g", result->{unknown.identifier}_sigma[{place}] / {factor});',
                    "    else",
                    "        putchar(',');",
                )
    for room in derived_rooms(made):
        yield from _print_derived(room)
    yield from ("    putchar('\\n');", "}", "")


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
            yield from (
                "    putchar(',');",
                *((f"    if ({known})",) if known else ()),
                f'    {"    " if known else ""}printf("%.17g", {value});',
            )


def _unknowns(made: FilterBlueprint) -> list[tuple[UnknownShape, int]]:
    """The unknowns with how many members each has."""
    return [
        (unknown, 1 if unknown.family is None else made.family_sizes[unknown.family])
        for unknown in made.blueprint.unknowns
    ]


def _columns(made: FilterBlueprint) -> Iterator[str]:
    """Statements that print the names of the columns."""
    for column in (*made.files.for_each, *(() if made.window is None else (told(made.window.column, " end"),))):
        yield from (f"    csv_put_text(stdout, {literal(column)});", "    putchar(',');")
    yield from (f"    csv_put_text(stdout, {literal(made.plan.key)});", '    fputs(",innovation", stdout);')
    for unknown, members in _unknowns(made):
        for k in range(members):
            for word, count in (("", unknown.size), (" sigma", 0 if unknown.dimension else unknown.freedom)):
                for c in range(count):
                    member = f" {k + 1}" if unknown.family is not None else ""
                    component = f" {c + 1}" if count > 1 else ""
                    yield from (
                        "    putchar(',');",
                        f"    csv_put_text(stdout, {literal(unknown.name, member, component, word)});",
                    )
    for room in derived_rooms(made):
        for k in range(room.rows):
            for c in range(room.derived.size):
                row = "" if room.once else f" {k + 1}"
                component = f" {c + 1}" if room.derived.size > 1 else ""
                for word in ("", " sigma"):
                    yield from (
                        "    putchar(',');",
                        f"    csv_put_text(stdout, {literal(room.derived.name, row, component, word)});",
                    )
    yield "    putchar('\\n');"


def _main(made: FilterBlueprint) -> Iterator[str]:
    name = made.blueprint.identifier
    yield from (
        "/* The worse of `worst` and the exit status of this sequence: 0 estimated, 2 wrong data. */",
        f"static int filter_one(const {name}_data *whole, const {name}_data *data, double end, int worst)",
        "{",
        f"    struct {name}_steps steps;",
        f"    {name}_result result;",
        *((f"    {name}_given given;",) if made.beside else ()),
        "    int status = 0;",
        "",
        f"    if (!{name}_in_order(data))",
        "        return 2;",
        *begun(made),
        f"    while (status <= {name.upper()}_WAITING && {name}_next_step(data, &steps)) {{",
        f"        status = {name}_step(&filter, &steps.here, &result);",
        f"        if (status == {name.upper()}_ESTIMATED)",
        "            print_result(whole, end, &result);",
        f"        else if (status != {name.upper()}_WAITING)",
        f'            fprintf(stderr, "error at %.17g: %s\\n", steps.here.at, {name}_status_text(status));',
        "    }",
    )
    if made.plan.smooth:
        yield from (
            f"    while ({name}_finish(&filter, &result) == {name.upper()}_ESTIMATED)",
            "        print_result(whole, end, &result);",
        )
    yield from (
        f"    return status <= {name.upper()}_WAITING ? worst : 2;",
        "}",
        "",
    )
    head = f"static int filter_windows(const {name}_data *data, int worst)"
    yield from (
        *each_window(made, head, "worst = filter_one(data, &own, end, worst);", ("2", "worst")),
        "int main(int argc, char **argv)",
        "{",
        f"    struct {name}_tables tables;",
        "    int worst = 0;",
        *(("    long row;", "") if made.files.for_each else ("",)),
        *arguments_read(made.files, made.files.tables),
        *_columns(made),
    )
    call = "filter_one({data}, {data}, 0.0, worst);" if made.window is None else "filter_windows({data}, worst);"
    yield from (
        *each_data_set(made.files, f"worst = {call}"),
        f"    {name}_free_tables(&tables);",
        "    return worst;",
        "}",
        "",
    )


def _window_column(made: FilterBlueprint) -> TableColumn:
    """The column of the windows in the first table that has it."""
    columns = (c for t in made.files.tables for c in t.columns)
    return next(c for c in columns if made.window is not None and c.name == made.window.column)


_GIVEN = "const struct csv *reference, long *at, long *compared"
_KNOWN = """static double known(const struct csv *reference, long row, long column)
{
    const char *cell = csv_cell(reference, row, column);
    return *cell == 0 ? NAN : strtod(cell, NULL);
}

"""
_DIFFERS = """/* How far a number may lie from its reference: 1e-9 of its size or its standard deviation. */
static int differs(double value, double reference, double sigma)
{
    const double size = fabs(reference) > sigma ? fabs(reference) : sigma;
    return !(fabs(value - reference) <= 1e-9 * size);
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
        lines += [
            f"    wrong += compare_derived({rows}, {most}, {size}, result->{own}, result->{own}_sigma,",
            f"        result->{own}_covariance, reference, row, {column});",
            f"    *compared += {count};",
        ]
        column += count
    text = _COMPARE.format(name=name, upper=name.upper(), derived="".join(f"{line}\n" for line in lines))
    return f"{_KNOWN}{_COMPARE_DERIVED if lines else ''}{text}"


def test_file(made: FilterBlueprint) -> str:
    """``test.c``: filters the steps of ``data/`` and compares with ``reference.csv``."""
    name = made.blueprint.identifier
    paths = ", ".join(f'(char *)"data/{table.identifier}.csv"' for table in made.files.tables)
    lines = [
        *heads(made, "the numbers of `mbm solve` for the steps of `data/` must come again."),
        _DIFFERS + _compare(made),
        *_compare_sequence(made),
        "int main(void)",
        "{",
        f"    char *const paths[] = {{{paths}}};",
        f"    struct {name}_tables tables;",
        "    struct csv reference;",
        "    long at = 0, wrong = 0, compared = 0;",
        *(["    long row;"] if made.files.for_each else []),
        "",
    ]
    lines += reference_read(made.files)
    what = "sequence" if made.window is None else "windows"
    lines += each_data_set(made.files, f"wrong += compare_{what}({{data}}, &reference, &at, &compared);")
    lines += [
        "    wrong += at < reference.rows;",
        *reference_freed(made.files),
        '    printf("%ld of %ld numbers differ\\n", wrong, compared);',
        "    return wrong == 0 && compared > 0 ? 0 : 1;",
        "}",
        "",
    ]
    return "\n".join(lines)


def _compare_sequence(made: FilterBlueprint) -> Iterator[str]:
    name = made.blueprint.identifier
    yield from (
        "/* Filters one sequence and compares each step with the next row of `reference.csv`. */",
        f"static long compare_sequence(const {name}_data *data, {_GIVEN})",
        "{",
        f"    struct {name}_steps steps;",
        f"    {name}_result result;",
        *((f"    {name}_given given;",) if made.beside else ()),
        "    long wrong = 0;",
        "",
        f"    if (!{name}_in_order(data))",
        "        return 1;",
        *begun(made),
        f"    while (*at < reference->rows && {name}_next_step(data, &steps)) {{",
        f"        const int status = {name}_step(&filter, &steps.here, &result);",
        f"        if (status == {name.upper()}_ESTIMATED)",
        "            wrong += compare(&result, reference, (*at)++, compared);",
        f"        else if (status != {name.upper()}_WAITING) {{",
        f'            fprintf(stderr, "%.17g: %s\\n", steps.here.at, {name}_status_text(status));',
        "            return wrong + 1;",
        "        }",
        "    }",
    )
    if made.plan.smooth:
        yield from (
            f"    while (*at < reference->rows && {name}_finish(&filter, &result) == {name.upper()}_ESTIMATED)",
            "        wrong += compare(&result, reference, (*at)++, compared);",
        )
    yield from ("    return wrong;", "}", "")
    head = f"static long compare_windows(const {name}_data *data, {_GIVEN})"
    call = "wrong += compare_sequence(&own, reference, at, compared);"
    yield from each_window(made, head, call, ("1", "wrong"), "long wrong = 0")
