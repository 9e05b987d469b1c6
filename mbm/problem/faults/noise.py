"""Diagnostics of noise that rows and clauses share: factors, common errors, correlation."""

from __future__ import annotations

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
