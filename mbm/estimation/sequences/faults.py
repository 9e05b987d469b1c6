"""What filters and smoothers may have to say."""

from __future__ import annotations

from collections.abc import Sequence

from mbm.problem.sequence.types import Estimator
from mbm.text.types import Code, Diagnostic, Severity, Span

NOT_FOR_FILTERS = Code(
    "not-for-filters",
    "Filters and smoothers take one step after the other with noise that is stated; this problem has something that "
    "needs all steps at once, or several passes over the rows.",
    "Use `:method batch`, which solves all steps at once.",
)
OVERCONFIDENT_FILTER = Code(
    "overconfident-filter",
    "The innovations of a filter, what the rows say beyond what was predicted, are larger than their covariances let "
    "expect: the filter trusts its estimates more than it should (a warning).",
    "Where the equations are curved, linearise better: `:method iterated-ekf`, `(smoother :lag n)` or `batch`; else "
    "correct the sigmas and the noise of the transitions.",
)
BEYOND_BOUNDS = Code(
    "beyond-bounds",
    "A filter that does not cut its distribution takes no notice of `:in` and `positive`; an estimate lies outside. "
    "The solve is `infeasible`, as with the same limit in a constraint.",
    "Use `:constraints truncate`, by which bounds and inequalities cut, or `batch` or `(smoother)`, which meet them.",
)
INTERVAL_BEYOND_BOUNDS = Code(
    "interval-beyond-bounds",
    "An estimate keeps to `:in` or `positive`, but its 95 % interval reaches beyond: a filter that does not cut its "
    "distribution takes no notice of bounds, and a smoother that does not has estimates alone meet them (a warning).",
    "Use `:constraints truncate`, by which bounds cut the distribution, or `batch`, whose intervals keep to bounds.",
)

ANOTHER_HYPOTHESIS = Code(
    "another-hypothesis",
    "A filter follows several hypotheses, and others than the one that is reported are still probable after the last "
    "step: they have 5 % of all weight or more together (a warning). They stand among the `hypotheses`.",
    "Measure something that tells them apart, or exclude one with a constraint or the prior of the first step.",
)

BEGUN_ANEW = Code(
    "begun-anew",
    "A window with `:carry true` begins with what is stated of the first step though rows have left before it: no "
    "window before it that converged has its first step. What those rows say is in none of the windows from here on (a "
    "warning).",
    "Take longer windows or smaller steps, so that each window has a step of the one before.",
)

OTHER_EQUATIONS = Code(
    "no-equation-for-row",
    "A row that a stream is given is of a kind that the data had no row of when the problem was compiled: words in it, "
    "or numbers that decide which equation holds, are others.",
    "Compile the problem with data that have a row of each kind.",
)


def not_carried(span: Span | None, what: str) -> Diagnostic:
    """Windows of which the rows that leave are no prior of what stays."""
    return Diagnostic(
        code=NOT_FOR_FILTERS,
        message=f"`:carry` is for windows over the steps of a smoother or `batch` without limits; the problem {what}",
        place=span,
        hint="leave `:carry` out",
    )


def begun_anew(span: Span | None) -> Diagnostic:
    """A window to which nothing is carried from the rows that have left."""
    return Diagnostic(
        code=BEGUN_ANEW,
        severity=Severity.WARNING,
        message="a window without a step of one before that converged begins anew, with `:init` and `:sigma`",
        place=span,
        hint=BEGUN_ANEW.mend,
    )


def beyond_bounds(span: Span | None, name: str, steps: int | None) -> Diagnostic:
    """An unknown outside its bounds, which a filter does not use: at so many steps (None: it is no state)."""
    where = "" if steps is None else f" at {steps} step{'' if steps == 1 else 's'}"
    return Diagnostic(
        code=BEYOND_BOUNDS,
        severity=Severity.WARNING,
        message=f"`{name}` is outside its bounds{where}: this filter does not use them",
        place=span,
        hint=BEYOND_BOUNDS.mend,
    )


def interval_beyond_bounds(span: Span | None, name: str, steps: int | None) -> Diagnostic:
    """An unknown whose 95 % interval reaches beyond its bounds: at so many steps (None: it is no state)."""
    where = "" if steps is None else f" at {steps} step{'' if steps == 1 else 's'}"
    return Diagnostic(
        code=INTERVAL_BEYOND_BOUNDS,
        severity=Severity.WARNING,
        message=f"the 95 % interval of `{name}` reaches beyond its bounds{where}: they are not used for it",
        place=span,
        hint=INTERVAL_BEYOND_BOUNDS.mend,
    )


def another_hypothesis(span: Span | None, reported: float, others: Sequence[float]) -> Diagnostic:
    """The weights of the hypothesis ``reported``, and of the ``others``."""
    if len(others) == 1:
        what = f"another hypothesis is probable after the last step: its weight is {others[0]:.4g}"
    else:
        what = f"{len(others)} other hypotheses are followed after the last step: their weights are {sum(others):.4g}"
        what += f" together, {max(others):.4g} the greatest"
    return Diagnostic(
        code=ANOTHER_HYPOTHESIS,
        severity=Severity.WARNING,
        message=f"{what}, that of the one reported {reported:.4g}",
        place=span,
        hint=ANOTHER_HYPOTHESIS.mend,
    )


def other_equations(span: Span | None, name: str) -> Diagnostic:
    """A row for which no equation of the block ``name`` was compiled."""
    message = f"no equation of `{name}` was compiled for such a row"
    return Diagnostic(code=OTHER_EQUATIONS, message=message, place=span, hint=OTHER_EQUATIONS.mend)


def not_for_filters(span: Span | None, estimator: Estimator, what: str, mend: str) -> Diagnostic:
    """Something that a filter or smoother cannot do; ``what`` follows on its name."""
    return Diagnostic(code=NOT_FOR_FILTERS, message=f"{estimator.called} {what}", place=span, hint=mend)


def overconfident_filter(span: Span | None, ratio: float, probability: float) -> Diagnostic:
    """Innovations that are ``ratio`` times as large as expected, which chance does with this probability."""
    shown = f"p = {probability:.2g}" if probability > 0 else "p < 1e-300"
    return Diagnostic(
        code=OVERCONFIDENT_FILTER,
        severity=Severity.WARNING,
        message=f"the innovations are {ratio:.3g} times as large as the filter expects ({shown})",
        place=span,
        hint=OVERCONFIDENT_FILTER.mend,
    )
