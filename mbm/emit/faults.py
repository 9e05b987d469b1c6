"""What cannot leave the house: codes and constructors."""

from __future__ import annotations

from mbm.text.types import Code, Diagnostic, Place

NOT_EMITTED = Code(
    "not-emitted",
    "The problem uses something that generated solvers do not have: `mbm compile` refuses it rather than write one "
    "that answers differently.",
    "Solve the problem with `mbm solve`, or state it without what the message names.",
)


STATE_ONE = "state a start with `:init`, or compile with `--init`"
"""What to do about an unknown without a start."""


def not_emitted(place: Place | None, what: str, why: str, instead: str = "use `mbm solve`") -> Diagnostic:
    """``what`` the problem has, ``why`` a generated solver cannot, and what to do ``instead``."""
    return Diagnostic(code=NOT_EMITTED, message=f"{what} cannot be compiled: {why}", place=place, hint=instead)
