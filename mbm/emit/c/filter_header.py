"""The header of a generated filter in C: the filter, the rows of a step, what is answered for it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from mbm.emit.c.filter_memory import capacity, derived_rooms, places
from mbm.emit.c.header import derived_fields, guarded, opened, table_fields
from mbm.emit.c.text import remark
from mbm.emit.filtering.types import FilterBlueprint
from mbm.emit.foreign import Word, told
from mbm.emit.types import UnknownShape

STATUSES: Mapping[str, str] = {
    "ESTIMATED": "the step is estimated",
    "WAITING": "a smoother has no step to answer yet",
    "NO_STEP": "all steps are answered",
    "STOPPED": "something was not finite at a step: the filter has to begin anew",
    "OUT_OF_ORDER": "a step does not follow on the last one, or its place is no number",
    "OTHER_STEP": "a row belongs to another step",
    "TOO_MANY_ROWS": "a table has more rows than there is room for",
    "NOT_A_NUMBER": "a cell is not finite",
    "NO_TRANSITION": "a table that the transition takes its columns from has no row at the step, or several",
    "NO_ROWS": "a table that one row is wanted of has none",
    "UNKNOWN_KEY": "a key names no row or member",
    "UNKNOWN_CASE": "a row has values that no row had when the filter was made",
    "BAD_NOISE": "a standard deviation is not above zero, or a matrix is not symmetric and positive definite",
}
"""What a call answers, in order from 0; behind ``STOPPED`` the step is wrong, and was not taken."""


def filter_header(made: FilterBlueprint) -> str:
    """``<problem>.h``."""
    blueprint = made.blueprint
    name = blueprint.identifier
    reals, integers = (sum(sizes.values()) for sizes in places(made))
    lines = [*opened(name, _doc(made), STATUSES), "/* Sizes. */", "enum {"]
    for table in blueprint.tables:
        if table.name in (*made.given, *made.beside):
            most = remark("most rows of `", table.name, "`", " at a step" if table.name in made.given else "")
            lines.append(f"    {name.upper()}_MOST_{table.identifier.upper()} = {capacity(made, table)},    {most}")
    plan = made.plan
    lines += [
        f"    {name.upper()}_NUMBERS = {plan.chain['numbers']},    /* N, numbers of a step */",
        f"    {name.upper()}_FREE = {plan.chain['n']},    /* n, those of its coordinates that are estimated */",
        f"    {name.upper()}_REALS = {reals},",
        f"    {name.upper()}_INTEGERS = {integers}",
        "};",
        "",
    ]
    if made.beside:
        lines += [
            "/* What is given before the first step, and stays: columns, one element per row, in SI. */",
            "typedef struct {",
            *(line for t in map(blueprint.table, made.beside) for line in table_fields(t)),
            f"}} {name}_given;",
            "",
        ]
    lines += [
        "/* A filter: all memory that it takes, but for some kB of the stack in calls. */",
        "typedef struct {",
        f"    double reals[{name.upper()}_REALS];",
        f"    long integers[{name.upper()}_INTEGERS];",
        *([f"    {name}_given given;"] if made.beside else []),
        f"}} {name}_filter;",
        "",
        "/* What is given at a step: columns, one element per row, in SI. */",
        "typedef struct {",
        f"    double at;    {remark('where the step is: `', plan.key, '`')}",
    ]
    for table in blueprint.tables:
        lines += table_fields(table, {plan.key: "; NULL: it is that of the step"}) if table.name in made.given else ()
    lines += [
        f"}} {name}_rows;",
        "",
        "/* What is answered, in SI; arrays stand in the filter. */",
        "typedef struct {",
        *_result(),
        *(line for unknown in blueprint.unknowns for line in _estimate(made, unknown)),
    ]
    for room in derived_rooms(made):
        lines += derived_fields(room.derived, once=room.once)
        many, size = "" if room.once else "rows x ", room.derived.size
        shape = f"({many}{size} x {size}); NaN: not determined"
        lines.append(f"    const double *{room.derived.identifier}_covariance;    /* {shape} */")
    lines += [f"}} {name}_result;", "", *_calls(made), *guarded("}"), "", "#endif", ""]
    return "\n".join(lines)


def _doc(made: FilterBlueprint) -> Iterator[Word]:
    blueprint = made.blueprint
    yield from (
        told(blueprint.name, ": ", blueprint.doc) if blueprint.doc else blueprint.name,
        "",
        f"A filter ({made.plan.method}), written by mbm {blueprint.version}. Everything is in SI, angles in radians.",
        "Nothing is allocated: a filter is a struct of the caller. Calls share nothing but their arguments.",
    )


def _result() -> Iterator[str]:
    yield from (
        "    int status;",
        "    double at;                   /* the step that is answered */",
        "    double innovation;           /* v' S^-1 v of its innovations v, with covariance S; NaN of a smoother */",
        "    long residuals;              /* scalar rows of the step that came in: the mean of `innovation` */",
        "    long hypotheses;             /* that are followed */",
        "    const double *point;         /* (N) all numbers of the step */",
        "    const double *covariance;    /* (n, n) row by row; NaN: not determined */",
        "    const double *sigmas;        /* of all coordinates; 0: it stays, negative: not determined */",
    )


def _estimate(made: FilterBlueprint, unknown: UnknownShape) -> Iterator[str]:
    doc = (": ", unknown.doc) if unknown.doc else ()
    unit = (", shown in ", unknown.unit) if unknown.unit else ()
    many = "" if unknown.family is None else "members x "
    what = remark("`", unknown.name, f"` ({many}{unknown.size}) {unknown.kind.value}", *doc, *unit)
    yield from (
        f"    const double *{unknown.identifier};    {what}",
        f"    const double *{unknown.identifier}_sigma;    /* ({many}{unknown.freedom}) */",
    )


def _calls(made: FilterBlueprint) -> Iterator[str]:
    name, plan = made.blueprint.identifier, made.plan
    wrong = " What is wrong with the tables is answered by the first step." if made.beside else ""
    yield from (
        f"/* Lets a filter be before its first step.{wrong} */",
        f"void {name}_begin({name}_filter *filter{f', const {name}_given *given' if made.beside else ''});",
        "",
    )
    what = "the step a lag before, while there is one" if plan.smooth else "it"
    yield from (
        f"/* Takes the rows of the next step, and answers {what}. What is wrong with the rows",
        "   is answered before anything changes: the step can be given again. */",
        f"int {name}_step({name}_filter *filter, const {name}_rows *rows, {name}_result *result);",
        "",
    )
    if plan.smooth:
        yield from (
            "/* Answers the next of the steps that are left, given all rows; no step can come any more. */",
            f"int {name}_finish({name}_filter *filter, {name}_result *result);",
            "",
        )
    yield from (
        "/* What a status means. */",
        f"const char *{name}_status_text(int status);",
        "",
    )
