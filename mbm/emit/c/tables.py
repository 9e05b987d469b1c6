"""C functions that find rows: those that are kept, the members of families, and what keys name."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.cells import Cells
from mbm.emit.c.frame import ends
from mbm.emit.c.text import bare, remark
from mbm.emit.foreign import Foreign, Word, told
from mbm.emit.types import Blueprint, Choice, FamilyShape, Link, RowPrograms

FIND_TEXT = """/* The place of a key among cells: those in `rows`, or the first `count`; -1: it is none. Data often come
 * in the order of their keys, so the search begins behind the place that was found last, and goes round. */
static long place_of_text(const char *key, const char *const *cells, const long *rows, long count, long last)
{
    long i;
    for (i = 0; i < count; i++) {
        const long place = (last + 1 + i) % count;
        if (strcmp(cells[rows != NULL ? rows[place] : place], key) == 0)
            return place;
    }
    return -1;
}
"""
FIND_NUMBER = """/* The place of a key among numbers; without `cells` rows are named by their number, from 1. */
static long place_of_number(double key, const double *cells, const long *rows, long count, long last)
{
    long i;
    for (i = 0; i < count; i++) {
        const long place = (last + 1 + i) % count;
        const long row = rows != NULL ? rows[place] : place;
        if ((cells != NULL ? cells[row] : (double)(row + 1)) == key)
            return place;
    }
    return -1;
}
"""


def table_functions(blueprint: Blueprint, lacking: frozenset[Foreign] = frozenset()) -> str:
    """``find_rows``: kept rows, families, links, in the order in which they need one another.

    Tables that are ``lacking`` may have no row where one is named: nobody reads it then.
    """
    cells = Cells(blueprint)
    body = [*_kept(blueprint, cells)]
    for name, choice in ends(blueprint):
        body += _end(blueprint, cells, name, choice, lacking)
    for family in blueprint.families:
        body += _family(blueprint, cells, family)
    for link in blueprint.links:
        body += _link(blueprint, cells, link)
    text = "\n".join(body)
    code = bare(text)
    wide = max((len(c.inputs) for t in blueprint.tables if t.where is not None for c in t.where.cases), default=0)
    head = [
        "/* The rows that count, the members of families, and what the keys name. */",
        "static int find_rows(struct frame *f)",
        "{",
        f"    const {blueprint.identifier}_data *data = f->data;",
    ]
    names = [n for n in ("row", "i", "last") if _uses(code, n)]
    head += [f"    long {', '.join(names)};"] if names else []
    if any(table.where is not None for table in blueprint.tables):
        head += [f"    double inputs[{max(wide, 1)}], kept;"]
    found = [*head, "", "    (void)data;", text, "    return 0;", "}", ""]
    finders = [f for f, n in ((FIND_TEXT, "place_of_text("), (FIND_NUMBER, "place_of_number(")) if n in code]
    return "\n".join([*finders, *found])


def _uses(text: str, name: str) -> bool:
    """Whether a loop variable is used that no inner declaration brings."""
    return any(f"for ({name} =" in line or f"    {name} = " in line for line in text.split("\n"))


def _kept(blueprint: Blueprint, cells: Cells) -> Iterator[str]:
    for table in blueprint.tables:
        if table.where is None:
            continue
        count = f"f->kept_of_{table.identifier}_count"
        yield from (
            f"    {remark('the rows of `', table.name, '` that the problem keeps')}",
            f"    {count} = 0;",
            f"    for (row = 0; row < {cells.rows(table.name)}; row++) {{",
            *cells.call(table.where, "&kept", "        "),
            "        if (kept == 1.0)",
            f"            f->kept_of_{table.identifier}[{count}++] = row;",
            "    }",
        )


def _end(
    blueprint: Blueprint, cells: Cells, name: Foreign, choice: Choice, lacking: frozenset[Foreign]
) -> Iterator[str]:
    table = blueprint.table(name)
    count = cells.rows(name) if table.where is None else f"f->kept_of_{table.identifier}_count"
    place = "0" if choice is Choice.FIRST else f"{count} - 1"
    row = place if table.where is None else f"f->kept_of_{table.identifier}[{place}]"
    if name in lacking:
        row = f"{count} > 0 ? {row} : 0"
    else:
        yield from (f"    if ({count} == 0)", f"        return {cells.status('NO_ROWS')};")
    yield f"    f->{choice.value}_of_{table.identifier} = {row};"


def _family(blueprint: Blueprint, cells: Cells, family: FamilyShape) -> Iterator[str]:
    count = f"f->{family.identifier}_count"
    opened, closed = cells.loop(family.table)
    what = "distinct values" if family.distinct else "rows"
    yield from (
        f"    {remark(f'the members: {what} of `', family.table, '`')}",
        f"    {count} = 0;",
        *opened,
    )
    if family.distinct and family.key is not None:
        text = blueprint.table(family.table).column(family.key).is_text
        finder = "place_of_text" if text else "place_of_number"
        column = cells.column(family.table, family.key)
        yield from (
            f"        if ({finder}({column}[row], {column}, f->{family.identifier}, {count}, -1) >= 0)",
            "            continue;",
        )
    yield from (
        f"        f->{family.identifier}[{count}++] = row;",
        *closed,
        *(
            f"    f->members[{number}] = {count};    {remark(unknown.name)}"
            for number, unknown in enumerate(blueprint.unknowns)
            if unknown.family == family.number
        ),
    )


def _link(blueprint: Blueprint, cells: Cells, link: Link) -> Iterator[str]:
    key, text = cells.key(link.cell)
    column = "NULL" if link.key is None else cells.column(link.target, link.key)
    rows, count = "NULL", cells.rows(link.target)
    if link.family is not None:
        family = blueprint.families[link.family]
        rows, count = f"f->{family.identifier}", f"f->{family.identifier}_count"
    finder = "place_of_text" if text else "place_of_number"
    what = "member" if link.family is not None else told("row of `", link.target, "`")
    who = told("each row of `", link.table, "`") if link.table else "the problem"
    yield f"    {remark('the ', what, ' that ', who, ' names')}"
    missing = f"return {cells.status('UNKNOWN_KEY')};"
    if link.table is None:
        yield from (
            f"    f->{link.identifier}[0] = {finder}({key}, {column}, {rows}, {count}, -1);",
            f"    if (f->{link.identifier}[0] < 0)",
            f"        {missing}",
        )
        return
    yield "    last = -1;"
    opened, closed = cells.loop(link.table)
    if link.family is None:
        opened, closed = [f"    for (row = 0; row < {cells.rows(link.table)}; row++) {{"], ["    }"]
    yield from (
        *opened,
        f"        last = {finder}({key}, {column}, {rows}, {count}, last);",
        "        if (last < 0)",
        f"            {missing}",
        f"        f->{link.identifier}[row] = last;",
        *closed,
    )


def programs_used(blueprint: Blueprint) -> Iterator[tuple[RowPrograms, Word]]:
    """The programs of data, with what they compute in words."""
    yield from (
        (table.where, told("whether a row of `", table.name, "` is kept: 1 or 0"))
        for table in blueprint.tables
        if table.where is not None
    )
    for unknown in blueprint.unknowns:
        for programs, words in (
            (unknown.start, "where the iteration begins"),
            (unknown.lower, "the lower bounds"),
            (unknown.upper, "the upper bounds"),
            (unknown.fixed, "which coordinates stay: 1 or 0"),
        ):
            if programs is not None:
                yield programs, told(unknown.name, ": ", words)
        yield from (
            (programs, told(unknown.name, ": an end of the range of starts")) for programs in unknown.start_range or ()
        )
    yield from (
        (block.when, told(block.name, ": whether a row is used: 1 or 0"))
        for block in blueprint.blocks
        if block.when is not None
    )
