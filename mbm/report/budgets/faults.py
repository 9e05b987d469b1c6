"""What can be wrong where an uncertainty budget is asked for."""

from __future__ import annotations

from collections.abc import Sequence

from mbm.text.suggest import closest
from mbm.text.types import Code, Diagnostic, Severity

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
    return Diagnostic(
        code=NO_BUDGET, message=f"`{name}` has no uncertainty budget: {why}", place=None, hint=hint or NO_BUDGET.mend
    )


def nothing_estimated() -> Diagnostic:
    """A problem that only compares."""
    return Diagnostic(
        code=NO_BUDGET,
        message="there is no uncertainty budget: nothing is estimated, and nothing derived",
        place=None,
        hint="name what is wanted in `derive`",
    )


def too_many(count: int) -> Diagnostic:
    """More numbers than have a budget each without being named."""
    return Diagnostic(
        code=NO_BUDGET,
        message=f"{count:,} numbers are too many for a budget of each",
        place=None,
        hint="name some: `--for NAME`, or `.budgets(NAME)`",
    )


def left_out(key: str, found: Diagnostic) -> Diagnostic:
    """One of several solves that has none."""
    return Diagnostic(
        code=found.code, message=f"{key}: {found.message}", place=None, hint=found.hint, severity=Severity.WARNING
    )


def more_left_out(count: int) -> Diagnostic:
    """More of them than are named."""
    return Diagnostic(
        code=NO_BUDGET, message=f"{count} more have no uncertainty budget", place=None, severity=Severity.WARNING
    )


def unknown_quantity(name: str, names: Sequence[str]) -> Diagnostic:
    """A name that nothing has."""
    near = closest(name, names)
    hint = f"did you mean `{near}`?" if near is not None else UNKNOWN_QUANTITY.mend
    return Diagnostic(
        code=UNKNOWN_QUANTITY, message=f"`{name}` is neither estimated nor derived", place=None, hint=hint
    )


def several_quantities(name: str, names: Sequence[str]) -> Diagnostic:
    """A name of several numbers where one is meant."""
    shown = ", ".join(f"`{each}`" for each in names[:4])
    return Diagnostic(
        code=UNKNOWN_QUANTITY, message=f"`{name}` is {len(names)} numbers, each with a budget of its own", place=None,
        hint=f"ask for one of {shown}{' …' if len(names) > 4 else ''}, or for `.budgets({name!r})`",
    )  # fmt: skip
