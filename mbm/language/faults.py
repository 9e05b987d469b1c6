"""Diagnostics of the language: what may be wrong with a form, wherever it stands."""

from __future__ import annotations

from dataclasses import replace

from mbm.expression.units import parse_unit
from mbm.text.faults import shown
from mbm.text.suggest import did_you_mean, for_a_number, is_number, suggestion
from mbm.text.types import Code, Diagnostic, Label, Place, Severity, Span

UNKNOWN_NAME = Code(
    "unknown-name",
    "A name is used that is no function, model, variable, column or unknown where it stands.",
    "Correct the spelling, or define the name. Subtraction and division are written `(- x)`, `(/ x 2)`.",
)
NOT_AVAILABLE_YET = Code(
    "not-available-yet",
    "The form belongs to the language, but this version does not build it yet. It is refused rather than ignored.",
    "Leave it out, or wait for the version that brings it.",
)
UNKNOWN_UNIT = Code(
    "unknown-unit",
    "What is stuck to a number, or stated with `:unit`, is not on the closed list of units.",
    "Use a unit of the list in the manual, write a space between number and name, or convert the values.",
)
UNDEFINED_VALUE = Code(
    "undefined-value",
    "A constant expression has no finite value: division by zero, a logarithm of a negative number, an overflow.",
    "Correct the numbers.",
)
WRONG_KIND = Code(
    "wrong-kind",
    "A value of one kind stands where another is wanted: a vector for a number, a text for a rotation.",
    "Give what the form asks for.",
)
WRONG_ARITY = Code(
    "wrong-arity",
    "A function or form is given too few or too many arguments.",
    "Compare with its usage line.",
)
LENGTH_CLASH = Code(
    "length-clash",
    "Vectors or matrices of different lengths meet where one length is wanted.",
    "Make the lengths agree; a scalar goes with any length.",
)
BAD_HEAD = Code(
    "bad-head",
    "A list begins with something that can neither be called, indexed, nor be the first number of a vector.",
    "Put a function in front, or quote the list.",
)
BAD_INDEX = Code(
    "bad-index",
    "An index is no whole number, is outside the vector, or a key is not in the family.",
    "Indices count from 1; keys are the values of the family's key column.",
)
NOT_STATIC = Code(
    "not-static",
    "The compiler needs the value here (an index, a range, a part's name), but it depends on an unknown.",
    "Use a number, a constant or a data column.",
)
NOT_A_CONDITION = Code(
    "not-a-condition",
    "`if`, `cond`, `:when` and `:where` want a comparison; there is no truth in numbers.",
    "Compare: `(> x 0)`.",
)
BAD_FORM = Code(
    "bad-form",
    "A special form or a definition is not built as the language says.",
    "Compare with its usage line.",
)
DUPLICATE_DEFINITION = Code(
    "duplicate-definition",
    "One name is defined twice, in this file or in the files it uses.",
    "Rename or remove one of them.",
)
CIRCULAR_DEFINITION = Code(
    "circular-definition",
    "Something is defined by itself, directly or through other definitions.",
    "Break the circle.",
)
CIRCULAR_USE = Code(
    "circular-use",
    "Files use one another in a circle.",
    "Move what both need into a third file.",
)
TOO_DEEP = Code(
    "too-deep",
    "Evaluation went deeper than the limit: most likely a recursion that never ends.",
    "Give the recursion an end, or use `reduce`.",
)
TOO_MANY_STEPS = Code(
    "too-many-steps",
    "Evaluation took more steps than the limit: most likely a loop over far too many values.",
    "Put the repetition into a data table: rows cost nothing to compile.",
)
BAD_WORK_BOUND = Code(
    "bad-work-bound",
    "The environment variable `MBM_WORK` says how many times as much as usual may be written out, and holds something"
    " else.",
    "Write a number, such as `MBM_WORK=4`.",
)
LIST_TOO_LONG = Code(
    "list-too-long",
    "A list, vector or range is longer than the limit.",
    "Put the values into a data table.",
)
AMBIGUOUS_NAME = Code(
    "ambiguous-name",
    "A plain name is both a column of the table and an unknown, a state or a constant.",
    "Write the qualified name `table.column`, or rename one of them.",
)
TEXT_IN_NUMBER_COLUMN = Code(
    "text-in-number-column",
    "A column is used as numbers, but a cell is text; so the whole column is text.",
    "Correct the cell; leave it empty and use `:missing skip` or `:when (finite …)` if the value is missing.",
)
OUTSIDE_SANDBOX = Code(
    "outside-sandbox",
    "With `--sandbox DIR`, no file outside DIR is read; this path leads out of it.",
    "Move the file into the folder, or run without the sandbox.",
)
DEFAULT_FOCAL_LENGTH = Code(
    "default-focal-length",
    "`perse` takes k0 and k1 from the problem's constants or unknowns; where there are none it takes 1 (a warning).",
    "State `(constants (k0 …) (k1 …))`, or use a `camera` and `project`.",
)


