"""Diagnostics of the problem stage: clauses, tables, units, and data that do not go with the equations."""

from __future__ import annotations

from mbm.text.suggest import closest
from mbm.text.types import Code, Diagnostic, Label, Place, Severity, Source, Span

NO_PROBLEM = Code(
    "no-problem", "The file defines no problem, so there is nothing to solve.", "Add `(problem name clause…)`."
)
SEVERAL_PROBLEMS = Code(
    "several-problems",
    "The file holds several problems and the call does not say which one is meant.",
    "Name one with `--problem NAME`.",
)
UNKNOWN_PROBLEM = Code("unknown-problem", "No problem of this name is in the file.", "Correct the name.")
UNKNOWN_CLAUSE = Code(
    "unknown-clause", "A problem holds a clause that the language does not know.", "Correct its head."
)
UNKNOWN_TABLE = Code("unknown-table", "A name stands where a table is wanted.", "Declare it with a `data` clause.")
UNKNOWN_COLUMN = Code("unknown-column", "A table has no column of this name.", "Correct the name.")
UNKNOWN_SOURCE = Code(
    "unknown-source",
    "A data clause names a kind of file nobody reads.",
    "Use `csv`, `tsv`, `json`, `npz`, `table` or `external`.",
)
UNKNOWN_TYPE = Code(
    "unknown-type", "An unknown has a type that the language does not know.", "Use one of the types of the manual."
)
UNKNOWN_METHOD = Code("unknown-method", "`:method` names no solver.", "Use `auto`, `lm`, `dogleg` or `gauss-newton`.")
UNKNOWN_OVERRIDE = Code(
    "unknown-override",
    "A constant or start is given from outside, but the problem has no constant or unknown of that name.",
    "Correct the name.",
)
NO_UNKNOWNS = Code("no-unknowns", "The problem has nothing to estimate.", "Add `(unknowns (name …)…)`.")
NO_EQUATIONS = Code("no-equations", "The problem has neither observations nor priors.", "Add an `observe` clause.")
TOO_MANY_STATIC_VALUES = Code(
    "too-many-static-values",
    "A column decides what the equations are, and it has more distinct values than can be compiled.",
    "Use the column as a family's key or as a number, which costs nothing.",
)
DEPENDS_ON_UNKNOWN = Code(
    "depends-on-unknown",
    "A weight, start, bound or filter has to be known before the solve, but its form holds an unknown.",
    "Use columns, constants and numbers only.",
)
PRIOR_WITHOUT_INIT = Code(
    "prior-without-init",
    "`:sigma` of an unknown is a prior about its `:init`, which is missing.",
    "Add `:init`, or use `(constraints (normal NAME mean sigma))`.",
)
TWO_NOISES = Code(
    "two-noises", "Only one of `:sigma`, `:covariance` and `:information` may be given.", "Keep one of them."
)
UNEQUAL_SIDES = Code(
    "unequal-sides", "The two sides of an equation are different kinds of thing.", "Make them of one length."
)
UNEQUAL_BRANCHES = Code(
    "unequal-branches",
    "The branches of a condition (or the rows of a table) give results of different lengths.",
    "Make them of one length.",
)
CONDITION_AS_EQUATION = Code(
    "condition-as-equation",
    "A truth value stands where something that should be zero is wanted.",
    "Write `(= MEASURED MODEL)` at the top of `observe`; inequalities belong into `constraints`.",
)
UNIT_CLASH = Code(
    "unit-clash",
    "Two known dimensions that should be one are different: a length plus a time, a column used as both.",
    "Correct a unit, or convert.",
)
MIXED_UNITS = Code(
    "mixed-units",
    "The cells of an inline table state different units for one column, or its unit is stated twice.",
    "Give all cells of a column units of one dimension, or none and `:columns ((column :unit u))`.",
)
MISSING_UNIT = Code(
    "missing-unit",
    "With `--strict-units`, every column and every unknown states its unit; this one does not.",
    "Add `:unit`.",
)
DANGLING_KEY = Code(
    "dangling-key",
    "A cell should be the key of a row of another table, or of a member of a family, but no such key exists.",
    "Correct the cell, or add the row.",
)
NOT_FINITE_CELL = Code(
    "not-finite-cell",
    "A cell that an equation uses is empty, NaN or infinite.",
    "Correct it; leave such rows out with `:when (finite column)` or `:missing skip`.",
)
NO_ROWS = Code(
    "no-rows", "An observation has no rows to use, so it says nothing (a warning).", "Look at the data and at `:when`."
)
BAD_NOISE = Code(
    "bad-noise",
    "A standard deviation is not positive, or a covariance matrix is not symmetric and positive definite.",
    "Correct the form or the cell.",
)
BAD_BOUNDS = Code("bad-bounds", "A lower bound is not below the upper bound.", "Exchange or widen them.")
MISSING_START = Code(
    "missing-start",
    "An unknown enters the equations nonlinearly and has neither `:init` nor `:in`; this version finds starts "
    "for unknowns that enter linearly only.",
    "Give `:init`, or a range `:in (lo hi)`, whose middle is taken.",
)
UNMENTIONED = Code(
    "unmentioned",
    "No equation mentions an unknown, so nothing can be said about it (a warning).",
    "Use it in an equation, give it a prior with `:sigma`, or remove it.",
)
TOO_FEW_EQUATIONS = Code(
    "too-few-equations",
    "The structure of the equations cannot determine all unknowns, whatever the numbers are (a warning).",
    "Add observations or priors, or fix an unknown.",
)
TABLE_WITHOUT_KEY = Code(
    "table-without-key",
    "Rows of a table are to be found by their key (by `:with`, or as members of a family), but the table has none.",
    "Add `:key column` to its data clause; a family may also range over a column: `:per table.column`.",
)
DERIVED_ELSEWHERE = Code(
    "derived-elsewhere",
    "A quantity that is derived for each row of a table is used where there is no row of that table.",
    "Use it in quantities that are `:over` the same table.",
)
UNKNOWN_BACKEND = Code(
    "unknown-backend", "`--backend` names nothing that evaluates equations here.", "Use `auto`, `casadi` or `numpy`."
)


