"""Diagnostics of noise that rows and clauses share: factors, common errors, correlation."""

from __future__ import annotations

from mbm.problem.faults.data import BAD_NOISE
from mbm.text.types import Code, Diagnostic, Label, Span

FACTOR_OF_SEVERAL_DIMENSIONS = Code(
    "factor-of-several-dimensions",
    "One unknown noise factor stands for quantities of several dimensions, such as volts and radians: it would weight"
    " one volt like one radian.",
    "Write a standard deviation with its unit for each, `:sigma (unknown [1mV 1mA 1mrad])`, so that the factor is a"
    " pure number; or an `observe` clause for each, with a factor of its own.",
)
NOISE_NAME_TAKEN = Code(
    "noise-name-taken",
    "The name of a shared noise factor (`:as`) is that of a clause, so that `noise` could not tell the two apart.",
    "Give the factor another name.",
)
NOISE_NOT_COMBINED = Code(
    "noise-not-combined",
    "An option about noise that rows share stands with one that looks at each row by itself, or at other noise.",
    "The message says which of the two to leave out.",
)
NOISE_TOO_LARGE = Code(
    "noise-too-large",
    "Noise that rows share makes a matrix with more numbers than mbm works with.",
    "Make the common errors unknowns, `(b :per TABLE.COLUMN)`, with a prior `(normal (b key) 0 size)` for each: the"
    " estimates and their standard deviations are the same.",
)


def factor_of_several_dimensions(span: Span, first: str, second: str, label: Label | None, hint: str) -> Diagnostic:
    """A factor of quantities that differ in dimension."""
    return Diagnostic(
        code=FACTOR_OF_SEVERAL_DIMENSIONS, message=f"one unknown noise factor is {first} here and {second} there",
        place=span, labels=() if label is None else (label,), hint=hint,
    )  # fmt: skip


def noise_name_taken(span: Span, name: str, other: Span) -> Diagnostic:
    """A factor called like a clause."""
    return Diagnostic(
        code=NOISE_NAME_TAKEN, message=f"the noise factor `{name}` has the name of a clause",
        place=span, labels=(Label(other, f"`{name}`"),), hint="give the factor a name of its own",
    )  # fmt: skip


def noise_not_combined(span: Span, what: str, hint: str) -> Diagnostic:
    """Noise options that do not go together."""
    return Diagnostic(code=NOISE_NOT_COMBINED, message=what, place=span, hint=hint)


def noise_beside_rule(span: Span, clause: str, what: str, rule: str) -> Diagnostic:
    """Noise that rows share beside a loss or an outlier rule."""
    message = f"`{rule}` looks at each row of `{clause}` by itself, but {what} belongs to all of them"
    return noise_not_combined(span, message, f"leave `{rule}` out, or state a `:sigma` for each row")


def noise_of_unequal_rows(span: Span) -> Diagnostic:
    """Noise of a matrix or chain where rows have equations of several sizes."""
    return noise_not_combined(
        span,
        "all rows have to have the same components, one vector equation each",
        "write an `observe` clause for each equation",
    )


def noise_without_rows(span: Span) -> Diagnostic:
    """Noise that rows share in a clause without a table."""
    return noise_not_combined(
        span,
        "rows share this noise, and the clause has no table",
        "put the readings into a table, one in each row",
    )


def unknown_common_error(span: Span, column: str) -> Diagnostic:
    """A common error of unknown size."""
    hint = f"state its size; or make it a family of unknowns, `(b :per TABLE.{column})`, with a prior in `constraints`"
    return noise_not_combined(span, "the size of a common error has to be stated", hint)


def bad_correlation(span: Span, what: str) -> Diagnostic:
    """A correlation matrix that is none."""
    hint = "it has a row and a column for each row of the table before any is left out, 1 on its diagonal, and is"
    return Diagnostic(code=BAD_NOISE, message=what, place=span, hint=f"{hint} symmetric and positive definite")


def noise_too_large(span: Span, rows: int, needed: int) -> Diagnostic:
    """Common errors of more rows and groups than there is room for."""
    return Diagnostic(
        code=NOISE_TOO_LARGE, message=f"common errors of {rows} residuals that depend on one another need {needed}"
        " numbers", place=span,
        hint="make the common errors a family of unknowns with priors, which the sparse solver takes",
    )  # fmt: skip
