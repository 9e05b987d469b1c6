"""What can be wrong when results are written or initial values are read: codes and constructors."""

from __future__ import annotations

from collections.abc import Sequence

from mbm.text.suggest import closest, did_you_mean
from mbm.text.types import Code, DataPlace, Diagnostic, Label, Severity, Span

PLOT_FORMAT = Code(
    "plot-format",
    "The name of a plot ends in no picture format that can be drawn.",
    "End the name in .png, .svg or .pdf.",
)
SAMPLE_FORMAT = Code(
    "sample-format",
    "The name of a file for samples ends in no format that can be written, or one file cannot hold those of several "
    "solves.",
    "End the name in .npz, .parquet or .nc; the last holds one solve.",
)
REPORT_FORMAT = Code(
    "report-format",
    "The name of a report ends in no format that reports have.",
    "End the name in .html or .pdf.",
)
BAD_INITIAL_VALUES = Code(
    "bad-initial-values",
    "Initial values are a JSON object from names to values (a number, nested lists, or `{keys, value}`), or a result "
    "document; something else was given.",
    'Write for instance `{"p": [1, 1, 1]}`, or give the document that `mbm solve --json` wrote.',
)
NOT_PREDICTED = Code(
    "not-predicted",
    "A derived quantity is asked for at other values, or with the noise of an observation, and cannot be had so.",
    "Give every column that the form of the quantity depends on, and name an observation whose MODEL it is.",
)
NEAR_BOUND = Code(
    "near-bound",
    "An estimate is held at a hard bound (`:in`), was driven to the zero that a `positive` unknown stays above, or to "
    "where its model ends, as an expected count does at zero. Neither it nor what is derived of it alone has a "
    "standard deviation, and those of the others hold for it staying where it is. Its interval is that of its "
    "distribution between the limits; those of the others reach to where it leaves the limit. Where the data "
    "contradict the bound, the message says by how much.",
    "If the bound is no fact of the matter, widen it with `:in`; else look for an equation that asks for the far side.",
)
ACTIVE_CONSTRAINT = Code(
    "active-constraint",
    "The estimates lie at the limit of an inequality, and the data push against it. The covariance is that of "
    "movements along the limit, with zeros for what only leaves it. Intervals reach to where the estimates leave the "
    "limit. The message says so where the data contradict the limit: the sum of squares without it would be so much "
    "smaller that noise does this in less than one of 10,000 sets.",
    "If the limit is no fact of the matter, widen it; else take the standard deviations as those at the limit.",
)
CONFLICTING_CONSTRAINTS = Code(
    "conflicting-constraints",
    "No values of the unknowns meet all constraints and bounds. Those named contradict one another: without any one of "
    "them the others can be met (as far as a search from the start can tell). What is fixed and stands in one of them "
    "is named as well.",
    "Correct or widen one of those named, or free what is fixed.",
)
INTERRUPTED = Code(
    "interrupted",
    "The run was interrupted before all solves were made; those that were made are reported.",
    "Run it again, and let it finish.",
)

NO_SUCH_CLAUSE = Code(
    "no-such-clause",
    "Residuals are asked for by the name of an observation clause, and none is called so.",
    "Ask for one of those named; without a name, those of all clauses are given.",
)
NO_REGION = Code(
    "no-region",
    "The joint region of two numbers is asked for, and cannot be had: a hard limit cuts one of them, they are parts of "
    "a rotation or pose, one follows from the other, or how they vary together is not known.",
    "Ask for the intervals of each, or for a region of other numbers.",
)

MOST_NAMES = 8
"""Names in one sentence."""


def plot_format(path: str, known: str) -> Diagnostic:
    """The ending of ``path`` is none of those that can be drawn."""
    return Diagnostic(
        code=PLOT_FORMAT, message=f"`{path}` names no picture format", hint=f"end the name in one of {known}"
    )


def sample_format(path: str, known: tuple[str, ...]) -> Diagnostic:
    """The ending of ``path`` is none of those of samples."""
    return Diagnostic(
        code=SAMPLE_FORMAT,
        message=f"`{path}` names no format of samples",
        hint=f"end the name in one of {', '.join(known)}",
    )


def several_sampled(count: int) -> Diagnostic:
    """InferenceData holds the samples of one solve."""
    return Diagnostic(
        code=SAMPLE_FORMAT,
        message=f"`.nc` holds the samples of one solve, and there are {count}",
        hint="write `.npz` or `.parquet`",
    )


def report_format(path: str, known: str) -> Diagnostic:
    """The ending of ``path`` is none that a report can have."""
    return Diagnostic(
        code=REPORT_FORMAT, message=f"`{path}` names no format of a report", hint=f"end the name in {known}"
    )


def bad_initial_value(name: str, what: str, file: str | None = None) -> Diagnostic:
    """The initial value of ``name`` cannot be read; ``what`` says what it is instead."""
    return Diagnostic(
        code=BAD_INITIAL_VALUES,
        message=f"the initial value of `{name}` is {what}",
        place=None if file is None else DataPlace(file=file),
        hint="write a number, one with its unit as a text (`5mm`), lists, or an object with `keys` and `value`",
    )


