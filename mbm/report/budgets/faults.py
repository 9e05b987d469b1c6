"""What can be wrong where an uncertainty budget is asked for."""

from __future__ import annotations

from collections.abc import Sequence

from mbm.text.suggest import closest
from mbm.text.types import Code, Diagnostic

NO_BUDGET = Code(
    "no-budget",
    "The uncertainty of this quantity is not a sum over inputs, or is not known: bounds of interval methods, filters, "
    "fixed numbers, estimates at a limit or without a standard deviation.",
    "Ask for a quantity that has a standard deviation; of a sequence, solve with `:method batch`.",
)
UNKNOWN_QUANTITY = Code(
    "unknown-quantity",
    "A budget was asked of something that is neither estimated nor derived.",
    "Name an estimate or a derived quantity, or one of its numbers as the covariance names them: `p[1]`.",
)


def no_budget(name: str, why: str, hint: str | None = None) -> Diagnostic:
    """A quantity without one."""
    message = f"`{name}` has no uncertainty budget: {why}"
    return Diagnostic(code=NO_BUDGET, message=message, place=None, hint=hint or NO_BUDGET.mend)


def unknown_quantity(name: str, names: Sequence[str]) -> Diagnostic:
    """A name that nothing has."""
    near = closest(name, names)
    hint = f"did you mean `{near}`?" if near is not None else UNKNOWN_QUANTITY.mend
    message = f"`{name}` is neither estimated nor derived"
    return Diagnostic(code=UNKNOWN_QUANTITY, message=message, place=None, hint=hint)


def several_quantities(name: str, names: Sequence[str]) -> Diagnostic:
    """A name of several numbers where one is meant."""
    shown = ", ".join(f"`{each}`" for each in names[:4])
    return Diagnostic(
        code=UNKNOWN_QUANTITY, message=f"`{name}` is {len(names)} numbers, each with a budget of its own", place=None,
        hint=f"ask for one of {shown}{' …' if len(names) > 4 else ''}, or for `.budgets({name!r})`",
    )  # fmt: skip
