"""What may be wrong with what installed packages add."""

from __future__ import annotations

from mbm.text.faults import REASON_LENGTH, shown
from mbm.text.types import Code, Diagnostic, Span

BROKEN_PLUG_IN = Code(
    "broken-plug-in",
    "An installed package announces a closed form, a reader or a function that cannot be loaded, or is none.",
    "Update or remove the package.",
)


def broken_plug_in(span: Span | None, name: str, group: str, package: str, reason: str) -> Diagnostic:
    """An entry point that cannot be loaded, or leads to something else."""
    where = shown(package)
    return Diagnostic(
        code=BROKEN_PLUG_IN,
        message=f"`{shown(name)}` of the package `{where}` cannot be used: {shown(reason, REASON_LENGTH)}",
        place=span,
        hint=f"update or remove `{where}`, which announces it as an entry point of `{group}`",
    )