def unmentioned(span: Span, name: str) -> Diagnostic:
    """An unknown without an equation."""
    return Diagnostic(
        code=UNMENTIONED, message=f"no equation mentions the unknown `{name}`", place=span, severity=Severity.WARNING,
        hint="use it in an equation, give it a prior with `:sigma`, or remove it",
    )  # fmt: skip


def too_few_equations(span: Span, name: str, equations: int, unknowns: int) -> Diagnostic:
    """An unknown that the structure leaves over."""
    return Diagnostic(
        code=TOO_FEW_EQUATIONS,
        message=f"`{name}` has no equation of its own: {_counted(equations, 'scalar equation')}, "
        f"{_counted(unknowns, 'scalar unknown')}",
        place=span, severity=Severity.WARNING, hint="add observations or priors, or fix an unknown",
    )  # fmt: skip


def table_without_key(span: Span, table: str) -> Diagnostic:
    """Rows that cannot be named."""
    return Diagnostic(
        code=TABLE_WITHOUT_KEY, message=f"the table `{table}` has no key to find its rows by", place=span,
        hint=f"add `:key column` to `(data {table} …)`",
    )  # fmt: skip


def derived_elsewhere(span: Span, name: str, table: str) -> Diagnostic:
    """A value per row where there is no row."""
    return Diagnostic(
        code=DERIVED_ELSEWHERE, message=f"`{name}` is derived for each row of `{table}`; there is no such row here",
        place=span, hint=f"use it in quantities with `:over {table}`",
    )  # fmt: skip


