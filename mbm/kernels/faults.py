"""What may be wrong with a function in Python that a problem calls."""

from __future__ import annotations

from pathlib import Path

from mbm.text.faults import REASON_LENGTH, shown
from mbm.text.types import Code, Diagnostic, MbmError, Severity, Span

EXTERNAL_NOT_ALLOWED = Code(
    "external-not-allowed",
    "A problem calls a function in Python, and nobody has allowed it to: nothing was imported.",
    "Read the function. If you trust it, give `--allow-external`, or `allow_external=True` in Python.",
)
EXTERNAL_NOT_FOUND = Code(
    "external-not-found",
    "The module of a function in Python cannot be imported, or has no such function.",
    "Put the module beside the problem file, or install its package; compare the names.",
)
EXTERNAL_FAILED = Code(
    "external-failed",
    "A function in Python raised an exception, or gave something else than the numbers that the problem says.",
    "Correct the function. It may return NaN where it has no value.",
)
WRONG_JACOBIAN = Code(
    "wrong-jacobian",
    "The Jacobian that a problem gives for a function in Python is not that of its values, as their differences tell.",
    "Correct it: line i, column j is the derivative of value i by argument j, arguments counted element by element.",
)

_NOT_THEIRS = (Path(__file__).parent.name, "importlib")
"""Folders of the code that imports and calls: where that fails, it is not to blame."""


def external_not_allowed(span: Span, function: str, severity: Severity = Severity.ERROR) -> Diagnostic:
    """A call that was not made; a warning where nothing had to be called."""
    return Diagnostic(
        code=EXTERNAL_NOT_ALLOWED,
        message=f"`{shown(function)}` is a function in Python, and runs only where that is allowed",
        place=span,
        hint="if you trust it, give `--allow-external`, or `allow_external=True` in Python",
        severity=severity,
    )


def external_not_found(span: Span, function: str, reason: str) -> Diagnostic:
    """No module, or no function in it."""
    return Diagnostic(
        code=EXTERNAL_NOT_FOUND,
        message=f"`{shown(function)}` cannot be loaded: {shown(reason, REASON_LENGTH)}",
        place=span,
        hint="modules are looked for in the folder of the problem file, then where Python finds installed packages",
    )


def external_failed(span: Span, function: str, reason: str, arguments: str) -> Diagnostic:
    """A call that gave no numbers."""
    return Diagnostic(
        code=EXTERNAL_FAILED,
        message=f"`{shown(function)}` {shown(reason, REASON_LENGTH)}",
        place=span,
        hint=f"called with {shown(arguments, REASON_LENGTH)}",
    )


def is_failed_call(error: MbmError) -> bool:
    """Whether a function in Python failed: a fault of the program, whichever rows show it."""
    return any(diagnostic.code is EXTERNAL_FAILED for diagnostic in error.diagnostics)


def exception_text(error: BaseException) -> str:
    """Kind and text of an exception, and the line that raised it: ``ValueError: math domain error (helper.py:12)``."""
    import traceback  # by failed calls only, so that others begin at once

    text = "".join(traceback.format_exception_only(error)[-1:]).strip()
    every = [(Path(frame.filename), frame.lineno) for frame in traceback.extract_tb(error.__traceback__)]
    own = [(path, line) for path, line in every if path.is_file() and path.parent.name not in _NOT_THEIRS]
    return text if not own else f"{text} ({own[-1][0].name}:{own[-1][1]})"


def wrong_jacobian(span: Span, jacobian: str, place: tuple[int, int], given: float, found: float) -> Diagnostic:
    """A derivative that the differences of the values contradict; ``place`` counts from 1: value, argument."""
    value, argument = place
    return Diagnostic(
        code=WRONG_JACOBIAN,
        message=f"`{shown(jacobian)}` gives {given:.6g} for the derivative of value {value} by argument {argument}, "
        f"differences of the values {found:.6g}",
        place=span,
        hint="correct it, or leave `:jacobian` out; arguments are counted element by element",
        severity=Severity.WARNING,
    )
