"""What can be wrong when estimates are written in the format of another program."""

from __future__ import annotations

from collections.abc import Sequence

from mbm.text.suggest import suggestion
from mbm.text.types import Code, Diagnostic

FORMAT_NEEDS = Code(
    "format-needs",
    "The format that the estimates are to be written in needs something that the problem does not have.",
    "Choose a format that fits the problem, or write the unknowns and observations as the message says.",
)
UNKNOWN_OUTPUT = Code(
    "unknown-output",
    "Estimates cannot be written in a format of this name.",
    "Use one of the formats that `mbm solve --help` lists.",
)


def unknown_output(form: str, known: Sequence[str]) -> Diagnostic:
    """There is no such format among those ``known``."""
    hint = suggestion(form, known, f"one of {', '.join(known)}")
    return Diagnostic(code=UNKNOWN_OUTPUT, message=f"`{form}` is no format to write", hint=hint)


def format_needs(form: str, what: str) -> Diagnostic:
    """The problem lacks ``what``."""
    return Diagnostic(code=FORMAT_NEEDS, message=f"the format `{form}` needs {what}")


def format_has_no(form: str, what: str) -> Diagnostic:
    """The problem has something that the format cannot hold."""
    return Diagnostic(code=FORMAT_NEEDS, message=f"the format `{form}` has no {what}")
