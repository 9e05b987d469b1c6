"""What cannot leave the house: codes and constructors."""

from __future__ import annotations

from mbm.expression.nodes import External, Outlined
from mbm.text.faults import shown
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


def free_of_cost(place: Place) -> Diagnostic:
    """Movements that no sum of squares notices, and that the derivatives of residuals do not show."""
    return not_emitted(
        place,
        "a problem whose unknowns may move together at no cost",
        "generated solvers look for what is free among the derivatives of residuals, and these change",
        "fix one of the unknowns that `mbm solve` names, or give one a prior",
    )


def calls(external: External | Outlined) -> Diagnostic:
    """A function in Python, or an outline, which no generated code brings along."""
    if isinstance(external, Outlined):
        why = "generated code has no geometry to find an outline with"
        return not_emitted(external.span, "a silhouette", why)
    what = f"the function `{shown(external.function)}` in Python"
    why = "generated code holds its mathematics itself, to be built, read and trusted without that module"
    return not_emitted(
        external.span, what, why, "write the formula in the problem, or use `mbm solve --allow-external`"
    )
