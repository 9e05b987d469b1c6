"""Diagnostics of interval methods."""

from __future__ import annotations

from mbm.expression.nodes import Column, leaves
from mbm.problem.tables import Table
from mbm.problem.types import Equation
from mbm.text.types import Code, Diagnostic, Place, Span

BAD_BOUND = Code(
    "bad-bound",
    "A `:bound` is negative or no number in some row, so that no value could lie within it.",
    "Give a bound that is zero or positive; `:when (finite …)` leaves out rows without one.",
)
NOT_BOUNDED = Code(
    "not-bounded",
    "Interval methods search a box, and neither `:in` nor the constraints and observations bound an unknown.",
    "Give the unknown `:in (low high)`.",
)


def bad_bound(equation: Equation, table: Table | None, row: int | None, value: float) -> Diagnostic:
    """A bound that nothing lies within; ``row`` counts from 0 in the ``table``."""
    place: Place | None = equation.noise[0].span or equation.span
    if table is not None and row is not None:
        column = next((c for c in leaves(equation.noise) if isinstance(c, Column) and c.table == table.name), None)
        place = table.place(row, column.name) if column is not None else place
    return Diagnostic(code=BAD_BOUND, message=f"the bound is {value:g}, and should be zero or positive", place=place)


def not_bounded(span: Span, names: list[str]) -> Diagnostic:
    """Unknown numbers without a bound on one side."""
    listed = ", ".join(f"`{name}`" for name in names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
    message = f"nothing bounds {listed}"
    hint = "give `:in (low high)` to the unknown: interval methods search a box"
    return Diagnostic(code=NOT_BOUNDED, message=message, place=span, hint=hint)
