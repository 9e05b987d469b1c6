"""Diagnostics of what is given from outside in place of what a problem says: constants, starts, settings."""

from __future__ import annotations

from mbm.text.suggest import listed, suggestion
from mbm.text.types import Code, Diagnostic, Span

UNKNOWN_OVERRIDE = Code(
    "unknown-override",
    "A constant or start is given from outside, but the problem has no constant or unknown of that name.",
    "Correct the name.",
)
WRONG_VALUE = Code(
    "wrong-value",
    "A constant, a start, a seed or a number of starts that is given from outside is none: it has another size or"
    " dimension than what it stands for, is not finite, or out of range.",
    "Give one as the message says, or leave it out for that of the problem.",
)


def unknown_override(name: str, known: tuple[str, ...], span: Span | None = None) -> Diagnostic:
    """A value for a name that takes none."""
    return Diagnostic(
        code=UNKNOWN_OVERRIDE,
        message=f"the problem has no constant or unknown `{name}` to set",
        place=span,
        hint=suggestion(name, known, f"values can be given for {listed(known)}" if known else None),
    )


def wrong_value(name: str, message: str, hint: str = "leave it out for that of the problem") -> Diagnostic:
    """A value that does not fit its name."""
    return Diagnostic(code=WRONG_VALUE, message=f"the value given for `{name}` {message}", hint=hint)
