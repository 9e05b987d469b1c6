"""What can be wrong with a call: codes and constructors."""

from __future__ import annotations

from collections.abc import Iterable

from mbm.language.faults import NOT_AVAILABLE_YET
from mbm.text.suggest import suggestion
from mbm.text.types import Code, Diagnostic

BAD_CALL = Code(
    "bad-call",
    "The command line cannot be read: an unknown option, a missing argument, or a value of the wrong kind.",
    "`mbm COMMAND --help` lists what a command takes.",
)
BAD_JSON = Code(
    "bad-json",
    "A file that is to hold JSON does not.",
    "Mend it at the place that the message names.",
)
INTERNAL_FAULT = Code(
    "internal-fault",
    "A fault of mbm itself: the mistake is not in the problem, the data or the call.",
    "Please report it with the problem file; `mbm -v` shows where in mbm it happened.",
)


def bad_call(message: str, command: str) -> Diagnostic:
    """``message`` is what the argument parser says, ``command`` what was called (``mbm solve``)."""
    text = message.strip().rstrip(".")
    return Diagnostic(code=BAD_CALL, message=text[:1].lower() + text[1:], hint=f"`{command} --help` says what it takes")


def unknown_command(name: str, known: Iterable[str]) -> Diagnostic:
    """No command is called ``name``."""
    hint = suggestion(name, known, "`mbm --help` lists the commands")
    return Diagnostic(code=BAD_CALL, message=f"`{name}` is no command", hint=hint)


def not_available_yet(what: str) -> Diagnostic:
    """``what`` is a command or option of a later version."""
    return Diagnostic(code=NOT_AVAILABLE_YET, message=f"`{what}` is not available yet")


def bad_json(path: str, problem: str) -> Diagnostic:
    """``problem`` says what and where."""
    return Diagnostic(code=BAD_JSON, message=f"`{path}` is no JSON: {problem}", hint="mend the file")


def internal_fault(error: BaseException) -> Diagnostic:
    """Anything that nobody foresaw."""
    text = str(error).splitlines()[0] if str(error) else "no message"
    return Diagnostic(
        code=INTERNAL_FAULT,
        message=f"internal fault in mbm ({type(error).__name__}: {text})",
        hint="this is not your mistake: please report it with the problem file; `-v` shows the traceback",
    )
