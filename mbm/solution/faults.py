"""What the numerics may have to say before they start."""

from __future__ import annotations

from mbm.problem.naming import key_text
from mbm.text.types import Code, Diagnostic, Label, Place, Severity, Span

NO_EQUATIONS = Code(
    "no-equations",
    "There are unknowns but not a single scalar equation or prior for them: every row was dropped, or none was given.",
    "Check the data file, `:when` and the keys that select rows.",
)
NO_UNKNOWNS = Code(
    "no-unknowns",
    "Everything is fixed: there is nothing to estimate.",
    "Free at least one unknown, or use `derive` to compute from known numbers.",
)
TOO_MANY_UNKNOWNS = Code(
    "too-many-unknowns",
    "The Jacobian is held as a dense matrix here, and this one would not fit in the memory it may take.",
    "Solve in parts (`for-each`, `window`), or fix or drop unknowns.",
)
OPTION_NOT_FINITE = Code(
    "option-not-finite",
    "A start or bound of an unknown is not a finite number (for some member of its family).",
    "Correct the form, or the cell of the family's table that it uses.",
)
NOT_FINITE_AT_START = Code(
    "not-finite-at-start",
    "An equation has no finite value at the initial values: a logarithm of a negative number, a division by zero.",
    "Give other initial values with `:init`, or bounds with `:in`.",
)
NOISE_NOT_ESTIMATED = Code(
    "noise-not-estimated",
    "The noise of an observation is unknown, and its residuals cannot tell it: nothing checks them, or they are zero.",
    "State `:sigma`, or add observations.",
)

TOO_MANY_SOLVES = Code(
    "too-many-solves",
    "The columns of `for-each` stand in different tables, and all combinations of their values are too many.",
    "Put the columns into one table: then only the combinations that occur are solved.",
)


def no_equations(unknowns: int, place: Place | None = None) -> Diagnostic:
    """No residuals at all for ``unknowns`` scalar unknowns."""
    return Diagnostic(
        code=NO_EQUATIONS,
        message=f"{unknowns} scalar {'unknown' if unknowns == 1 else 'unknowns'}, but no equation has a row of data",
        place=place,
        hint=NO_EQUATIONS.mend,
    )


def no_unknowns(place: Place | None = None) -> Diagnostic:
    """Nothing is free."""
    return Diagnostic(code=NO_UNKNOWNS, message="every unknown is fixed", place=place, hint=NO_UNKNOWNS.mend)


def too_many_unknowns(rows: int, unknowns: int, limit: int, place: Place | None = None) -> Diagnostic:
    """A dense matrix, of the Jacobian or of the covariance, exceeds ``limit`` numbers."""
    return Diagnostic(
        code=TOO_MANY_UNKNOWNS,
        message=f"{rows} equations in {unknowns} unknowns make a matrix of {max(rows, unknowns) * unknowns} numbers; "
        f"at most {limit} are held",
        place=place,
        hint=TOO_MANY_UNKNOWNS.mend,
    )


def option_not_finite(span: Span, name: str, key: str | float | None) -> Diagnostic:
    """A start or bound without a value."""
    member = f" for the member {key_text(key)}" if key is not None else ""
    return Diagnostic(
        code=OPTION_NOT_FINITE,
        message=f"this option of `{name}` has no finite value{member}",
        place=span,
        hint=OPTION_NOT_FINITE.mend,
    )


def not_finite_at_start(span: Span, name: str, place: Place | None) -> Diagnostic:
    """An equation without a value at the initial values."""
    return Diagnostic(
        code=NOT_FINITE_AT_START,
        message=f"an equation of `{name}` has no finite value at the initial values",
        place=span,
        labels=(Label(place, "for this row"),) if place is not None else (),
        hint=NOT_FINITE_AT_START.mend,
        severity=Severity.WARNING,
    )


def noise_not_estimated(span: Span, name: str, why: str) -> Diagnostic:
    """An unknown noise that stays unknown."""
    return Diagnostic(
        code=NOISE_NOT_ESTIMATED,
        message=f"the unknown noise of `{name}`: {why}",
        place=span,
        hint=NOISE_NOT_ESTIMATED.mend,
        severity=Severity.WARNING,
    )


def too_many_solves(columns: tuple[str, ...], count: int, limit: int) -> Diagnostic:
    """Keys of different tables that combine to more problems than can be meant."""
    return Diagnostic(
        code=TOO_MANY_SOLVES,
        message=f"`for-each {' '.join(columns)}` combines to {count} problems; at most {limit} are tried",
        hint=TOO_MANY_SOLVES.mend,
    )