def unknown_member(name: str, key: str, near: str | None) -> Diagnostic:
    """The initial values name a member ``key`` (as names show it) that the family does not have."""
    return Diagnostic(
        code=BAD_INITIAL_VALUES,
        message=f"the initial value of `{name}` is for a member {key}, which it does not have",
        hint=did_you_mean(near, "give the keys that the table has"),
    )


def bad_initial_values(what: str, file: str | None = None) -> Diagnostic:
    """The whole is no mapping and no result document."""
    return Diagnostic(
        code=BAD_INITIAL_VALUES,
        message=f"the initial values are {what}",
        place=None if file is None else DataPlace(file=file),
        hint='write an object such as `{"p": [1, 1, 1]}`, or give a result document',
    )


UNIFORM_IS_A_LIMIT = (
    "`uniform` is a hard limit; for a standard deviation of a/√3, with a half the width, "
    "write `(rectangular form lo hi)`"
)


def active_constraint(span: Span, name: str, *, uniform: bool = False, contradiction: str | None = None) -> Diagnostic:
    """The data push against an inequality, or against the limits of a `uniform`; ``contradiction``: beyond chance."""
    held = f"the estimates are held by the constraint `{name}`"
    return Diagnostic(
        code=ACTIVE_CONSTRAINT,
        message=_contradicted(held, contradiction),
        place=span,
        hint=UNIFORM_IS_A_LIMIT if uniform else ACTIVE_CONSTRAINT.mend,
        severity=Severity.WARNING,
    )


def _contradicted(held: str, contradiction: str | None) -> str:
    return held if contradiction is None else f"{held}, which the data contradict: {contradiction}"


def conflicting_constraints(
    span: Span, members: Sequence[str], labels: tuple[Label, ...], *, smallest: bool
) -> Diagnostic:
    """Constraints, bounds and fixed scalars, in words, that cannot all be met; the first stands at ``span``."""
    more = f" and {len(members) - MOST_NAMES} more" if len(members) > MOST_NAMES else ""
    shown = ", ".join(members[:MOST_NAMES]) + more
    if len(members) == 1:
        message = f"no values of the unknowns meet {shown}"
    else:
        message = f"no values of the unknowns meet all of {shown}"
    return Diagnostic(
        code=CONFLICTING_CONSTRAINTS,
        message=message if smallest else f"{message}; perhaps fewer of them contradict one another already",
        place=span,
        labels=labels,
        hint=CONFLICTING_CONSTRAINTS.mend,
        severity=Severity.WARNING,
    )


def near_bound(
    span: Span, names: Sequence[str], what: str, contradiction: str | None = None, derived: Sequence[str] = ()
) -> Diagnostic:
    """The scalars ``names`` of an unknown ended at ``what``: a bound, `the end of its model`, `zero`.

    ``contradiction``: beyond chance. The quantities ``derived`` change with them.
    """
    verb = "is" if len(names) == 1 else "are each"
    held = f"{verb} driven to zero, where `positive` ends" if what == "zero" else f"{verb} held at {what}"
    staying = "it stays" if len(names) == 1 else "they stay"
    beside = f"; the standard deviations of {listed(derived)} suppose that {staying} there" if derived else ""
    return Diagnostic(
        code=NEAR_BOUND,
        message=f"{_contradicted(f'{listed(names)} {held}', contradiction)}{beside}",
        place=span,
        hint=NEAR_BOUND.mend,
        severity=Severity.WARNING,
    )


def listed(names: Sequence[str], most: int = MOST_NAMES) -> str:
    """Names in a sentence, the first so many of them."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(f"`{name}`" for name in names[:most]) + more if names else "none"


def no_region(first: str, second: str, why: str) -> Diagnostic:
    """There is no joint region of two numbers."""
    return Diagnostic(
        code=NO_REGION, message=f"no joint region of `{first}` and `{second}`: {why}", hint=NO_REGION.mend
    )


def no_number(name: str, known: Sequence[str]) -> str:
    """No scalar is called ``name``; those ``known`` are."""
    return f"no number is called `{name}`; there are {listed(known)}"


def no_such_clause(name: str, known: Sequence[str]) -> Diagnostic:
    """No observation clause is called ``name``; those ``known`` are."""
    return Diagnostic(
        code=NO_SUCH_CLAUSE,
        message=f"no observation is called `{name}`; there are {listed(known)}",
        hint=did_you_mean(closest(name, known), NO_SUCH_CLAUSE.mend),
    )


def interrupted(done: int, left: int) -> Diagnostic:
    """Ctrl-C between two solves, or during one of them."""
    return Diagnostic(
        code=INTERRUPTED,
        message=f"the run was interrupted: {done} of {done + left} solves were made",
        hint=INTERRUPTED.mend,
        severity=Severity.WARNING,
    )


def not_predicted(name: str, why: str, hint: str) -> Diagnostic:
    """A prediction that cannot be made."""
    return Diagnostic(code=NOT_PREDICTED, message=f"`{name}` is not predicted: {why}", place=None, hint=hint)
