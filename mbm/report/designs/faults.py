"""What can be wrong where an experiment is planned."""

from __future__ import annotations

from dataclasses import replace

from mbm.text.suggest import suggestion
from mbm.text.types import Code, Diagnostic, Severity, Span

NOT_DESIGNED = Code(
    "not-designed",
    "The accuracy to expect is computed for one solve of a problem with stated noise, from its equations at one point.",
    "Ask for a problem without `states`, say with `--solve` which of many solves is meant, and state what is named.",
)
NO_CANDIDATES = Code(
    "no-candidates",
    "The candidates are rows of a table that an observation uses; no table has these columns, or several have.",
    "Give all columns of the table of the observation but the measured one, and name it with `--observation`.",
)
DESIGN_ASSUMED = Code(
    "design-assumed",
    "Something that the accuracy to expect depends on was not given, and had to be assumed.",
    "Give it: values with `--at`, the noise factor in a document given there or as a stated `:sigma`.",
)


def not_designed(why: str, hint: str) -> Diagnostic:
    """A problem that is not planned with."""
    return Diagnostic(code=NOT_DESIGNED, message=f"no accuracy is expected: {why}", place=None, hint=hint)


def no_candidates(why: str, hint: str) -> Diagnostic:
    """Candidates that are rows of no table, or cannot be chosen among."""
    return Diagnostic(code=NO_CANDIDATES, message=why, place=None, hint=hint)


def unread(found: Diagnostic, given: str, tables: tuple[str, ...]) -> Diagnostic:
    """What is wrong with a file of candidates, said of the option and not of the table whose rows they are."""
    if not isinstance(found.place, Span):
        return found
    hint = suggestion(given, tables, f"name a file, or a table: {', '.join(f'`{each}`' for each in tables)}")
    return replace(found, message=f"`--candidates`: {found.message}", place=None, labels=(), hint=hint)


def unknown_clause(name: str, known: tuple[str, ...]) -> Diagnostic:
    """An observation that is none."""
    hint = suggestion(name, known, "the observations are " + ", ".join(f"`{each}`" for each in known))
    return no_candidates(f"`{name}` is no observation with a table", hint)


def assumed(what: str, hint: str) -> Diagnostic:
    """An assumption that counts."""
    return Diagnostic(code=DESIGN_ASSUMED, message=what, place=None, severity=Severity.WARNING, hint=hint)
