"""Diagnostics of the clauses: what a problem may say wrongly before any data are looked at."""

from __future__ import annotations

from mbm.expression.nodes import External, Outlined
from mbm.expression.units import parse_unit
from mbm.language.limits import more_work
from mbm.solver.description import RULES
from mbm.solver.losses import LOSSES
from mbm.text.suggest import listed, suggestion
from mbm.text.types import Code, Diagnostic, Label, Place, Source, Span

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
UNION_OF_CHOSEN_ROWS = Code(
    "union-of-chosen-rows",
    "A union takes a table with `:where` or `:with`. A union has the rows and columns that its tables have as they are"
    " read, so the option would do nothing there.",
    "Move the option to the data clause of the union.",
)
UNKNOWN_COLUMN = Code("unknown-column", "A table has no column of this name.", "Correct the name.")
UNKNOWN_SOURCE = Code(
    "unknown-source",
    "A data clause names a kind of file nobody reads.",
    "Use `csv`, `tsv`, `json`, `npz`, `table` or `external`.",
)
UNKNOWN_TYPE = Code(
    "unknown-type", "An unknown has a type that the language does not know.", "Use one of the types of the manual."
)
_RULES = [f"`{rule}`" for rule in RULES]
UNKNOWN_METHOD = Code(
    "unknown-method", "`:method` names no solver.", f"Use `auto`, {', '.join(_RULES[:-1])} or {_RULES[-1]}."
)
NO_UNKNOWNS = Code("no-unknowns", "The problem estimates and derives nothing.", "Add `(unknowns (name …)…)`.")
NO_EQUATIONS = Code("no-equations", "The problem has neither observations nor priors.", "Add an `observe` clause.")
TOO_MANY_STATIC_VALUES = Code(
    "too-many-static-values",
    "A column decides what the equations are, and it has more distinct values than can be compiled.",
    "Use the column as a family's key or as a number, which costs nothing, or let mbm take longer: `MBM_WORK=4 mbm"
    " solve …` allows four times as many.",
)
TOO_MUCH_TO_COMPILE = Code(
    "too-much-to-compile",
    "The problem writes out more equations, or longer ones, than are derived and compiled for one problem.",
    "Put what is repeated into a table: `(observe TABLE …)`, `:over TABLE` and `:per TABLE` hold for all of its rows"
    " and are compiled once. Or let mbm take longer: `MBM_WORK=4 mbm solve …` allows four times as much.",
)
DEPENDS_ON_UNKNOWN = Code(
    "depends-on-unknown",
    "A weight, start, bound or filter has to be known before the solve, but its form holds an unknown.",
    "Use columns, constants and numbers only.",
)
EXTERNAL_MISPLACED = Code(
    "external-misplaced",
    "A function in Python stands in a weight, start, bound or filter, which has to be known before the solve.",
    "Call it in an equation, a constraint or a derived quantity; give the table a column with what it gives here.",
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
EMPTY_EQUATION = Code(
    "empty-equation",
    "An equation compares vectors of no numbers, so that it says nothing.",
    "Remove it, or look where the list or vector in it lost its elements.",
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
UNKNOWN_BACKEND = Code(
    "unknown-backend",
    "`--backend` names nothing that evaluates equations here.",
    "Use `auto`, `native`, `casadi` or `numpy`.",
)
NATIVE_UNAVAILABLE = Code(
    "native-unavailable",
    "`--backend native` was asked for, and this installation can make no machine code.",
    "The message says why: llvmlite is missing, too old or does not work, or memory may not be executed. Install it "
    "(`pip install --force-reinstall llvmlite`), or use `auto`, which takes what there is.",
)


_LOSSES = [f"`({kind} a c)`" if traits.shaped else f"`{kind}`" for kind, traits in LOSSES.items()]
UNKNOWN_LOSS = Code(
    "unknown-loss",
    "`:loss` names no robust loss.",
    f"Use `none`, {', '.join(_LOSSES[:-1])} or {_LOSSES[-1]}.",
)
UNKNOWN_CONSENSUS = Code(
    "unknown-consensus",
    "`:robust` names no way to find the measurements that agree.",
    "Use `none`, `lmeds`, `ransac`, `msac` or `gnc`.",
)
CONTRADICTION = Code(
    "contradiction",
    "A constraint holds no unknown, so it is decided before the solve; and it does not hold.",
    "Correct its numbers or the cells that it uses, or remove it.",
)


def unknown_backend(name: str, known: tuple[str, ...]) -> Diagnostic:
    """A backend that is not there."""
    return Diagnostic(
        code=UNKNOWN_BACKEND, message=f"there is no backend `{name}`", hint=f"the backends are {listed(known)}"
    )


def native_unavailable(reason: str) -> Diagnostic:
    """Machine code was asked for where none can be made."""
    return Diagnostic(
        code=NATIVE_UNAVAILABLE,
        message=f"no machine code can be made here: {reason}",
        hint="install llvmlite anew (`pip install --force-reinstall llvmlite`), or leave `--backend` at `auto`",
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
        code=SEVERAL_PROBLEMS, message=f"the file holds {len(names)} problems: {listed(names)}",
        hint=f"choose one with `--problem {names[0]}`",
    )  # fmt: skip


def unknown_problem(name: str, names: tuple[str, ...]) -> Diagnostic:
    """A choice that is none."""
    return Diagnostic(
        code=UNKNOWN_PROBLEM,
        message=f"there is no problem `{name}` in this file",
        hint=suggestion(name, names, f"the file holds {listed(names)}" if names else None),
    )


def unknown_clause(span: Span, head: str, mend: str | None) -> Diagnostic:
    """A clause nobody knows."""
    return Diagnostic(
        code=UNKNOWN_CLAUSE,
        message=f"`{head}` is no clause of a problem",
        place=span,
        hint=mend,
    )


def unknown_table(span: Span, name: str, known: tuple[str, ...]) -> Diagnostic:
    """A table nobody declared."""
    return Diagnostic(
        code=UNKNOWN_TABLE,
        message=f"`{name}` is no table of this problem",
        place=span,
        hint=suggestion(name, known, f"the tables are {listed(known)}" if known else "add a `data` clause"),
    )


def union_of_chosen_rows(span: Span, name: str, option: str, union: str) -> Diagnostic:
    """A member of the table ``union`` has ``option``, which acts after the union is made."""
    return Diagnostic(
        code=UNION_OF_CHOSEN_ROWS, message=f"`{name}` has `{option}`, but `{union}` takes it as it is read",
        place=span, hint=f"write `{option}` into the clause of `{union}`",
    )  # fmt: skip


def unknown_column(span: Span, name: str, table: str, known: tuple[str, ...]) -> Diagnostic:
    """A column that is not there."""
    return Diagnostic(
        code=UNKNOWN_COLUMN,
        message=f"`{name}` is no column of {table if ' ' in table else f'`{table}`'}",
        place=span,
        hint=suggestion(name, known, f"its columns are {listed(known)}"),
    )


def unknown_source(span: Span, name: str, known: tuple[str, ...]) -> Diagnostic:
    """A kind of data nobody reads."""
    return Diagnostic(
        code=UNKNOWN_SOURCE,
        message=f"`{name}` is no source of data",
        place=span,
        hint=suggestion(name, known, 'for example `(csv "path")`'),
    )


def unknown_type(span: Span, name: str, known: tuple[str, ...]) -> Diagnostic:
    """A type nobody knows."""
    hint = suggestion(name, known, f"the types are {listed(known)}")
    if parse_unit(name) is not None:
        hint = f"`{name}` is a unit: write `:unit {name}`"
    return Diagnostic(code=UNKNOWN_TYPE, message=f"`{name}` is no type of unknown", place=span, hint=hint)


def unknown_method(span: Span | None, name: str, known: tuple[str, ...]) -> Diagnostic:
    """A solver nobody knows."""
    return Diagnostic(
        code=UNKNOWN_METHOD,
        message=f"`{name}` is no solver",
        place=span,
        hint=suggestion(name, known, f"the solvers are {', '.join(f'`{each}`' for each in known)}"),
    )


def no_unknowns(span: Span) -> Diagnostic:
    """Nothing to estimate, and nothing to compute either."""
    message = "this problem has no unknowns, derives nothing and observes nothing"
    hint = "add `(unknowns (x)…)`, or `(derive (q form)…)` of constants"
    return Diagnostic(code=NO_UNKNOWNS, message=message, place=span, hint=hint)


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
        place=span, hint=f"use the column as a family's key or as a number, or allow more, by `{more_work()}`",
    )  # fmt: skip


def too_many_equations(span: Span, limit: int) -> Diagnostic:
    """More equations that are compiled one by one than may be."""
    return Diagnostic(
        code=TOO_MUCH_TO_COMPILE,
        message=f"up to here the problem has more than {limit:,} equations that are each compiled", place=span,
        hint=f"put what is repeated into a table: its rows share one equation; or allow more, by `{more_work()}`",
    )  # fmt: skip


def too_many_operations(span: Span, limit: int) -> Diagnostic:
    """More operations in all equations than may be."""
    return Diagnostic(
        code=TOO_MUCH_TO_COMPILE,
        message=f"up to here the equations of the problem hold more than {limit:,} operations", place=span,
        hint=f"put what is repeated into a table: its rows share one equation; or allow more, by `{more_work()}`",
    )  # fmt: skip


def depends_on_unknown(span: Span, wanted: str, unknown: str) -> Diagnostic:
    """An unknown where none may be; noise of unknown size beside a stated one is an unknown deviation of each row."""
    message = f"{wanted} must be known before the solve, but holds the unknown `{unknown}`"
    hint = "use columns, constants, numbers"
    if wanted == "`:sigma`":
        hint = (
            "use `unknown`, `model`, columns, constants, numbers; scatter of unknown size beside what is stated (dark "
            "uncertainty) is an unknown for each row, `(deviation :per TABLE :init 0)`, that is added to the model, "
            "and `(observe dark TABLE (= 0 (deviation KEY)) :sigma unknown)`"
        )
    return Diagnostic(code=DEPENDS_ON_UNKNOWN, message=message, place=span, hint=hint)


def external_misplaced(external: External | Outlined, wanted: str) -> Diagnostic:
    """A function in Python, or what is read off an outline, where only a table may decide."""
    what = "calls a function in Python" if isinstance(external, External) else "measures a silhouette"
    message, hint = f"{wanted} must be known before the solve, but {what}", "give the table a column with its values"
    return Diagnostic(code=EXTERNAL_MISPLACED, message=message, place=external.span, hint=hint)


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


def empty_equation(span: Span) -> Diagnostic:
    """An equation without components."""
    return Diagnostic(
        code=EMPTY_EQUATION,
        message="the equation compares no numbers: its vectors are empty",
        place=span,
        hint="remove it, or look where the vector lost its elements",
    )


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


def two_tables(span: Span, model: str, tables: tuple[str, ...]) -> Diagnostic:
    """A model whose arguments come from rows of different tables."""
    return Diagnostic(
        code=UNEQUAL_BRANCHES, message=f"the arguments of `{model}` come from rows of {listed(tables)}", place=span,
        hint="its constraints can hold for each row of one table only; write them into the problem's `constraints`",
    )  # fmt: skip


def unknown_loss(span: Span, name: str, known: tuple[str, ...]) -> Diagnostic:
    """A loss nobody knows."""
    return Diagnostic(
        code=UNKNOWN_LOSS,
        message=f"`{name}` is no loss",
        place=span,
        hint=suggestion(name, known, f"the losses are {listed(known)}"),
    )


def unknown_consensus(span: Span, name: str, known: tuple[str, ...]) -> Diagnostic:
    """A consensus estimator nobody knows."""
    return Diagnostic(
        code=UNKNOWN_CONSENSUS,
        message=f"`{name}` is no consensus estimator",
        place=span,
        hint=suggestion(name, known, f"they are {listed(known)}"),
    )


def contradiction(
    span: Span, sides: tuple[float, float], sign: str, place: Place | None, uncertain: tuple[str, ...] = ()
) -> Diagnostic:
    """A constraint between known numbers that is false; ``place`` is the row of data that makes it so.

    Of the ``uncertain`` constants in it the values count.
    """
    named = ", ".join(f"`{name}`" for name in uncertain)
    mend = f"; a constant is not adjusted: make {named} an unknown with a prior, `(NAME :init VALUE :sigma SIGMA)`"
    return Diagnostic(
        code=CONTRADICTION,
        message=f"this constraint never holds: {sides[0]:g} {sign} {sides[1]:g} is false",
        place=span,
        labels=(Label(place, "for this row"),) if place is not None else (),
        hint=f"correct the numbers, or remove it{mend if uncertain else ''}",
    )
