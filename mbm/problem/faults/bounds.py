"""Diagnostics of guaranteed bounds: what interval methods cannot answer, and bounds that nothing else can use."""

from __future__ import annotations

from mbm.text.types import Code, Diagnostic, Label, Place, Severity, Span

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
