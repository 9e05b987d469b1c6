"""What can be wrong with a simulation: codes and constructors."""

from __future__ import annotations

import shlex
from collections.abc import Iterable

from mbm.text.types import Code, Diagnostic, Place, Severity, Span

UNCLEAR_MEASUREMENT = Code(
    "unclear-measurement",
    "`mbm simulate` replaces what was measured, but the equation does not say which of its columns that is.",
    "Write `(= MEASURED MODEL)`, or name the columns: `--measured OBSERVATION=column,column`.",
)
NOT_SIMULATED = Code(
    "not-simulated",
    "No values of the measured columns make the equation hold with the noise that was drawn.",
    "Check that the measured side holds a column for each component, and that the model has a value there.",
)
MEASURED_ELSEWHERE = Code(
    "measured-elsewhere",
    "A simulated column is also used in another role. Where it is joined by `:with`, stands in `first` or `last`, or "
    "is measured a second time in the same row, its old values would stay; where it is a key, in `for-each`, or "
    "decides which equation a row has, its new values would mean other things.",
    "Give the other use a column of its own.",
)
NO_TRUE_VALUE = Code(
    "no-true-value",
    "Measurements can only be simulated at known values, and an unknown has neither a value in `--at` nor a start.",
    "Add it to the values given with `--at`, or give it `:init`.",
)
ASSUMED_VALUE = Code(
    "assumed-value",
    "Unknowns without a value in `--at` are simulated at their starts (a warning).",
    "Add them to the values given with `--at`.",
)
ASSUMED_NOISE = Code(
    "assumed-noise",
    "The noise of an observation is unknown, so that its factor is taken as 1 (a warning).",
    "Give it with `--noise OBSERVATION=value`, or simulate at a result document, which holds it.",
)
VALUES_AGAINST_CONSTRAINT = Code(
    "values-against-constraint",
    "The values to simulate at do not meet a constraint of the problem, so that no estimate that meets it can come "
    "back to them (a warning).",
    "Give values with `--at` that meet it: those of a solve do.",
)
KEPT_EQUATION = Code(
    "kept-equation",
    "An observation holds no column of data, so there is nothing to simulate in it: its text stays (a warning).",
    "Put what was measured into a table.",
)
UNKNOWN_OBSERVATION = Code(
    "unknown-observation",
    "The call names an observation, or a column of one, that is not there.",
    "Correct the name; `mbm explain` lists the observations.",
)


def unclear_measurement(span: Span, name: str, columns: Iterable[str]) -> Diagnostic:
    """``columns`` are those that the equation of the observation ``name`` uses."""
    listed = ", ".join(f"`{column}`" for column in columns)
    return Diagnostic(
        code=UNCLEAR_MEASUREMENT,
        message=f"it is not clear which column this equation of `{name}` measures; it uses {listed}",
        place=span,
        hint=f"write `(= MEASURED MODEL)`, or say `--measured {name}=COLUMN`",
    )


def not_simulated(span: Span, name: str, columns: Iterable[str], place: Place | None) -> Diagnostic:
    """The equation could not be solved for its measured columns; ``place`` is a row where it could not."""
    listed = ", ".join(f"`{column}`" for column in columns)
    where = "" if place is None else f" (first at {_place(place)})"
    return Diagnostic(
        code=NOT_SIMULATED,
        message=f"this equation of `{name}` cannot be solved for {listed}{where}",
        place=span,
        hint=NOT_SIMULATED.mend,
    )


def noise_lost(name: str, wrong: Diagnostic) -> Diagnostic:
    """The noise of the observation ``name`` is stated by simulated columns, which would be ``wrong``."""
    return Diagnostic(
        code=NOT_SIMULATED,
        message=f"the noise of `{name}` is stated by simulated columns: {wrong.message} in the simulated data",
        place=wrong.place,
        labels=wrong.labels,
        hint="give the noise a column that is not measured, or simulate less noise",
    )


def not_drawn(span: Span, name: str) -> Diagnostic:
    """The prior ``name`` says nothing at the values that are to be drawn from it."""
    return Diagnostic(
        code=NOT_SIMULATED,
        message=f"nothing can be drawn from `{name}`, which has no finite value or derivative at the true values",
        place=span,
        hint="give values with `--at` at which it has one",
    )


def not_carried(span: Span, column: str, step: str) -> Diagnostic:
    """No transition leads to a step."""
    return Diagnostic(
        code=NOT_SIMULATED,
        message=f"the transitions do not lead to the step {column} = {step} from the one before",
        place=span,
        hint="give every state a start with `:init` or `--at`; each transition should have a value there",
    )


def _place(place: Place) -> str:
    if isinstance(place, Span):
        return f"line {place.line}"
    return place.file if place.row is None else f"{place.file}, row {place.row}"


def measured_elsewhere(span: Span, column: str, how: str) -> Diagnostic:
    """``how`` the measured column is used besides."""
    return Diagnostic(
        code=MEASURED_ELSEWHERE,
        message=f"the measured column `{column}` is also {how}",
        place=span,
        hint=MEASURED_ELSEWHERE.mend,
    )


def no_true_value(span: Span, name: str) -> Diagnostic:
    """An unknown without any value."""
    return Diagnostic(
        code=NO_TRUE_VALUE,
        message=f"`{name}` has no value to simulate at",
        place=span,
        hint="add it to the values given with `--at`, or give it `:init`",
    )


def assumed_value(names: Iterable[str]) -> Diagnostic:
    """Unknowns that were simulated at their starts."""
    listed = ", ".join(f"`{name}`" for name in names)
    return Diagnostic(
        code=ASSUMED_VALUE,
        message=f"simulated at the start, since no value was given: {listed}",
        hint=ASSUMED_VALUE.mend,
        severity=Severity.WARNING,
    )


def assumed_noise(span: Span, name: str) -> Diagnostic:
    """An unknown noise factor that was taken as 1."""
    return Diagnostic(
        code=ASSUMED_NOISE,
        message=f"the noise factor of `{name}` is unknown and taken as 1",
        place=span,
        hint=f"give it with `--noise {shlex.quote(name)}=value`",
        severity=Severity.WARNING,
    )


def assumed_independence(span: Span, name: str) -> Diagnostic:
    """An unknown correlation or covariance that was taken for none."""
    return Diagnostic(
        code=ASSUMED_NOISE,
        message=f"the correlation of the noise of `{name}` is unknown and taken as none",
        place=span,
        hint="simulate at a result document, which holds it",
        severity=Severity.WARNING,
    )


def values_against_constraint(span: Span, name: str) -> Diagnostic:
    """True values that violate the constraint ``name``."""
    return Diagnostic(
        code=VALUES_AGAINST_CONSTRAINT,
        message=f"the values to simulate at do not meet the constraint `{name}`",
        place=span,
        hint=VALUES_AGAINST_CONSTRAINT.mend,
        severity=Severity.WARNING,
    )


def kept_equation(span: Span, name: str) -> Diagnostic:
    """An observation without columns."""
    return Diagnostic(
        code=KEPT_EQUATION,
        message=f"an equation of `{name}` holds no column, so nothing in it is simulated",
        place=span,
        hint=KEPT_EQUATION.mend,
        severity=Severity.WARNING,
    )


def unknown_observation(name: str, known: Iterable[str], what: str = "observation") -> Diagnostic:
    """``name`` is no ``what`` (observation, column)."""
    listed = ", ".join(f"`{each}`" for each in known)
    return Diagnostic(
        code=UNKNOWN_OBSERVATION,
        message=f"there is no {what} `{name}`",
        hint=f"there are {listed}" if listed else None,
    )
