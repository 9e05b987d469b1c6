"""Diagnostics of ``:errors``: measured columns that are themselves uncertain."""

from __future__ import annotations

from mbm.text.suggest import did_you_mean
from mbm.text.types import Code, Diagnostic, Label, Place, Severity, Span

ERRORS_WITHOUT_COLUMN = Code(
    "errors-without-column",
    "`:errors` names something that is not a column of numbers of the observation's table.",
    "Name measured columns of numbers; joined ones by their whole name, as in `receivers.x`.",
)
ERRORS_UNUSED = Code(
    "errors-unused",
    "`:errors` names a column that the equations do not use, or whose value decides what they are (a warning).",
    "Use the column in the equations, or leave it out of `:errors`.",
)
ERRORS_WITH_UNKNOWN_NOISE = Code(
    "errors-with-unknown-noise",
    "An equation with `:errors` has noise of its own of unknown size. Corrections are found with all noise stated; "
    "where some is estimated, it is told from the errors with the true values among the unknowns.",
    "State `:sigma`, or make the true values unknowns: `(u :per TABLE :init x :sigma 0.3)` in the place of "
    "`:errors ((x 0.3))`, and `(u key)` in that of `x`.",
)
ERRORS_DIFFER = Code(
    "errors-differ",
    "One measured value gets different standard deviations from two rows or two observations that use it.",
    "State it once, in a form of the columns of the value's own table.",
)
TOO_FEW_ERRORS = Code(
    "too-few-errors",
    "Equations without noise of their own hold fewer uncertain values than there are equations: corrections of the "
    "measured values cannot meet them all.",
    "Add `:sigma`, the noise of the equations themselves, or name more columns in `:errors`.",
)
TOO_MANY_SHARED_ERRORS = Code(
    "too-many-shared-errors",
    "More equations and uncertain values hang together, because they share measured values, than are solved at once.",
    "Make the shared values unknowns with priors: such problems may be much larger.",
)
ERRORS_WITH_LOSS = Code(
    "errors-with-loss",
    "A loss acts on each equation by itself, but the corrections that several equations share belong to none of them.",
    "Take the loss away, or make the shared values unknowns with priors.",
)


def errors_without_column(span: Span, name: str, why: str, near: str | None) -> Diagnostic:
    """Errors of something that has none; ``why`` says what it is instead."""
    hint = did_you_mean(near, "`:errors ((column sigma)…)` names measured columns of numbers")
    return Diagnostic(code=ERRORS_WITHOUT_COLUMN, message=f"`{name}` {why}", place=span, hint=hint)


def errors_unused(span: Span, name: str, observation: str) -> Diagnostic:
    """Errors of a column that matters to no equation."""
    return Diagnostic(
        code=ERRORS_UNUSED, severity=Severity.WARNING, place=span,
        message=f"`{name}` has errors, but it is no number in the equations of `{observation}`",
        hint="use the column in the equations, or leave it out of `:errors`",
    )  # fmt: skip


def errors_with_unknown_noise(span: Span, observation: str, column: str, declared: Span | None) -> Diagnostic:
    """Noise of unknown size beside errors of known size; ``declared`` is where another observation states them."""
    note = "its errors are stated here, and it is corrected wherever it is used"
    return Diagnostic(
        code=ERRORS_WITH_UNKNOWN_NOISE, place=span, labels=(Label(declared, note),) if declared is not None else (),
        message=f"give `{observation}` a `:sigma`: it uses `{column}`, which has `:errors`",
        hint=f"or make the true values unknowns in its place, `(u :per TABLE :init {column} :sigma …)`",
    )  # fmt: skip


def errors_differ(span: Span, column: str, sigmas: tuple[float, float], place: Place | None) -> Diagnostic:
    """Two standard deviations of one measured value."""
    return Diagnostic(
        code=ERRORS_DIFFER, place=span, labels=(Label(place, "this value"),) if place is not None else (),
        message=f"`{column}` has two standard deviations in one row, {sigmas[0]:g} and {sigmas[1]:g}; give one",
        hint="state it in columns of the value's own table",
    )  # fmt: skip


def too_few_errors(span: Span, observation: str, equations: int, errors: int, place: Place | None) -> Diagnostic:
    """More exact equations than corrections that could meet them."""
    return Diagnostic(
        code=TOO_FEW_ERRORS, place=span, labels=(Label(place, "for this row"),) if place is not None else (),
        message=f"`{observation}` has {equations} exact equation{'s' * (equations != 1)} in {errors} uncertain "
        f"value{'s' * (errors != 1)}, which cannot all be met",
        hint="add `:sigma`, the noise of the equations themselves",
    )  # fmt: skip


def too_many_shared_errors(span: Span, equations: int, errors: int) -> Diagnostic:
    """A component of equations that is too large."""
    return Diagnostic(
        code=TOO_MANY_SHARED_ERRORS, place=span,
        message=f"{equations} equations hang together by {errors} uncertain values, which is too many at once",
        hint="make the shared values unknowns with priors",
    )  # fmt: skip


def errors_with_loss(span: Span, observation: str, column: str) -> Diagnostic:
    """A loss on equations that share corrections."""
    return Diagnostic(
        code=ERRORS_WITH_LOSS, place=span,
        message=f"`{observation}` has a loss, but its equations share the corrections of `{column}`",
        hint="take the loss away, or make the shared values unknowns with priors",
    )  # fmt: skip
