"""Diagnostics of distributions, limits and rounded readings, and of weights that the model decides."""

from __future__ import annotations

from mbm.text.types import Code, Diagnostic, Label, Place, Severity, Span

BAD_DISTRIBUTION = Code(
    "bad-distribution",
    "`:distribution` names no distribution of measured values, or its parameters are none.",
    "Write `:distribution normal`, `poisson`, `(binomial n)` or `(student dof)`.",
)
LIKELIHOOD_NOT_HERE = Code(
    "likelihood-not-here",
    "A `:distribution`, a limit (`:below`, `:above`), a `:resolution` or weights with `model` stand beside something"
    " that they do not go with: another option, an equation of several components, or a method of solving.",
    "Do what the message says: leave one of the two out, or write the equation as it wants it.",
)
NOT_A_COUNT = Code(
    "not-a-count",
    "A reading of `:distribution poisson` or `(binomial n)` is no count, or its n is none.",
    "Correct the cell; counts are whole numbers, not below 0, and not above n.",
)
IMPOSSIBLE_ERRORS = Code(
    "impossible-errors",
    "What an observation says of the errors of a reading gives it no probability: a `:resolution` or degrees of freedom"
    " that are not above 0, a reading that is `:below` and `:above` the value at once, or numbers too large or small to"
    " compute with.",
    "Correct the number, or the cell that it is taken from.",
)
WITHOUT_MODEL_SIDE = Code(
    "without-model-side",
    "`model` in `:sigma`, `:covariance` or `:information` is the second side of `(= MEASURED MODEL)`, of numbers or"
    " vectors; the equation has none.",
    "Write the equation with two sides, or the standard deviation without `model`.",
)
SIGMA_NOT_RELATIVE = Code(
    "sigma-not-relative",
    "`:sigma` is a plain percentage, which is a number of the measured dimension, not a share of the value (a hint).",
    "Write `:sigma (* 5% model)` for 5 % of the model's value, or `(* 5% column)` for 5 % of the measured one.",
)
NEVER_FAR_OUT = "leave out the loss or `:robust`; rows that are wrong can be left out with `:when`"


def bad_distribution(span: Span, what: str) -> Diagnostic:
    """A distribution that is none."""
    hint = "write `:distribution normal`, `poisson`, `(binomial n)` or `(student dof)`"
    return Diagnostic(code=BAD_DISTRIBUTION, message=what, place=span, hint=hint)


def likelihood_not_here(span: Span, what: str, why: str, hint: str) -> Diagnostic:
    """``what`` (an option) does not go with something else; ``why`` says so."""
    return Diagnostic(code=LIKELIHOOD_NOT_HERE, message=f"{what} {why}", place=span, hint=hint)


def not_a_count(span: Span, what: str, place: Place | None) -> Diagnostic:
    """A reading that its distribution cannot give."""
    labels = () if place is None else (Label(place, "in this row"),)
    hint = "counts are whole numbers from 0, of a binomial up to n; leave rows out with `:when`"
    return Diagnostic(code=NOT_A_COUNT, message=what, place=span, labels=labels, hint=hint)


def impossible_errors(span: Span, what: str, place: Place | None = None) -> Diagnostic:
    """What no reading can have for errors."""
    labels = () if place is None else (Label(place, "in this row"),)
    hint = (
        "sigma, steps and degrees of freedom are above 0, trials whole numbers from 1; a reading is one limit at most"
    )
    return Diagnostic(code=IMPOSSIBLE_ERRORS, message=what, place=span, labels=labels, hint=hint)


def without_model_side(span: Span) -> Diagnostic:
    """`model` where an equation has one side, or sides of another kind."""
    message = "`model` is the second side of `(= MEASURED MODEL)` with numbers or vectors; this equation has none"
    hint = "write the equation with two sides of numbers, or the noise without `model`"
    return Diagnostic(code=WITHOUT_MODEL_SIDE, message=message, place=span, hint=hint)


def sigma_not_relative(span: Span, value: float) -> Diagnostic:
    """A percentage that looks as if it were relative."""
    return Diagnostic(
        code=SIGMA_NOT_RELATIVE, severity=Severity.WARNING, place=span,
        message=f"`:sigma {span.text}` is {value:g} in the unit of what is measured, not a share of its value",
        hint=f"write `(* {span.text} model)` for a share of the model's value, or `{value:g}`",
    )  # fmt: skip
