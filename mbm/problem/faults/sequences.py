"""Diagnostics of sequences and of aggregates: states, transitions, and rows of tables."""

from __future__ import annotations

from mbm.language import faults as language_faults
from mbm.text.suggest import suggestion
from mbm.text.types import Code, Diagnostic, Label, Place, Span

AGGREGATE_MISPLACED = Code(
    "aggregate-misplaced",
    "An aggregate over the rows of a table (`mean rms median min max quantile count`) stands where none can be made.",
    "Write it in `derive` or `constraints`.",
)
EMPTY_AGGREGATE = Code(
    "empty-aggregate",
    "An aggregate in a constraint is over a table that has no rows, perhaps with the key of one solve of `for-each` or "
    "`window` only: nothing has no mean and no maximum, so that the constraint says nothing.",
    "Look at the data, at `:where` and at the keys; leave keys without rows out of the other tables.",
)


def aggregate_misplaced(span: Span, kind: str) -> Diagnostic:
    """An aggregate outside of `derive` and `constraints`."""
    return Diagnostic(
        code=AGGREGATE_MISPLACED,
        message=f"`{kind}` over the rows of a table stands in `derive` and `constraints` only", place=span,
        hint="derive it; equations speak of one row at a time",
    )  # fmt: skip


def aggregate_of_nothing(span: Span | None, table: str) -> Diagnostic:
    """An aggregate in a constraint over a table without rows, at all or in one solve."""
    return Diagnostic(
        code=EMPTY_AGGREGATE, message=f"`{table}` has no rows here, so that its aggregate in a constraint has no value",
        place=span, hint=EMPTY_AGGREGATE.mend,
    )  # fmt: skip


def cell_of_divided_rows(span: Span, column: str, table: str) -> Diagnostic:
    """A cell that decides what the formula of an aggregate is, where each solve has rows of its own."""
    return Diagnostic(
        code=language_faults.NOT_STATIC, place=span,
        message=f"the value of column `{column}` is needed here to compile, but `for-each` or `window` divides "
        f"`{table}`, and one formula is for the rows of every solve",
        hint="say it by a column of numbers: `(* is-x a)` with 1 and 0, `(if (= kind 1) a b)`",
    )  # fmt: skip


def aggregate_as_time(span: Span) -> Diagnostic:
    """An aggregate in the time at which a table is sampled."""
    return Diagnostic(
        code=AGGREGATE_MISPLACED, message="the time of `sample` cannot hold an aggregate over the rows of a table",
        place=span, hint="give the time by columns, constants and unknowns",
    )  # fmt: skip


STATE_WITHOUT_STEP = Code(
    "state-without-step",
    "A state is mentioned where there is no row of a table that has the column of the steps, so that it is not known"
    " which step is meant.",
    "Observe a table that has the column; in `constraints` and `derive` leave `:over` out, which means every step.",
)
STATE_WITHOUT_TRANSITION = Code(
    "state-without-transition",
    "The `dynamics` do not say how a state gets from one step to the next.",
    "Add `(static NAME)`, `(random-walk NAME :sigma q)`, `(constant-velocity NAME :acceleration a)` or"
    " `(= (next NAME) form :sigma q)`.",
)
UNKNOWN_STATE = Code(
    "unknown-state",
    "A transition is about something that `states` does not declare.",
    "Correct the name, or declare the state; what is constant over the sequence belongs into `unknowns`.",
)
UNMATCHED_STEP = Code(
    "unmatched-step",
    "A transition uses columns of a table that has no row, or several, at a step that is reached.",
    "Give the table one row for each step but the first, or use a table that has one.",
)
NO_STATES = Code(
    "no-states",
    "`dynamics`, `:at first`, `:hypotheses` or a method for sequences stands in a problem without `states`.",
    "Add `(states :over COLUMN (name …)…)`.",
)


def state_without_step(span: Span, name: str, column: str, table: str | None) -> Diagnostic:
    """A state where no step is at hand; ``table`` is that of the row at hand, which has no such ``column``."""
    where = f"`{table}` has no column `{column}`" if table is not None else "there is no row here"
    return Diagnostic(
        code=STATE_WITHOUT_STEP, message=f"the state `{name}` changes from step to step, but {where}", place=span,
        hint=f"use it for the rows of a table that has the column `{column}`",
    )  # fmt: skip


def state_without_transition(span: Span, name: str) -> Diagnostic:
    """A state that nothing carries on."""
    return Diagnostic(
        code=STATE_WITHOUT_TRANSITION, message=f"nothing says how the state `{name}` changes", place=span,
        hint=f"add `(dynamics (random-walk {name} :sigma q))`, or `(static {name})`",
    )  # fmt: skip


def unknown_state(span: Span, name: str, known: tuple[str, ...]) -> Diagnostic:
    """A transition of what is no state."""
    return Diagnostic(
        code=UNKNOWN_STATE,
        message=f"`{name}` is no state of this problem",
        place=span,
        hint=suggestion(name, known, "the states are " + ", ".join(f"`{each}`" for each in known)),
    )


def unknown_scale(span: Span, name: str, option: str, *, walks: bool) -> Diagnostic:
    """A scale of a walk or an acceleration that is to be estimated."""
    walk = f"`(= (next {name}) {name} :sigma (unknown (sqrt (dt))))`"
    other = f"write the motion as two states with `(= (next {name}) … :sigma (unknown …))`"
    return language_faults.bad_form(span, f"`:{option}` is not estimated here", "", f"write {walk}" if walks else other)


def step_without_row(span: Span, table: str, column: str, step: str, places: tuple[Place, ...]) -> Diagnostic:
    """A step that is reached with no row of the table whose columns the transition uses, or with several rows."""
    how = f"{len(places)} rows" if places else "no row"
    return Diagnostic(
        code=UNMATCHED_STEP,
        message=f"this transition uses columns of `{table}`, which has {how} for the step {column} = {step}",
        place=span, labels=tuple(Label(place, "a row of that step") for place in places[:2]),
        hint="one row for each step but the first is wanted",
    )  # fmt: skip


def no_states(span: Span | None, what: str) -> Diagnostic:
    """What needs states, without any."""
    return Diagnostic(
        code=NO_STATES, message=f"{what} is for problems with `states`, and this one has none", place=span,
        hint="add `(states :over COLUMN (name …)…)`",
    )  # fmt: skip


def state_without_rate(span: Span, name: str) -> Diagnostic:
    """The rate of what does not move by one."""
    return Diagnostic(
        code=UNKNOWN_STATE, message=f"`{name}` is no state with a rate", place=span,
        hint=f"add `(dynamics (constant-velocity {name} :acceleration a))`",
    )  # fmt: skip
