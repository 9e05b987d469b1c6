"""The header of a generated solver in C: what it is given, what it answers, what can be called."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from types import MappingProxyType

from mbm.emit.c.text import comment, remark
from mbm.emit.foreign import Foreign, Word, told
from mbm.emit.types import Blueprint, DerivedShape, TableShape, UnknownShape

STATUSES: Mapping[str, str] = {
    "CONVERGED": "converged",
    "NOT_CONVERGED": "not converged: the estimates should not be trusted",
    "UNOBSERVABLE": "the data do not determine all unknowns",
    "INFEASIBLE": "no point meets all constraints",
    "NO_AGREEMENT": "fewer than half of the measurements agree with any one solution",
    "NOT_FINITE": "an equation has no finite value at the start",
    "NO_ROWS": "a table that one row is wanted of has none",
    "UNKNOWN_KEY": "a key names no row or member",
    "UNKNOWN_CASE": "a row has values that no row had when the solver was made",
    "BAD_NOISE": "a standard deviation is not above zero, or a matrix is not symmetric and positive definite",
    "BAD_BOUNDS": "a lower bound is not below the upper one",
    "BAD_START": "an unknown that stays above zero does not begin there",
    "NO_START": "the data give no start: state one",
    "NOT_CONNECTED": "no equation connects all unknowns, or they are more than 60: no case for consensus",
    "WORKSPACE_TOO_SMALL": "the workspace is smaller than the size that was asked for",
}
"""What a call answers, in order from 0; the first `ANSWERS` are answers, the others wrong data."""

UNSETTLED = "unknown noise still changed when the rounds that estimate it ran out: sigmas are those of the last round"
"""What the programs say beside an answer that is not `settled`."""

ANSWERS = 5


def header(blueprint: Blueprint) -> str:
    """``<problem>.h``."""
    name = blueprint.identifier
    lines = opened(name, _doc(blueprint), STATUSES)
    lines += ["/* What is given: columns of tables, one element per row, in SI. */", "typedef struct {"]
    for table in blueprint.tables:
        lines += table_fields(table)
    for unknown in blueprint.unknowns:
        lines.append(f"    const double *start_{unknown.identifier};    {_start(unknown)}")
    lines += [
        f"}} {name}_data;",
        "",
        "/* What is answered, in SI; `sigma` are standard deviations. */",
        "typedef struct {",
        *_result(blueprint),
        *_agreed(blueprint),
        *[line for unknown in blueprint.unknowns for line in _estimate(unknown)],
        *[line for derived in blueprint.derived for line in derived_fields(derived, once=derived.table is None)],
        f"}} {name}_result;",
        "",
        *_workspace(name),
        *_calls(name),
        *guarded("}"),
        "",
        "#endif",
        "",
    ]
    return "\n".join(lines)


def opened(name: str, doc: Iterable[Word], statuses: Iterable[str]) -> list[str]:
    """The lines with which the header ``<name>.h`` begins: what it is about, and what calls answer."""
    guard = f"{name.upper()}__H"  # two underscores in a row are in no name that a problem gives
    words = [f"    {name.upper()}_{word} = {number}" for number, word in enumerate(statuses)]
    return [
        *(f"#ifndef {guard}", f"#define {guard}", "", comment(doc), "", *guarded('extern "C" {'), ""),
        *("/* What a call answers; `_status_text` has the sentence. */", f"enum {name}_status {{"),
        *(",\n".join(words), "};", ""),
    ]


def guarded(line: str) -> tuple[str, ...]:
    """A line for C++ alone, where names are otherwise changed by the types of what they are called with."""
    return "#ifdef __cplusplus", line, "#endif"


def _doc(blueprint: Blueprint) -> Iterator[Word]:
    yield from (
        told(blueprint.name, ": ", blueprint.doc) if blueprint.doc else blueprint.name,
        "",
        f"Written by mbm {blueprint.version}. Everything is in SI, angles in radians. Calls share nothing but their",
        "arguments, so that threads may solve at the same time, each with a workspace of its own.",
    )


def table_fields(table: TableShape, absent: Mapping[Foreign, str] = MappingProxyType({})) -> Iterator[str]:
    """The fields of a struct for the rows and columns of a table; of some columns what it means if they are NULL."""
    yield f"    long {table.identifier}_rows;    {remark('rows of `', table.name, '`')}"
    for column in table.columns:
        kind = "const char *const *" if column.is_text else "const double *"
        unit = (", in the file in ", column.unit) if column.unit else ()
        said = remark("`", column.name, "`", *unit, absent.get(column.name, ""))
        yield f"    {kind}{table.identifier}_{column.identifier};    {said}"


def _start(unknown: UnknownShape) -> str:
    many = "" if unknown.family is None else " for each member"
    numbers = "a number" if unknown.size == 1 else f"{unknown.size} numbers"
    return remark("where ", unknown.name, f" begins: {numbers}{many}; NULL: as the README says")


def _result(blueprint: Blueprint) -> Iterator[str]:
    yield from (
        "    int status;",
        "    int settled;           /* 0: unknown noise still changed in the last round; sigmas are those of it */",
        "    long iterations, evaluations;",
        "    double cost;           /* weighted sum of squares, without losses */",
        "    double robust_cost;    /* the same with losses */",
        "    long freedom;          /* degrees of freedom */",
        "    double sigma0;         /* sqrt(cost / freedom); 0 without freedom */",
        "    long numbers;          /* N, numbers of all unknowns */",
    )
    turned = ", angles by any turns" if any(u.angles for u in blueprint.unknowns) else ""
    turned += ", quaternions of any sign" if any(u.quaternions for u in blueprint.unknowns) else ""
    yield from (
        f"    const double *point;   /* (N) the estimates, unknown after unknown, member after member{turned} */",
        "    long free;             /* n, estimated coordinates */",
        "    const long *coordinates;     /* (n) their places among all coordinates */",
        "    const double *covariance;    /* (n, n) row by row; NaN: not determined */",
        "    const double *sigmas;        /* of all coordinates; 0: it stays, negative: not determined, at a bound */",
    )


def _agreed(blueprint: Blueprint) -> Iterator[str]:
    if blueprint.agreement is not None and blueprint.agreement.kept:
        yield from (
            "    long units, inliers;   /* equations of rows that were looked at, and those that agree */",
            "    int ambiguous;         /* 1: another solution explains the data as well */",
            "    const long *inside;    /* (units) 1: it agrees; clause by clause, row by row, then by equation */",
        )


def _estimate(unknown: UnknownShape) -> Iterator[str]:
    doc = (": ", unknown.doc) if unknown.doc else ()
    if unknown.family is not None:
        yield from (
            f"    long {unknown.identifier}_members;",
            f"    const long *{unknown.identifier}_rows;    /* (members) the row of the table that names each */",
        )
    many = "" if unknown.family is None else "members × "
    what = remark(f"({many}{unknown.size}) {unknown.kind.value}", *doc, *_shown(unknown.unit))
    yield from (
        f"    const double *{unknown.identifier};          {what}",
        f"    const double *{unknown.identifier}_sigma;    /* ({many}{unknown.freedom}) */",
    )


def derived_fields(derived: DerivedShape, *, once: bool) -> Iterator[str]:
    """The fields of a quantity that has a value ``once``, or for rows of a table."""
    if not once:
        rows = remark("the rows of `", derived.table or "", "` that count")
        yield f"    long {derived.identifier}_rows;    {rows}"
    many = "" if once else "rows × "
    what = remark(f"({many}{derived.size}) derived", *_shown(derived.unit))
    yield from (
        f"    const double *{derived.identifier};          {what}",
        f"    const double *{derived.identifier}_sigma;    /* ({many}{derived.size}) */",
    )


def _shown(unit: Foreign) -> tuple[Word, ...]:
    return (", shown in ", unit) if unit else ()


def _workspace(name: str) -> list[str]:
    return [
        "/* Memory of the caller, of at least the sizes that `_workspace_size` gives; results point into it. */",
        "typedef struct {",
        "    double *reals;",
        "    long reals_size;",
        "    long *integers;",
        "    long integers_size;",
        f"}} {name}_workspace;",
        "",
    ]


def _calls(name: str) -> list[str]:
    return [
        "/* How much memory data of these numbers of rows need; only the counts of rows in `data` are read. */",
        f"void {name}_workspace_size(const {name}_data *data, {name}_workspace *workspace);",
        "",
        "/* Solves; the answer is also in `result->status`. Allocates nothing. */",
        f"int {name}_solve(const {name}_data *data, {name}_result *result, {name}_workspace *workspace);",
        "",
        "/* Prepares the equations without solving: `result` then has the start, and where everything stands. */",
        f"int {name}_begin(const {name}_data *data, {name}_result *result, {name}_workspace *workspace);",
        "",
        "/* How many residuals the data of the last `_begin` or `_solve` with this workspace have. */",
        f"long {name}_residual_count(const {name}_data *data, {name}_workspace *workspace);",
        "",
        "/* Whitened residuals (m) at a point (N), after `_begin` or `_solve` with the same data and workspace. */",
        f"void {name}_residuals(const {name}_data *data, const double *point, double *residuals,",
        f"    {name}_workspace *workspace);",
        "",
        "/* Their derivatives by the estimated coordinates (m, n), row by row; without losses. */",
        f"void {name}_jacobian(const {name}_data *data, const double *point, double *jacobian,",
        f"    {name}_workspace *workspace);",
        "",
        "/* The covariance (n, n) if `point` were the estimate and the noise as stated; 0: some of it is NaN. */",
        f"int {name}_covariance(const {name}_data *data, const double *point, double *covariance,",
        f"    {name}_workspace *workspace);",
        "",
        "/* What a status means. */",
        f"const char *{name}_status_text(int status);",
        "",
    ]