def unknown_backend(name: str, known: tuple[str, ...]) -> Diagnostic:
    """A backend that is not there."""
    return Diagnostic(
        code=UNKNOWN_BACKEND, message=f"there is no backend `{name}`", hint=f"the backends are {_listed(known)}"
    )


def no_problem(source: Source) -> Diagnostic:
    """A file without a problem."""
    return Diagnostic(
        code=NO_PROBLEM, message="this file defines no problem",
        place=Span(source=source, start=0, end=0), hint="add `(problem name clause…)`",
    )  # fmt: skip


def several_problems(names: tuple[str, ...]) -> Diagnostic:
    """A choice is wanted."""
    return Diagnostic(
        code=SEVERAL_PROBLEMS, message=f"the file holds {len(names)} problems: {_listed(names)}",
        hint=f"choose one with `--problem {names[0]}`",
    )  # fmt: skip


def unknown_problem(name: str, names: tuple[str, ...], near: str | None) -> Diagnostic:
    """A choice that is none."""
    hint = f"did you mean `{near}`?" if near else f"the file holds {_listed(names)}" if names else None
    return Diagnostic(code=UNKNOWN_PROBLEM, message=f"there is no problem `{name}` in this file", hint=hint)


def unknown_clause(span: Span, head: str, near: str | None, known: tuple[str, ...]) -> Diagnostic:
    """A clause nobody knows."""
    hint = f"did you mean `{near}`?" if near else f"the clauses are {_listed(known)}"
    return Diagnostic(code=UNKNOWN_CLAUSE, message=f"`{head}` is no clause of a problem", place=span, hint=hint)


def unknown_table(span: Span, name: str, known: tuple[str, ...]) -> Diagnostic:
    """A table nobody declared."""
    near = closest(name, known)
    hint = f"did you mean `{near}`?" if near else f"the tables are {_listed(known)}" if known else "add a `data` clause"
    return Diagnostic(code=UNKNOWN_TABLE, message=f"`{name}` is no table of this problem", place=span, hint=hint)


def unknown_column(span: Span, name: str, table: str, known: tuple[str, ...]) -> Diagnostic:
    """A column that is not there."""
    near = closest(name, known)
    hint = f"did you mean `{near}`?" if near else f"its columns are {_listed(known)}"
    return Diagnostic(code=UNKNOWN_COLUMN, message=f"`{name}` is no column of {_quoted(table)}", place=span, hint=hint)


def _quoted(table: str) -> str:
    return table if " " in table else f"`{table}`"


def unknown_source(span: Span, name: str, near: str | None) -> Diagnostic:
    """A kind of data nobody reads."""
    hint = f"did you mean `{near}`?" if near else 'for example `(csv "path")`'
    return Diagnostic(code=UNKNOWN_SOURCE, message=f"`{name}` is no source of data", place=span, hint=hint)


def unknown_type(span: Span, name: str, near: str | None, known: tuple[str, ...]) -> Diagnostic:
    """A type nobody knows."""
    hint = f"did you mean `{near}`?" if near else f"the types are {_listed(known)}"
    return Diagnostic(code=UNKNOWN_TYPE, message=f"`{name}` is no type of unknown", place=span, hint=hint)


def unknown_method(span: Span | None, name: str, near: str | None, known: tuple[str, ...]) -> Diagnostic:
    """A solver nobody knows."""
    hint = f"did you mean `{near}`?" if near else f"the solvers are {_listed(known)}"
    return Diagnostic(code=UNKNOWN_METHOD, message=f"`{name}` is no solver", place=span, hint=hint)


def unknown_override(name: str, known: tuple[str, ...]) -> Diagnostic:
    """A value for a name that takes none."""
    near = closest(name, known)
    hint = f"did you mean `{near}`?" if near else f"values can be given for {_listed(known)}" if known else None
    return Diagnostic(
        code=UNKNOWN_OVERRIDE, message=f"the problem has no constant or unknown `{name}` to set", hint=hint
    )