def default_focal_length(span: Span, name: str) -> Diagnostic:
    """``perse`` without k0 or k1."""
    return Diagnostic(
        code=DEFAULT_FOCAL_LENGTH, message=f"the problem has no `{name}`; `perse` takes 1", place=span,
        hint=f"state it: `(constants ({name} …))`", severity=Severity.WARNING,
    )  # fmt: skip


def infix(span: Span, name: str, operator: str, operands: tuple[str, ...]) -> Diagnostic:
    """A name that is arithmetic as other languages write it: ``-x``, ``x/2``."""
    return Diagnostic(
        code=UNKNOWN_NAME, message=f"`{name}` is read as one name, and it is not a variable or a function here", place=span,
        hint=f"write `({operator} {' '.join(operands)})`",
    )  # fmt: skip


def unknown_name(
    span: Span, name: str, near: str | None, known: str | None = None, *, is_head: bool = False
) -> Diagnostic:
    """A name nobody knows, with the nearest one that is known, else what is ``known`` there."""
    what = "a function, a model or a variable here" if is_head else "a variable or a function here"
    return Diagnostic(code=UNKNOWN_NAME, message=f"`{name}` is not {what}", place=span, hint=did_you_mean(near, known))


def not_available_yet(span: Span | None, what: str, topic: str) -> Diagnostic:
    """A form of the language that this version does not build."""
    return Diagnostic(
        code=NOT_AVAILABLE_YET, message=f"{what} is not available yet ({topic})", place=span,
        hint="it belongs to the language and comes with a later version",
    )  # fmt: skip


def unknown_unit(span: Span, unit: str, refusal: str | None) -> Diagnostic:
    """A unit that is not on the list, or is refused for a reason."""
    if refusal:
        return Diagnostic(code=UNKNOWN_UNIT, message=f"`{unit}` cannot be used as a unit", place=span, hint=refusal)
    hint = "the known units are listed in the manual; names need a space between them and a number"
    return Diagnostic(code=UNKNOWN_UNIT, message=f"`{unit}` is not a known unit", place=span, hint=hint)


def undefined_value(span: Span, text: str) -> Diagnostic:
    """A constant expression without a value."""
    return Diagnostic(
        code=UNDEFINED_VALUE, message=f"`{text}` has no finite value", place=span, hint="check the domain"
    )


def wrong_kind(span: Span, wanted: str, got: str, hint: str | None = None) -> Diagnostic:
    """One kind of value where another is wanted."""
    return Diagnostic(code=WRONG_KIND, message=f"this should be {wanted}, but it is {got}", place=span, hint=hint)


def no_rotation(span: Span) -> Diagnostic:
    """A matrix of numbers that turns nothing: it would stretch or shear."""
    return Diagnostic(
        code=WRONG_KIND, message="this should be a rotation, but the columns of this matrix are not orthonormal",
        place=span, hint="a rotation matrix has columns of length 1 at right angles; `(@ M v)` is any linear map",
    )  # fmt: skip


def ragged_matrix(span: Span, wanted: int, got: int) -> Diagnostic:
    """Rows of a matrix of different lengths."""
    return Diagnostic(
        code=LENGTH_CLASH, message=f"this row has {got} {'element' if got == 1 else 'elements'}, the first has {wanted}", place=span,
        hint="the rows of a matrix have one length",
    )  # fmt: skip


def length_clash(span: Span, left: str, right: str, hint: str | None = None) -> Diagnostic:
    """Two shapes that should agree."""
    return Diagnostic(code=LENGTH_CLASH, message=f"{left} does not go with {right}", place=span, hint=hint)


def matrix_product(span: Span) -> Diagnostic:
    """``*`` of two matrices."""
    return Diagnostic(
        code=LENGTH_CLASH, message="`*` multiplies element by element, not matrices", place=span,
        hint="write `(@ A B)` for the matrix product",
    )  # fmt: skip


