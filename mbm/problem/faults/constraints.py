"""Diagnostics of constraints: what cannot hold, whatever is estimated."""

from __future__ import annotations

from mbm.text.types import Code, Diagnostic, Label, Place, Span

CONTRADICTION = Code(
    "contradiction",
    "A constraint holds no unknown, so it is decided before the solve; and it does not hold.",
    "Correct its numbers or the cells that it uses, or remove it.",
)


def contradiction(span: Span, left: float, right: float, sign: str, place: Place | None) -> Diagnostic:
    """A constraint between known numbers that is false; ``place`` is the row of data that makes it so."""
    return Diagnostic(
        code=CONTRADICTION,
        message=f"this constraint never holds: {left:g} {sign} {right:g} is false",
        place=span,
        labels=(Label(place, "for this row"),) if place is not None else (),
        hint="correct the numbers, or remove it",
    )
