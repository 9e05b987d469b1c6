"""Diagnostics of the data, the units and the unknowns: what does not go together once tables are read.

Temperatures on scales with a zero of their own (degC, degF) are no differences of temperatures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import Enum

from mbm.expression.nodes import Constant, Number
from mbm.problem.previous import column_before
from mbm.text.printer import plain_number
from mbm.text.suggest import did_you_mean
from mbm.text.types import Code, Diagnostic, Label, Place, Severity, Span

TEMPERATURE_AND_DIFFERENCE = Code(
    "temperature-and-difference",
    "A temperature in degC or degF, which is kept in kelvin (`20degC` is 293.15 K), stands for a difference of"
    " temperatures, such as a standard deviation; or a difference for a temperature. `0.1degC` is 273.25 K.",
    "Write differences in K, or in degR, which is a difference of one degree Fahrenheit: `:sigma 0.1K`, `(+ t 5K)`. The"
    " difference of two temperatures, `(- t 20degC)`, is one.",
)


def temperature_for_difference(place: Span | None, literal: Number | Constant) -> Diagnostic:
    """A temperature that was written, such as ``0.1degC``, where a difference is wanted."""
    text = literal.name if isinstance(literal, Constant) else "" if place is None else place.text
    kelvin = f"{float(literal.value):.12g}K"
    difference = next((f"{text.removesuffix(u)}{d}" for u, d in _DIFFERENCES if text.endswith(u)), None)
    hint = "take the difference of two temperatures" if difference is None else f"write the difference: `{difference}`"
    return Diagnostic(
        code=TEMPERATURE_AND_DIFFERENCE, place=place, hint=hint,
        message=f"`{text}` is the temperature {kelvin}, and here a difference of temperatures is wanted",
    )  # fmt: skip


_DIFFERENCES = (("degC", "K"), ("°C", "K"), ("degF", "degR"), ("°F", "degR"))


def temperature_without_unit(place: Span | None, literal: Number | Constant) -> Diagnostic:
    """A number without a unit beside a temperature in degC: it would be in kelvin."""
    number = f"{float(literal.value):.12g}"
    what = f"`{literal.name}`" if isinstance(literal, Constant) else number
    return Diagnostic(
        code=TEMPERATURE_AND_DIFFERENCE, place=place,
        message=f"{what} has no unit, and would be {number} K beside temperatures in degC or degF",
        hint=f"write the unit: `{number}degC`, `{number}K`",
    )  # fmt: skip


def difference_for_temperature(place: Span | None) -> Diagnostic:
    """A difference where a temperature is wanted."""
    return Diagnostic(
        code=TEMPERATURE_AND_DIFFERENCE, place=place,
        message="this is a difference or a multiple of temperatures, and a temperature is wanted",
        hint="add it to a temperature: `(+ 20degC …)`",
    )  # fmt: skip


def zero_counts(place: Span | None, what: str) -> Diagnostic:
    """What is stated in degC stands for a difference, or for several temperatures."""
    return Diagnostic(
        code=TEMPERATURE_AND_DIFFERENCE, place=place,
        message=f"{what} is a temperature in degC or degF, and here a difference of temperatures is wanted",
        hint="state it in K if it is a difference, or take one: `(- t 0degC)`; a number beside it has a unit: `0degC`",
    )  # fmt: skip


def reported_difference(place: Span | None, name: str, unit: str) -> Diagnostic:
    """A derived difference of temperatures that is to be reported in degC."""
    return Diagnostic(
        code=TEMPERATURE_AND_DIFFERENCE, place=place,
        message=f"`{name}` is a difference, a multiple or a root mean square of temperatures, and {unit} counts from a "
        "zero of its own",
        hint="report it in K: `:unit K`",
    )  # fmt: skip


def no_temperature(place: Span | None, name: str, kind: str) -> Diagnostic:
    """A pose in degC."""
    return Diagnostic(
        code=TEMPERATURE_AND_DIFFERENCE, place=place, message=f"`{name}` is a {kind}, and no temperature",
        hint="state a length, or none",
    )  # fmt: skip


UNIT_CLASH = Code(
    "unit-clash",
    "Two known dimensions that should be one are different: a length plus a time, a column used as both.",
    "Correct a unit, or convert.",
)
MIXED_UNITS = Code(
    "mixed-units",
    "The cells of an inline table have different units in one column, or some have none; or `:columns` gives it too.",
    "Give all cells of a column units of one dimension, or none and `:columns ((column :unit u))`.",
)
MISSING_UNIT = Code(
    "missing-unit",
    "With `--strict-units`, every column and every unknown states its unit; this one does not.",
    "Add `:unit`.",
)
DANGLING_KEY = Code(
    "dangling-key",
    "A cell should be the key of a row of another table, or of a member of a family, but no such key exists.",
    "Correct the cell, or add the row.",
)
NOT_FINITE_CELL = Code(
    "not-finite-cell",
    "A cell that an equation, a condition, `for-each`, `window` or what is derived uses is empty, NaN or infinite.",
    "Correct it; leave such rows out of an observation with `:when (finite column)`, of a table with "
    "`:where (finite column)` or `:missing skip`.",
)
NO_ROWS = Code(
    "no-rows", "An observation has no rows to use, so it says nothing (a warning).", "Look at the data and at `:when`."
)
BAD_BOUNDS = Code("bad-bounds", "A lower bound is not below the upper bound.", "Exchange or widen them.")
MISSING_START = Code(
    "missing-start",
    "An unknown has neither `:init` nor a range, and no start can be found: it is fixed, so that nothing may be chosen "
    "for it, or no closed form applies and random points do not help: more than three rotations of space would have to "
    "be guessed at once, or no point gives the equations a finite value.",
    "Give `:init`, or a range `:in (lo hi)` in which the equations have values.",
)
UNMENTIONED = Code(
    "unmentioned",
    "No equation mentions an unknown, so nothing can be said about it (a warning).",
    "Use it in an equation, give it a prior with `:sigma`, or remove it.",
)
TOO_FEW_EQUATIONS = Code(
    "too-few-equations",
    "The structure of the equations cannot determine all unknowns, whatever the numbers are (a warning).",
    "Add observations or priors, or fix an unknown.",
)
FIXED_NOWHERE = Code(
    "fixed-nowhere",
    "The condition `:fixed` holds for no member of a family, so that all of them are estimated (a warning).",
    "Correct the condition, perhaps the spelling of a key, or leave `:fixed` out.",
)
TABLE_WITHOUT_KEY = Code(
    "table-without-key",
    "Rows of a table are to be found by their key (by `:with`, or as members of a family), but the table has none.",
    "Add `:key column` to its data clause; a family may also range over a column: `:per table.column`.",
)
DERIVED_ELSEWHERE = Code(
    "derived-elsewhere",
    "A quantity that is derived for each row of a table is used where there is no row of that table.",
    "Use it in quantities that are `:over` the same table.",
)
BAD_TIME = Code(
    "bad-time",
    "Tables are laid on one another by a column of times that is no column of numbers, or has one time twice where "
    "values are to be found between times.",
    "Give times as numbers (seconds since some start); leave repeated rows out with `:where`.",
)
_KEYS_SHOWN = 5
"""Values of a key that a message lists: enough to see what they are."""


def unmentioned(span: Span, name: str) -> Diagnostic:
    """An unknown without an equation."""
    return Diagnostic(
        code=UNMENTIONED, message=f"no equation mentions the unknown `{name}`", place=span, severity=Severity.WARNING,
        hint="use it in an equation, give it a prior with `:sigma`, or remove it",
    )  # fmt: skip


def fixed_nowhere(span: Span, name: str, members: int) -> Diagnostic:
    """A condition that holds for none of the ``members`` of a family."""
    return Diagnostic(
        code=FIXED_NOWHERE,
        message=f"`:fixed` of `{name}` holds for none of its {_counted(members, 'member')}: all are estimated",
        place=span, severity=Severity.WARNING, hint="correct the condition, or leave `:fixed` out",
    )  # fmt: skip


def too_few_equations(span: Span, name: str, equations: int, unknowns: int) -> Diagnostic:
    """An unknown that the structure leaves over."""
    return Diagnostic(
        code=TOO_FEW_EQUATIONS,
        message=f"`{name}` has no equation of its own: {_counted(equations, 'scalar equation')}, "
        f"{_counted(unknowns, 'scalar unknown')}",
        place=span, severity=Severity.WARNING, hint="add observations or priors, or fix an unknown",
    )  # fmt: skip


def table_without_key(span: Span, table: str) -> Diagnostic:
    """Rows that cannot be named."""
    return Diagnostic(
        code=TABLE_WITHOUT_KEY, message=f"the table `{table}` has no key to find its rows by", place=span,
        hint=f"add `:key column` to `(data {table} …)`",
    )  # fmt: skip


def derived_elsewhere(span: Span, name: str, table: str) -> Diagnostic:
    """A value per row where there is no row."""
    return Diagnostic(
        code=DERIVED_ELSEWHERE, message=f"`{name}` is derived for each row of `{table}`; there is no such row here",
        place=span, hint=f"use it in quantities with `:over {table}`",
    )  # fmt: skip


def unit_clash(span: Span | None, left: str, right: str, labels: tuple[Label, ...]) -> Diagnostic:
    """Two dimensions that should be one."""
    return Diagnostic(
        code=UNIT_CLASH, message=f"{left} does not go with {right}", place=span, labels=labels,
        hint="correct a unit, or convert",
    )  # fmt: skip


def mixed_units(span: Span, column: str, units: tuple[str, str], other: Span) -> Diagnostic:
    """Cells of a column in two units."""
    return Diagnostic(
        code=MIXED_UNITS, place=span, labels=(Label(other, "first given here"),),
        message=f"the cells of `{column}` have the units {units[0] or '1'} and {units[1] or '1'}; use one",
        hint="write all cells in one unit",
    )  # fmt: skip


def cell_without_unit(span: Span, column: str, unit: str, other: Span) -> Diagnostic:
    """A number without a unit in a column whose other cells state one; a zero, if theirs has another than SI."""
    return Diagnostic(
        code=MIXED_UNITS, place=span, labels=(Label(other, "a cell that has a unit"),),
        message=f"a cell of `{column}` has no unit, others have {unit or 'one'}; use one",
        hint="write the unit of each cell",
    )  # fmt: skip


def unit_given_twice(span: Span, column: str, other: Span, where: str = "its cells") -> Diagnostic:
    """A column that has a unit ``where`` the table is from, and one in ``:columns`` too."""
    return Diagnostic(
        code=MIXED_UNITS, message=f"the unit of `{column}` is given in {where} and in `:columns`", place=span,
        labels=(Label(other, "first given here"),), hint="give it once",
    )  # fmt: skip


def impure(span: Span | None, what: str, labels: tuple[Label, ...]) -> Diagnostic:
    """A dimension where a pure number is wanted: in a sine, as an exponent."""
    return Diagnostic(
        code=UNIT_CLASH, message=f"{what} stands where a pure number is wanted", place=span, labels=labels,
        hint="divide by something of the same dimension",
    )  # fmt: skip


def missing_unit(span: Span | None, what: str) -> Diagnostic:
    """A unit that strictness asks for."""
    return Diagnostic(code=MISSING_UNIT, message=f"{what} states no unit", place=span, hint="add `:unit`")


def dangling_key(
    place: Place | None, cell: str | float, where: str, near: str | None, used: Span | None, joined: bool = False
) -> Diagnostic:
    """A key without a row; tables are ``joined`` before `:where` and `:when` leave rows out."""
    leave = "`:missing skip`" if joined else "`:when` or `:missing skip`"
    without = f"give the key, or leave such rows out with {leave}"
    return Diagnostic(
        code=DANGLING_KEY, message=f"{_cell(cell)} is no key of {where}", place=place,
        hint=did_you_mean(near, None if cell == cell and cell != "" else without),
        labels=(Label(used, "used as a key here"),) if used is not None else (),
    )  # fmt: skip


class Leave(Enum):
    """What leaves rows with gaps out; ``{}`` is the column."""

    OBSERVED = "leave such rows out with `:when (finite {})` or `:missing skip`"
    EVERYWHERE = "leave such rows out with `:where (finite {})` or `:missing skip` in the data clause"
    ASKED = "ask first: `(and (finite {}) …)`"


def not_finite_cell(
    place: Place, column: str, value: float, used: Span | None, leave: Leave = Leave.EVERYWHERE
) -> Diagnostic:
    """A gap in what is used; ``leave`` says how it may be left out there."""
    what = "empty or not a number" if value != value else "infinite"
    before = column_before(column)
    shown = column if before is None else f"(previous {before})"
    return Diagnostic(
        code=NOT_FINITE_CELL, message=f"a cell of `{shown}` that is used is {what}", place=place,
        hint=f"correct it, or {leave.value.format(shown)}",
        labels=(Label(used, "used here"),) if used is not None else (),
    )  # fmt: skip


def bad_time(place: Place, column: str, cell: str, used: Span) -> Diagnostic:
    """A text where a time is wanted."""
    return Diagnostic(
        code=BAD_TIME, message=f"`{column}` holds the text `{cell}`, where a time as a number is wanted", place=place,
        labels=(Label(used, "the column of times here"),), hint="give times as numbers, in seconds since some start",
    )  # fmt: skip


def repeated_time(place: Place, other: Place, column: str, time: float, used: Span) -> Diagnostic:
    """Two rows at one time, so that nothing lies between them."""
    return Diagnostic(
        code=BAD_TIME, message=f"two rows have the time {time:.17g} in `{column}`, and values between times are wanted",
        place=place, labels=(Label(other, "first here"), Label(used, "the column of times here")),
        hint="leave one of them out; runs with a clock of their own are told apart by a column in `for-each`",
    )  # fmt: skip


def too_few_times(span: Span, table: str, rows: int) -> Diagnostic:
    """Nothing to find values between."""
    shown = "no row" if rows == 0 else "one row only"
    return Diagnostic(
        code=BAD_TIME, message=f"`{table}` has {shown}, and values between times are wanted", place=span,
        hint="two rows at different times are needed at least",
    )  # fmt: skip


def undecided(span: Span) -> Diagnostic:
    """A condition that a missing number leaves open."""
    return Diagnostic(
        code=NOT_FINITE_CELL, message="this condition depends on a number that is missing", place=span,
        hint="ask with `(finite column)` whether it is there",
    )  # fmt: skip


def start_not_positive(span: Span, name: str) -> Diagnostic:
    """A start that the type forbids."""
    return Diagnostic(
        code=BAD_BOUNDS, message=f"`{name}` is positive, but its start is not above zero", place=span,
        hint="give a start above zero, or the type `real`",
    )  # fmt: skip


def no_rows(span: Span, name: str) -> Diagnostic:
    """An observation of nothing."""
    return Diagnostic(
        code=NO_ROWS, message=f"the observation `{name}` has no rows to use", place=span, severity=Severity.WARNING,
        hint="look at the data, and at `:when` and `:where`",
    )  # fmt: skip


def no_common_key(span: Span, pair: str, column: str, held: Mapping[str, Sequence[str | float]]) -> Diagnostic:
    """A pair of tables that share no key; ``held`` are the values of each."""
    sides = (
        f"`{table}` ({', '.join(map(_cell, values[:_KEYS_SHOWN]))}{', …' if len(values) > _KEYS_SHOWN else ''})"
        for table, values in held.items()
    )
    message = f"the pair `{pair}` has no rows: no value of the column `{column}` is in {' and in '.join(sides)}"
    return Diagnostic(
        code=NO_ROWS, message=message, place=span, severity=Severity.WARNING,
        hint=f"no pair crosses a key, which is the column `{column}` of each table that has one: call it otherwise "
        f"where it is something else, `(data … :columns ((other {column})))`",
    )  # fmt: skip


def bad_bounds(span: Span, name: str) -> Diagnostic:
    """Bounds the wrong way round."""
    return Diagnostic(code=BAD_BOUNDS, message=f"the lower bound of `{name}` is not below its upper bound", place=span)


def missing_start(span: Span, name: str, *, others: bool = False) -> Diagnostic:
    """A start that cannot be found; ``others``: with it, the starts of other unknowns can."""
    hint = (
        f"Give `{name}` an `:init`: the starts of the other unknowns follow from it." if others else MISSING_START.mend
    )
    return Diagnostic(
        code=MISSING_START, message=f"`{name}` has no start, and none can be found", place=span, hint=hint
    )


def _cell(cell: str | float) -> str:
    return f"`{cell}`" if isinstance(cell, str) else str(plain_number(cell))


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"