def bad_override(name: str, message: str) -> Diagnostic:
    """A value that does not fit its name."""
    return Diagnostic(code=UNKNOWN_OVERRIDE, message=f"the value given for `{name}` {message}")


def no_unknowns(span: Span) -> Diagnostic:
    """Nothing to estimate."""
    return Diagnostic(
        code=NO_UNKNOWNS, message="this problem has no unknowns", place=span, hint="add `(unknowns (x)…)`"
    )


def no_equations(span: Span) -> Diagnostic:
    """Nothing measured."""
    return Diagnostic(
        code=NO_EQUATIONS, message="this problem has neither observations nor priors", place=span,
        hint="add `(observe table (= measured model))`",
    )  # fmt: skip


def too_many_static_values(span: Span, table: str, limit: int) -> Diagnostic:
    """More groups of rows than can be compiled."""
    return Diagnostic(
        code=TOO_MANY_STATIC_VALUES,
        message=f"the rows of `{table}` fall into more than {limit} groups that each need their own equations",
        place=span, hint="use the column as a family's key or as a number",
    )  # fmt: skip


def depends_on_unknown(span: Span, wanted: str, unknown: str) -> Diagnostic:
    """An unknown where none may be."""
    return Diagnostic(
        code=DEPENDS_ON_UNKNOWN, message=f"{wanted} must be known before the solve, but holds the unknown `{unknown}`",
        place=span, hint="use columns, constants and numbers only",
    )  # fmt: skip


def prior_without_init(span: Span, name: str, option: str) -> Diagnostic:
    """A prior about nothing."""
    return Diagnostic(
        code=PRIOR_WITHOUT_INIT, message=f"`:{option}` makes a prior about `:init` of `{name}`, which is missing",
        place=span, hint=f"add `:init`, or write `(constraints (normal {name} mean sigma))`",
    )  # fmt: skip


def two_noises(span: Span) -> Diagnostic:
    """Two statements of one noise."""
    return Diagnostic(code=TWO_NOISES, message="the noise is stated twice", place=span, hint="keep one option")


def unequal_sides(span: Span, measured: str, model: str) -> Diagnostic:
    """Sides that cannot be subtracted."""
    return Diagnostic(
        code=UNEQUAL_SIDES, message=f"the measured side is {measured}, the model is {model}", place=span,
        hint="both sides must be numbers, or vectors of one length",
    )  # fmt: skip


def unequal_branches(span: Span) -> Diagnostic:
    """Branches of different lengths."""
    return Diagnostic(
        code=UNEQUAL_BRANCHES, message="the branches (or rows) give results of different lengths", place=span
    )


def condition_as_equation(span: Span) -> Diagnostic:
    """A truth value as an equation."""
    return Diagnostic(
        code=CONDITION_AS_EQUATION, message="this is true or false; an equation needs something that should be zero",
        place=span, hint="write `(= measured model)`; inequalities belong into `constraints`",
    )  # fmt: skip


def unit_clash(span: Span | None, left: str, right: str, labels: tuple[Label, ...]) -> Diagnostic:
    """Two dimensions that should be one."""
    return Diagnostic(
        code=UNIT_CLASH, message=f"{left} does not go with {right}", place=span, labels=labels,
        hint="correct a unit, or convert",
    )  # fmt: skip


def mixed_units(span: Span, column: str, other: Span) -> Diagnostic:
    """A column with two units."""
    return Diagnostic(
        code=MIXED_UNITS, message=f"the unit of column `{column}` is stated twice, or differently", place=span,
        labels=(Label(other, "stated here"),), hint="state it once",
    )  # fmt: skip


def impure(span: Span | None, what: str, labels: tuple[Label, ...]) -> Diagnostic:
    """A dimension where a pure number is wanted: in a sine, as an exponent."""
    return Diagnostic(
        code=UNIT_CLASH, message=f"{what} stands where a pure number is wanted", place=span, labels=labels,
        hint="divide by something of the same dimension",
    )  # fmt: skip


