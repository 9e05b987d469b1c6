"""What can be wrong with a propagation of distributions: codes and constructors."""

from __future__ import annotations

from mbm.text.types import Code, Diagnostic, Place, Severity, Span

NOT_PROPAGATED = Code(
    "not-propagated",
    "`mbm propagate` solves with inputs drawn from their distributions, and cannot do so here: losses and consensus "
    "judge rows by residuals, filters and interval methods make no minimum, a constant decides more than a value.",
    "Do what the message says; `mbm solve` has the linear uncertainty.",
)
NOTHING_DRAWN = Code(
    "nothing-drawn",
    "No input of the problem has an uncertainty, so that there is no distribution to propagate.",
    "State a `:sigma` of the observations, a prior, or the uncertainty of a constant.",
)
TOO_MANY_TRIALS = Code(
    "too-many-trials",
    "The samples of so many trials do not fit into memory.",
    "Ask for fewer `--trials`.",
)
FAILED_TRIALS = Code(
    "failed-trials",
    "Some trials did not converge, and are not in the results: these are those of the others (a warning).",
    "Look at the problem near its estimates: bounds, values without a logarithm, more than one minimum.",
)
NOT_SETTLED = Code(
    "not-settled",
    "An adaptive propagation ended at the largest number of trials, before its results were known to two digits of "
    "the standard deviation (a warning).",
    "Take the results with fewer digits, or ask for more `--trials`.",
)


NO_DENSITY = Code(
    "no-density",
    "`compiled.log_density` is asked of a problem whose unknowns have no density: equations among the constraints "
    "leave a surface, corrections of measured values and states are eliminated, uncertain constants are not "
    "estimated, nor are noises that rows share.",
    "Do what the message says, or use `mbm propagate`.",
)


def no_density(place: Place | None, what: str, mend: str) -> Diagnostic:
    """``what`` leaves the unknowns without a density."""
    return Diagnostic(
        code=NO_DENSITY, message=f"there is no density of the unknowns beside {what}", place=place, hint=mend
    )


def not_propagated(place: Place | None, what: str, why: str, mend: str) -> Diagnostic:
    """``what`` the problem has, and ``why`` it cannot be propagated."""
    return Diagnostic(code=NOT_PROPAGATED, message=f"{what} cannot be propagated: {why}", place=place, hint=mend)


def not_drawn(span: Span, name: str, why: str) -> Diagnostic:
    """A constant that cannot be drawn."""
    mend = "make it an unknown with a prior, or leave its uncertainty out"
    return not_propagated(span, f"the constant `{name}`", why, mend)


def decides(diagnostic: Diagnostic) -> Diagnostic:
    """What the problem does not allow of constants that vary; ``diagnostic`` says it of unknowns."""
    return Diagnostic(
        code=NOT_PROPAGATED,
        message=f"constants with an uncertainty vary here as unknowns do: {diagnostic.message}",
        place=diagnostic.place,
        hint="leave the uncertainty of the constant out, or use another constant here",
    )


def nothing_drawn(span: Span) -> Diagnostic:
    """No input is uncertain."""
    return Diagnostic(
        code=NOTHING_DRAWN, message="no input of this problem has an uncertainty", place=span, hint=NOTHING_DRAWN.mend
    )


def too_many_trials(trials: int, scalars: int, most: int) -> Diagnostic:
    """``trials`` of so many ``scalars``; ``most`` fit."""
    return Diagnostic(
        code=TOO_MANY_TRIALS,
        message=f"{trials:,} trials of {scalars:,} numbers do not fit into memory; {most:,} do",
        place=None,
        hint=TOO_MANY_TRIALS.mend,
    )


def failed_trials(span: Span, failed: int, trials: int) -> Diagnostic:
    """``failed`` of the ``trials`` did not converge."""
    return Diagnostic(
        code=FAILED_TRIALS,
        severity=Severity.WARNING,
        message=f"{failed:,} of {trials:,} trials did not converge, and are left out",
        place=span,
        hint=FAILED_TRIALS.mend,
    )


def not_settled(span: Span, trials: int) -> Diagnostic:
    """The largest number of trials was made."""
    return Diagnostic(
        code=NOT_SETTLED,
        severity=Severity.WARNING,
        message=f"the results are not known to two digits of their standard deviations after {trials:,} trials",
        place=span,
        hint=NOT_SETTLED.mend,
    )


def stopped(span: Span, trials: int) -> Diagnostic:
    """The propagation was interrupted."""
    return Diagnostic(
        code=NOT_SETTLED,
        severity=Severity.WARNING,
        message=f"the propagation was interrupted after {trials:,} trials",
        place=span,
        hint=NOT_SETTLED.mend,
    )
