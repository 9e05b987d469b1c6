"""Diagnostics of noise and bounds: what rows and clauses share, uncertain columns, likelihoods, interval methods."""

from __future__ import annotations

from mbm.text.suggest import did_you_mean
from mbm.text.types import Code, Diagnostic, Label, Place, Severity, Span

BAD_NOISE = Code(
    "bad-noise",
    "A standard deviation is not positive, or a covariance matrix is not symmetric and positive definite.",
    "Correct the form or the cell.",
)
BOUND_WITHOUT_INTERVAL = Code(
    "bound-without-interval",
    "An observation gives a `:bound`, which says nothing of how errors are distributed within it: only interval methods"
    " can use it.",
    "Write `(solve :method (interval))`, or give a `:sigma` in place of the bound.",
)
NOT_FOR_INTERVALS = Code(
    "not-for-intervals",
    "The problem asks for interval methods, which keep every value within stated bounds. They take no standard"
    " deviations, losses, priors, rotations of space or functions in Python.",
    "Write what the message says, or use another `:method`.",
)
START_OUTSIDE_BOUNDS = Code(
    "start-outside-bounds",
    "`:init` lies outside `:in`: the solve begins at the nearest bound, and one of the two is probably wrong (a"
    " warning).",
    "Correct `:init` or `:in`; for a range of starts alone write `:start`.",
)


def start_outside_bounds(start: Span, bound: Span, name: str, members: int) -> Diagnostic:
    """The ``start`` of an unknown, or of some members of a family, is beyond a ``bound``."""
    whose = f"`{name}`" if members == 1 else f"{members} members of `{name}`"
    return Diagnostic(
        code=START_OUTSIDE_BOUNDS,
        message=f"the `:init` of {whose} lies outside `:in`",
        place=start,
        labels=(Label(bound, "beyond this bound"),),
        hint=START_OUTSIDE_BOUNDS.mend,
        severity=Severity.WARNING,
    )


def bound_without_interval(span: Span, block: str, method: str) -> Diagnostic:
    """A bound where the method is another one."""
    return Diagnostic(
        code=BOUND_WITHOUT_INTERVAL,
        message=f"`{block}` has a `:bound`, which the method `{method}` cannot use",
        place=span,
        hint="write `(solve :method (interval))`, or `:sigma` in place of `:bound`",
    )


def bound_without_distribution(span: Span, block: str | None) -> Diagnostic:
    """A bound where errors are to be drawn, or residuals to be weighed."""
    whose = f"`{block}` has a `:bound`, which" if block is not None else "a `:bound`"
    return Diagnostic(
        code=BOUND_WITHOUT_INTERVAL,
        message=f"{whose} gives no distribution to draw errors from or to weigh residuals by",
        place=span,
        hint="give a `:sigma` in place of the `:bound`, and another `:method`",
    )


def not_for_intervals(place: Place | None, what: str, hint: str) -> Diagnostic:
    """Something that has no meaning for interval methods; ``hint`` says what to write."""
    return Diagnostic(code=NOT_FOR_INTERVALS, message=f"interval methods cannot use {what}", place=place, hint=hint)


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


def bad_noise(span: Span, what: str, place: Place | None) -> Diagnostic:
    """A weight that is none."""
    labels = (Label(place, "for this row"),) if place is not None else ()
    hint = "a sigma is a number above zero; covariance and information are symmetric and positive definite"
    return Diagnostic(code=BAD_NOISE, message=what, place=span, labels=labels, hint=hint)
