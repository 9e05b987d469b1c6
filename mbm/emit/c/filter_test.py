"""``test.c`` of a generated filter, which wants to see the answers of `mbm solve` again."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.filter_memory import derived_rooms
from mbm.emit.c.filter_tables import begun, each_window, heads
from mbm.emit.c.reading import DIFFERS, each_data_set, reference_freed, reference_read
from mbm.emit.filtering.types import FilterBlueprint

_GIVEN = "const struct csv *reference, long *at, long *compared"
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
        DIFFERS + _compare(made),
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
