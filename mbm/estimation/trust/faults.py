"""What a solve may have to say against its own answer."""

from __future__ import annotations

from collections.abc import Sequence

from mbm.text.types import Code, Diagnostic, Label, Severity, Span

CONTRADICTING_ROWS = Code(
    "contradicting-rows",
    "Rows of a pose graph contradict the others, as false loop closures do: least squares bends all that they span, "
    "and the answer is that of neither. The status is `not-converged`.",
    "Check the rows that are named; leave them out with `:when`, or reject them by "
    "`:robust (gnc :quantile 99% :trust FORM)`.",
)
MOST_LISTED = 6
"""Rows that the message lists."""


def contradicting_rows(
    span: Span, name: str, rows: Sequence[tuple[int, float]], cost: float, worst: Label
) -> Diagnostic:
    """Of each of the ``rows`` of the clause ``name``, the worst first, what χ², ``cost``, falls by without it."""
    more = f" and {len(rows) - MOST_LISTED:,} more" if len(rows) > MOST_LISTED else ""
    listed = ", ".join(f"{row} ({fall:.3g})" for row, fall in rows[:MOST_LISTED])
    what = f"rows {listed}{more} contradict" if len(rows) > 1 else f"row {listed} contradicts"
    return Diagnostic(
        code=CONTRADICTING_ROWS,
        message=f"{what} the others of `{name}` (in brackets what chi², {cost:.3g}, falls by without it)",
        place=span,
        labels=(worst,),
        hint=CONTRADICTING_ROWS.mend,
        severity=Severity.WARNING,
    )
