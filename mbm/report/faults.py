"""What can be wrong when results are written or initial values are read: codes and constructors."""

from __future__ import annotations

from collections.abc import Sequence

from mbm.text.types import Code, DataPlace, Diagnostic, Severity, Span

PLOT_FORMAT = Code(
    "plot-format",
    "The name of a plot ends in no picture format that can be drawn.",
    "End the name in .png, .svg or .pdf.",
)
BAD_INITIAL_VALUES = Code(
    "bad-initial-values",
    "Initial values are a JSON object from names to values (a number, nested lists, or `{keys, value}`), or a result "
    "document; something else was given.",
    'Write for instance `{"p": [1, 1, 1]}`, or give the document that `mbm solve --json` wrote.',
)
NEAR_BOUND = Code(
    "near-bound",
    "An estimate is held at a hard bound (`:in`), or was driven to the zero that a `positive` unknown stays above. It "
    "has no standard deviation, and those of the others hold for it staying where it is.",
    "If the bound is no fact of the matter, widen it with `:in`; else look for an equation that asks for the far side.",
)

MOST_NAMES = 8


def plot_format(path: str, known: str) -> Diagnostic:
    """The ending of ``path`` is none of those that can be drawn."""
    return Diagnostic(
        code=PLOT_FORMAT, message=f"`{path}` names no picture format", hint=f"end the name in one of {known}"
    )


def bad_initial_value(name: str, what: str, file: str | None = None) -> Diagnostic:
    """The initial value of ``name`` cannot be read; ``what`` says what it is instead."""
    return Diagnostic(
        code=BAD_INITIAL_VALUES,
        message=f"the initial value of `{name}` is {what}",
        place=None if file is None else DataPlace(file=file),
        hint="write a number, lists of numbers, or an object with `keys` and `value`",
    )


def unknown_member(name: str, key: str, near: str | None) -> Diagnostic:
    """The initial values name a member ``key`` (as names show it) that the family does not have."""
    return Diagnostic(
        code=BAD_INITIAL_VALUES,
        message=f"the initial value of `{name}` is for a member {key}, which it does not have",
        hint=f"did you mean `{near}`?" if near is not None else "give the keys that the table has",
    )


def bad_initial_values(what: str, file: str | None = None) -> Diagnostic:
    """The whole is no mapping and no result document."""
    return Diagnostic(
        code=BAD_INITIAL_VALUES,
        message=f"the initial values are {what}",
        place=None if file is None else DataPlace(file=file),
        hint='write an object such as `{"p": [1, 1, 1]}`, or give a result document',
    )


def near_bound(span: Span, names: Sequence[str], what: str) -> Diagnostic:
    """The scalars ``names`` of an unknown ended at ``what``: `its lower bound`, `its upper bound`, `zero`."""
    shown = ", ".join(f"`{name}`" for name in names[:MOST_NAMES])
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    verb = "is" if len(names) == 1 else "are each"
    held = f"{verb} driven to zero, where `positive` ends" if what == "zero" else f"{verb} held at {what}"
    return Diagnostic(
        code=NEAR_BOUND,
        message=f"{shown}{more} {held}",
        place=span,
        hint=NEAR_BOUND.mend,
        severity=Severity.WARNING,
    )