def wrong_arity(span: Span, name: str, usage: str, count: int) -> Diagnostic:
    """Too few or too many arguments."""
    given = "no arguments" if count == 0 else "1 argument" if count == 1 else f"{count} arguments"
    return Diagnostic(code=WRONG_ARITY, message=f"`{name}` is given {given}", place=span, hint=f"usage: {usage}")


def unknown_keyword(span: Span, keyword: str, owner: str, known: tuple[str, ...]) -> Diagnostic:
    """A keyword option nobody asked for."""
    listed = ", ".join(f"`:{k}`" for k in known)
    hint = f"did you mean {listed}?" if len(known) == 1 else f"known options: {listed}" if listed else None
    return Diagnostic(
        code=BAD_FORM, message=f"`:{keyword}` is not an option of {owner}", place=span,
        hint=hint or "it takes no options",
    )  # fmt: skip


def missing_keyword_value(span: Span, keyword: str) -> Diagnostic:
    """An option without its value."""
    return Diagnostic(
        code=BAD_FORM, message=f"`:{keyword}` has no value behind it", place=span, hint="write the value after it"
    )


APPLIED_BY = {"a pose": "transform", "a similarity": "transform", "a rotation": "rotate"}
"""The functions that apply values which are no functions."""


def bad_head(span: Span, name: str | None, got: str) -> Diagnostic:
    """A first element that means nothing; ``name`` is that of a variable."""
    apply = f"write `({APPLIED_BY[got]} {name} x)` to apply it" if name is not None and got in APPLIED_BY else None
    return Diagnostic(
        code=BAD_HEAD, message=f"{f'`{name}`' if name else 'this'} is {got}, not a function", place=span,
        hint=apply or "a list begins with a function, with something to index, or with the first number of a vector",
    )  # fmt: skip


def bad_index(span: Span, message: str, hint: str | None = None) -> Diagnostic:
    """An index or key that picks nothing."""
    return Diagnostic(code=BAD_INDEX, message=message, place=span, hint=hint)


def not_static(span: Span, what: str) -> Diagnostic:
    """A value needed while compiling that depends on an unknown."""
    return Diagnostic(
        code=NOT_STATIC, message=f"the value of {what} is needed here to compile, but it depends on an unknown",
        place=span, hint="use a number, a constant or a data column",
    )  # fmt: skip


def not_a_condition(span: Span, got: str) -> Diagnostic:
    """Something that is neither true nor false."""
    return Diagnostic(
        code=NOT_A_CONDITION, message=f"a condition is wanted, but this is {got}", place=span,
        hint="compare it with something: `(> x 0)`",
    )  # fmt: skip


def bad_form(span: Span, message: str, usage: str, mend: str | None = None) -> Diagnostic:
    """A special form or definition that is not built as it should."""
    return Diagnostic(code=BAD_FORM, message=message, place=span, hint=mend or f"usage: {usage}")


def duplicate_definition(span: Span, name: str, other: Span) -> Diagnostic:
    """A name defined twice."""
    return Diagnostic(
        code=DUPLICATE_DEFINITION, message=f"`{name}` is defined twice", place=span,
        hint="rename or remove one of them", labels=(Label(other, "first defined here"),),
    )  # fmt: skip


def reserved_name(span: Span, name: str) -> Diagnostic:
    """A definition of a name that is a special form."""
    return Diagnostic(
        code=DUPLICATE_DEFINITION, message=f"`{name}` is a special form and cannot be defined again", place=span,
        hint="choose another name",
    )  # fmt: skip


def circular_definition(span: Span, circle: tuple[str, ...]) -> Diagnostic:
    """A definition that needs itself; ``circle`` holds the names from it on to itself again."""
    way = ": " + " → ".join(f"`{name}`" for name in circle) if len(circle) > 2 else ""
    return Diagnostic(
        code=CIRCULAR_DEFINITION, message=f"`{circle[0]}` is defined by itself{way}", place=span,
        hint="break the circle",
    )  # fmt: skip


def circular_use(span: Span, path: str) -> Diagnostic:
    """Files in a circle."""
    return Diagnostic(
        code=CIRCULAR_USE, message=f"`{path}` is being read already: the files use one another in a circle",
        place=span, hint="move what both need into a third file",
    )  # fmt: skip


def too_deep(place: Place | None, limit: int) -> Diagnostic:
    """The depth limit."""
    return Diagnostic(
        code=TOO_DEEP, message=f"evaluation went more than {limit} levels deep here", place=place,
        hint="does this recursion ever end?",
    )  # fmt: skip


