"""What can be wrong when results are written or initial values are read: codes and constructors."""

from __future__ import annotations

from mbm.text.types import Code, DataPlace, Diagnostic

MISSING_EXTRA = Code(
    "missing-extra",
    "What was asked for needs a library that the core installation leaves out.",
    "Install mbm with the extra that the message names.",
)
PLOT_FORMAT = Code(
    "plot-format",
    "The name of a plot ends in no picture format that can be drawn.",
    "End the name in .png, .svg or .pdf.",
)
BAD_INITIAL_VALUES = Code(
    "bad-initial-values",
    "Initial values are a JSON object from names to values (a number, nested lists, or `{keys, value}`), or a result "
    "document; something else was given.",
    'Write for instance `{"p": [1, 1, 1]}`, or give the document that `mbm solve --json` wrote.',
)


def missing_extra(what: str, extra: str) -> Diagnostic:
    """``what`` needs the optional dependencies ``extra``."""
    return Diagnostic(
        code=MISSING_EXTRA,
        message=f"{what} needs libraries that are not installed",
        hint=f'install them with `pip install "mbm[{extra}]"`',
    )


def plot_format(path: str, known: str) -> Diagnostic:
    """The ending of ``path`` is none of those that can be drawn."""
    return Diagnostic(
        code=PLOT_FORMAT, message=f"`{path}` names no picture format", hint=f"end the name in one of {known}"
    )


def bad_initial_value(name: str, what: str, file: str | None = None) -> Diagnostic:
    """The initial value of ``name`` cannot be read; ``what`` says what it is instead."""
    return Diagnostic(
        code=BAD_INITIAL_VALUES,
        message=f"the initial value of `{name}` is {what}",
        place=None if file is None else DataPlace(file=file),
        hint="write a number, lists of numbers, or an object with `keys` and `value`",
    )


def bad_initial_values(what: str, file: str | None = None) -> Diagnostic:
    """The whole is no mapping and no result document."""
    return Diagnostic(
        code=BAD_INITIAL_VALUES,
        message=f"the initial values are {what}",
        place=None if file is None else DataPlace(file=file),
        hint='write an object such as `{"p": [1, 1, 1]}`, or give a result document',
    )
