"""Diagnostics of what is made of several rows of a table: aggregates."""

from __future__ import annotations

from mbm.language import faults as language_faults
from mbm.text.types import Code, Diagnostic, Span

AGGREGATE_MISPLACED = Code(
    "aggregate-misplaced",
    "An aggregate over the rows of a table (`mean rms median min max quantile count`) stands where none can be made.",
    "Write it in `derive` or `constraints`.",
)
EMPTY_AGGREGATE = Code(
    "empty-aggregate",
    "An aggregate in a constraint is over a table that has no rows, perhaps with the key of one solve of `for-each` or "
    "`window` only: nothing has no mean and no maximum, so that the constraint says nothing.",
    "Look at the data, at `:where` and at the keys; leave keys without rows out of the other tables.",
)


def aggregate_misplaced(span: Span, kind: str) -> Diagnostic:
    """An aggregate outside of `derive` and `constraints`."""
    return Diagnostic(
        code=AGGREGATE_MISPLACED,
        message=f"`{kind}` over the rows of a table stands in `derive` and `constraints` only", place=span,
        hint="derive it; equations speak of one row at a time",
    )  # fmt: skip


def aggregate_of_nothing(span: Span | None, table: str) -> Diagnostic:
    """An aggregate in a constraint over a table without rows, at all or in one solve."""
    return Diagnostic(
        code=EMPTY_AGGREGATE, message=f"`{table}` has no rows here, so that its aggregate in a constraint has no value",
        place=span, hint=EMPTY_AGGREGATE.mend,
    )  # fmt: skip


def cell_of_divided_rows(span: Span, column: str, table: str) -> Diagnostic:
    """A cell that decides what the formula of an aggregate is, where each solve has rows of its own."""
    return Diagnostic(
        code=language_faults.NOT_STATIC, place=span,
        message=f"the value of column `{column}` is needed here to compile, but `for-each` or `window` divides "
        f"`{table}`, and one formula is for the rows of every solve",
        hint="say it by a column of numbers: `(* is-x a)` with 1 and 0, `(if (= kind 1) a b)`",
    )  # fmt: skip


def aggregate_as_time(span: Span) -> Diagnostic:
    """An aggregate in the time at which a table is sampled."""
    return Diagnostic(
        code=AGGREGATE_MISPLACED, message="the time of `sample` cannot hold an aggregate over the rows of a table",
        place=span, hint="give the time by columns, constants and unknowns",
    )  # fmt: skip