def too_many_steps(place: Place | None, limit: int) -> Diagnostic:
    """The step limit."""
    return Diagnostic(
        code=TOO_MANY_STEPS, message=f"evaluation took more than {limit} steps; it was stopped here", place=place,
        hint="long repetitions belong into a data table: rows cost nothing to compile",
    )  # fmt: skip


def too_many_in_all(place: Place | None, limit: int) -> Diagnostic:
    """The step limit of a whole compilation."""
    return Diagnostic(
        code=TOO_MANY_STEPS, message=f"all evaluations together took more than {limit} steps; they were stopped here",
        place=place, hint="each value of a static column (an index, a part's name) makes a group of rows of its own",
    )  # fmt: skip


def bad_work_bound(variable: str, text: str, least: float, most: float) -> Diagnostic:
    """``text`` stands where a number from ``least`` to ``most`` is wanted."""
    message = f"`{variable}` is `{shown(text)}`, which is no number from {least:g} to {most:,.0f}"
    return Diagnostic(code=BAD_WORK_BOUND, message=message, hint=f"write it as in `{variable}=4`")


def list_too_long(place: Place | None, length: int, limit: int) -> Diagnostic:
    """A list beyond the limit."""
    shown = f"{length}" if length < 10**15 else "far too many"
    return Diagnostic(
        code=LIST_TOO_LONG, message=f"this would have {shown} elements; the limit is {limit}", place=place,
        hint="long lists belong into a data table",
    )  # fmt: skip


def ambiguous_name(span: Span, name: str, table: str, other: str, declared: Span | None) -> Diagnostic:
    """A plain name with two meanings; a table that is made on the spot has no name to write before its column."""
    named = "" if table.startswith("(") else f"write `{table}.{name}` for the column, or "
    labels = (Label(declared, f"the {other} of this name"),) if declared is not None else ()
    return Diagnostic(
        code=AMBIGUOUS_NAME, message=f"`{name}` is both a column of `{table}` and {_article(other)}", place=span,
        hint=f"{named}rename one of them", labels=labels,
    )  # fmt: skip


def _article(noun: str) -> str:
    return f"an {noun}" if noun[0] in "aeiou" else f"a {noun}"


def text_in_number_column(span: Span, column: str, cell: str | None, place: Place | None) -> Diagnostic:
    """A column of texts used as numbers; the first cell that is no number is to blame."""
    if place is None or cell is None:
        return Diagnostic(code=TEXT_IN_NUMBER_COLUMN, message=f"column `{column}` holds texts, not numbers", place=span)
    hint = for_a_number(cell)
    told = shown(cell, 40)
    if not is_number(cell) and parse_unit(cell) is not None:
        hint = (
            f"where `{told}` is a unit, leave its row out and write `:columns (({column} :unit {told}))`; else {hint}"
        )
    return Diagnostic(
        code=TEXT_IN_NUMBER_COLUMN, message=f"column `{column}` is used as numbers, but a cell is `{told}`",
        place=place, hint=hint,
        labels=(Label(span, "used as a number here"),),
    )  # fmt: skip


def bad_top_level(span: Span, head: str | None = None, reserved: tuple[str, ...] = ()) -> Diagnostic:
    """Something at top level that defines nothing."""
    usage = (
        "(problem …), (use …), (defun …), (defmodel …), (defconst …), (defmacro …) or (model-name (argument…) shape…)"
    )
    if head is None:
        return bad_form(span, "only definitions and problems may stand at top level", usage)
    message = f"`({head} …)` at top level is neither a definition nor a model (whose second element is a list)"
    hint = suggestion(head, reserved, f"usage: {usage}")
    return Diagnostic(code=BAD_FORM, message=message, place=span, hint=hint)


def outside_sandbox(span: Span, path: str) -> Diagnostic:
    """A file that the sandbox keeps away."""
    return Diagnostic(
        code=OUTSIDE_SANDBOX, message=f"`{path}` lies outside the folder that reading is confined to", place=span,
        hint="move the file into the folder of `--sandbox`, or widen that",
    )  # fmt: skip


def used_here(diagnostic: Diagnostic, span: Span) -> Diagnostic:
    """A fault of a used file, said where it is used."""
    if diagnostic.place is None or diagnostic.place == span:
        return replace(diagnostic, place=span)
    return replace(diagnostic, place=span, labels=(*diagnostic.labels, Label(diagnostic.place, "the file")))