def missing_unit(span: Span | None, what: str) -> Diagnostic:
    """A unit that strictness asks for."""
    return Diagnostic(code=MISSING_UNIT, message=f"{what} states no unit", place=span, hint="add `:unit`")


def dangling_key(place: Place, cell: str | float, where: str, near: str | None, used: Span | None) -> Diagnostic:
    """A key without a row."""
    shown = f"`{cell}`" if isinstance(cell, str) else f"{cell:g}"
    return Diagnostic(
        code=DANGLING_KEY, message=f"{shown} is no key of {where}", place=place,
        hint=f"did you mean `{near}`?" if near else None,
        labels=(Label(used, "used as a key here"),) if used is not None else (),
    )  # fmt: skip


def not_finite_cell(place: Place, column: str, value: float, used: Span | None) -> Diagnostic:
    """A gap in what an equation uses."""
    what = "empty or not a number" if value != value else "infinite"
    return Diagnostic(
        code=NOT_FINITE_CELL, message=f"a cell of `{column}` that is used is {what}", place=place,
        hint=f"correct it, or leave such rows out with `:when (finite {column})` or `:missing skip`",
        labels=(Label(used, "used here"),) if used is not None else (),
    )  # fmt: skip


def undecided(span: Span) -> Diagnostic:
    """A condition that a missing number leaves open."""
    return Diagnostic(
        code=NOT_FINITE_CELL, message="this condition depends on a number that is missing", place=span,
        hint="ask with `(finite column)` whether it is there",
    )  # fmt: skip


def two_tables(span: Span, model: str, tables: tuple[str, ...]) -> Diagnostic:
    """A model whose arguments come from rows of different tables."""
    return Diagnostic(
        code=UNEQUAL_BRANCHES, message=f"the arguments of `{model}` come from rows of {_listed(tables)}", place=span,
        hint="its constraints can hold for each row of one table only; write them into the problem's `constraints`",
    )  # fmt: skip


def start_not_positive(span: Span, name: str) -> Diagnostic:
    """A start that the type forbids."""
    return Diagnostic(
        code=BAD_BOUNDS, message=f"`{name}` is positive, but its start is not above zero", place=span,
        hint="give a start above zero, or the type `real`",
    )  # fmt: skip


def no_rows(span: Span, name: str) -> Diagnostic:
    """An observation of nothing."""
    return Diagnostic(
        code=NO_ROWS, message=f"the observation `{name}` has no rows to use", place=span, severity=Severity.WARNING,
        hint="look at the data, and at `:when` and `:where`",
    )  # fmt: skip


def bad_noise(span: Span, what: str, place: Place | None) -> Diagnostic:
    """A weight that is none."""
    labels = (Label(place, "for this row"),) if place is not None else ()
    hint = "a sigma is a number above zero; covariance and information are symmetric and positive definite"
    return Diagnostic(code=BAD_NOISE, message=what, place=span, labels=labels, hint=hint)


def bad_bounds(span: Span, name: str) -> Diagnostic:
    """Bounds the wrong way round."""
    return Diagnostic(code=BAD_BOUNDS, message=f"the lower bound of `{name}` is not below its upper bound", place=span)


def missing_start(span: Span, name: str) -> Diagnostic:
    """A start that this version cannot find."""
    return Diagnostic(
        code=MISSING_START, message=f"`{name}` has no start, and it enters the equations nonlinearly", place=span,
        hint="give `:init`, or a range `:in (lo hi)`, whose middle is taken",
    )  # fmt: skip


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _listed(names: tuple[str, ...]) -> str:
    shown = [f"`{n}`" for n in names[:8]]
    return ", ".join(shown) + (" …" if len(names) > 8 else "")
