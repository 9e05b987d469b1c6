"""What the numerics may have to say before they start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from mbm.problem.naming import key_text
from mbm.solver.decisions import LOWER
from mbm.text.types import Code, Diagnostic, Label, Place, Severity, Span

NO_EQUATIONS = Code(
    "no-equations",
    "There are unknowns but not a single scalar equation or prior for them: every row was dropped, or none was given.",
    "Check the data file, `:when` and the keys that select rows.",
)
NO_UNKNOWNS = Code(
    "no-unknowns",
    "Everything is fixed: there is nothing to estimate.",
    "Free at least one unknown, or use `derive` to compute from known numbers.",
)
TOO_MANY_UNKNOWNS = Code(
    "too-many-unknowns",
    "The Jacobian is held as a dense matrix where equations, or rows that share measured values with `:errors`, touch "
    "many of the unknowns, and with the methods `closed-form` and `ipopt`; this one would not fit in the memory it may "
    "take.",
    "Use `:method auto`, solve in parts (`for-each`, `window`), or fix or drop unknowns.",
)
NO_CLOSED_FORM = Code(
    "no-closed-form",
    "`:method closed-form`, or the name of one, asks for an answer without iteration; the equations are of no kind for "
    "which one is known, or the rows are too few or in a degenerate position for it.",
    "Leave `:method` out: closed forms are tried first anyway, and what they do not give is searched for.",
)
OPTION_NOT_FINITE = Code(
    "option-not-finite",
    "A start or bound of an unknown is not a finite number (for some member of its family), or the start of a "
    "direction has no length.",
    "Correct the form, or the cell of the family's table that it uses.",
)
NOT_FINITE_AT_START = Code(
    "not-finite-at-start",
    "An equation has no finite value at the initial values: a logarithm of a negative number, a division by zero.",
    "Give other initial values with `:init`, or bounds with `:in`.",
)
NO_CORRECTIONS_AT_START = Code(
    "no-corrections-at-start",
    "At the initial values, no corrections of the measured values that have `:errors` make an equation hold.",
    "Give initial values nearer to the solution, or give the equation a `:sigma`.",
)
NOISE_NOT_ESTIMATED = Code(
    "noise-not-estimated",
    "The noise of an observation is unknown and cannot be estimated: no degrees of freedom are left, or all residuals "
    "are zero. Or the rounds that estimate it, each from the residuals that the last one left, ran out while it still "
    "changed: standard deviations are those of the last round.",
    "Give `:sigma`, or add observations.",
)

TOO_MANY_SOLVES = Code(
    "too-many-solves",
    "The columns of `for-each` stand in different tables, and all combinations of their values are too many; or the "
    "steps of `window` are so short that there are too many windows.",
    "Put the columns into one table: then only the combinations that occur are solved. Lengthen the step of `window`.",
)

TOO_NONLINEAR = Code(
    "too-nonlinear",
    "The model bends so much within the uncertainty of an estimate that its standard deviation misleads: an end of the "
    "true 95 % interval lies more than a quarter nearer or farther than the ±1.96 standard deviations stated (a "
    "warning).",
    "Read the interval as asymmetric, as the message says; add data, or estimate another function of the unknown (its "
    "logarithm, its reciprocal) in which the model is closer to linear.",
)
DERIVED_NOT_FINITE = Code(
    "derived-not-finite",
    "A derived quantity has no finite value at the estimates: a logarithm or root of a negative number, a division by "
    "zero (a warning).",
    "Correct its formula, or keep the unknowns where it has a value, with `:in` or `:positive`.",
)
SAMPLED_ROWS_MOVED = Code(
    "sampled-rows-moved",
    "Rows that are sampled within a table at the start lie beyond its ends at the estimates, or the other way round. "
    "The rows of the start were used for the whole solve (a warning).",
    "Solve again with `--init` of this answer, or leave rows near the ends out with `:when`.",
)
NOISE_AGAINST_DATA = Code(
    "noise-against-data",
    "The residuals are far larger than the stated noise allows, so either the noise or the model is wrong, or rows are "
    "outliers, or the start has led to another minimum than the best; the standard deviations follow the stated noise "
    "and are then too small (a warning).",
    "Look at the residuals; correct `:sigma`, use `:sigma (unknown FORM)`, add what the model lacks, or use `:robust`; "
    "`--starts 20` looks for a better minimum.",
)
PRIOR_AGAINST_DATA = Code(
    "prior-against-data",
    "A prior lies more than four standard deviations from what the data say without it: one of the two is wrong (a "
    "warning).",
    "Check the prior's mean and sigma, and the data; widen the prior.",
)
ANOTHER_SOLUTION = Code(
    "another-solution",
    "Another minimum fits the data as well as the one that is reported, or so nearly that the noise may have decided "
    "between them, or better: several starts have led to it, or it was found beside that of a single start (a "
    "warning). It stands among the `alternatives`.",
    "Measure something that tells the two apart, or exclude one with `:in` or a constraint; if it fits better, start "
    "there, or with `--starts 20`.",
)
OPEN_ENDED = Code(
    "open-ended",
    "The data do not exclude that an unknown is infinite, or any number far away: its equations feel nothing of it "
    "there, and the cost approaches a value that the noise may have decided against (a warning). That is no other "
    "solution.",
    "Bound the unknown with `:in` or a prior, or measure where it shows; `interval` says how far the likelihood "
    "reaches.",
)
EXACTLY = "no residuals are left in either"
MOST_NAMED = 6
"""Numbers of one unknown, or rows of a table, that a message lists."""


def no_equations(unknowns: int, place: Place | None = None, unpaired: str = "") -> Diagnostic:
    """No residuals at all for ``unknowns`` scalar unknowns; ``unpaired``: why no rows of tables go together."""
    clock = "Give the tables times of one clock, or a wider `:tolerance`. " if unpaired else ""
    return Diagnostic(
        code=NO_EQUATIONS,
        message=f"{unknowns} scalar {'unknown' if unknowns == 1 else 'unknowns'}, but no equation has a row of data"
        + (unpaired and f": {unpaired}"),
        place=place,
        hint=clock + NO_EQUATIONS.mend,
    )


def no_unknowns(place: Place | None = None) -> Diagnostic:
    """Nothing is free."""
    return Diagnostic(code=NO_UNKNOWNS, message="every unknown is fixed", place=place, hint=NO_UNKNOWNS.mend)


def too_many_unknowns(rows: int, unknowns: int, limit: int, place: Place | None = None) -> Diagnostic:
    """A dense matrix, of the Jacobian or of the covariance, exceeds ``limit`` numbers."""
    return Diagnostic(
        code=TOO_MANY_UNKNOWNS,
        message=f"{rows} equations in {unknowns} unknowns make a matrix of {max(rows, unknowns) * unknowns} numbers; "
        f"at most {limit} are held",
        place=place,
        hint=TOO_MANY_UNKNOWNS.mend,
    )


def option_not_finite(span: Span, name: str, key: str | float | None) -> Diagnostic:
    """A start or bound without a value."""
    member = f" for the member {key_text(key)}" if key is not None else ""
    return Diagnostic(
        code=OPTION_NOT_FINITE,
        message=f"this option of `{name}` has no finite value{member}",
        place=span,
        hint=OPTION_NOT_FINITE.mend,
    )


def no_direction(span: Span, name: str, key: str | float | None) -> Diagnostic:
    """A start of a direction of length 0."""
    member = f" for the member {key_text(key)}" if key is not None else ""
    return Diagnostic(
        code=OPTION_NOT_FINITE,
        message=f"this option of `{name}` is no direction{member}: its length is 0",
        place=span,
        hint="`[0 0 1]` is one; leave it out where it is not known",
    )


def not_finite_at_start(
    span: Span, name: str, place: Place | None, rows: Sequence[int], reason: str | None
) -> Diagnostic:
    """An equation without a value at the initial values, in ``rows`` of its table; why in the first of them."""
    more = f" and {len(rows) - MOST_NAMED:,} more" if len(rows) > MOST_NAMED else ""
    listed = ", ".join(str(row) for row in rows[:MOST_NAMED])
    where = f" in {'row' if len(rows) == 1 else 'rows'} {listed}{more}" if rows else ""
    why = "" if reason is None else f"; in row {rows[0]} {reason}" if len(rows) > 1 else f": {reason}"
    return Diagnostic(
        code=NOT_FINITE_AT_START,
        message=f"an equation of `{name}` has no finite value at the initial values{where}{why}",
        place=span,
        labels=(Label(place, "for this row"),) if place is not None else (),
        hint=NOT_FINITE_AT_START.mend,
        severity=Severity.WARNING,
    )


def no_corrections_at_start(span: Span, name: str, place: Place | None) -> Diagnostic:
    """An equation that corrections of its measured values cannot meet."""
    return Diagnostic(
        code=NO_CORRECTIONS_AT_START,
        message=f"at the initial values, a row of `{name}` cannot be corrected to fit its equation",
        place=span,
        labels=(Label(place, "for this row"),) if place is not None else (),
        hint=NO_CORRECTIONS_AT_START.mend,
        severity=Severity.WARNING,
    )


def noise_not_settled(span: Span, name: str) -> Diagnostic:
    """An unknown noise that still changed in the last of the rounds that estimate it."""
    return replace(
        noise_not_estimated(span, name, ""),
        message=f"the noise of `{name}` still changed when the rounds that estimate it ran out, and standard "
        "deviations are those of the last round; give `:sigma`",
    )


def noise_not_estimated(span: Span, name: str, why: str, wanted: str = "`:sigma`") -> Diagnostic:
    """An unknown noise that stays unknown; ``wanted`` is what would state it."""
    return Diagnostic(
        code=NOISE_NOT_ESTIMATED,
        message=f"{why} of `{name}`; give {wanted}",
        place=span,
        hint=NOISE_NOT_ESTIMATED.mend,
        severity=Severity.WARNING,
    )


def no_closed_form(place: Place | None, routine: str | None) -> Diagnostic:
    """An answer without iteration that nobody knows."""
    what = "no closed form" if routine is None else f"the closed form `{routine}` does not"
    verb = "gives" if routine is None else "give"
    return Diagnostic(
        code=NO_CLOSED_FORM,
        message=f"{what} {verb} the unknowns of these equations",
        place=place,
        hint=NO_CLOSED_FORM.mend,
    )


def too_many_solves(columns: tuple[str, ...], count: int, limit: int) -> Diagnostic:
    """Keys of different tables that combine to more problems than can be meant."""
    return Diagnostic(
        code=TOO_MANY_SOLVES,
        message=f"`for-each {' '.join(columns)}` combines to {count} problems; at most {limit} are tried",
        hint="put the columns into one table: then only the combinations that occur are solved",
    )


def too_many_windows(place: Place, count: int, limit: int) -> Diagnostic:
    """Steps so short beside the span of the data that nobody can mean it."""
    return Diagnostic(
        code=TOO_MANY_SOLVES,
        message=f"`window` makes {count} problems; at most {limit} are tried",
        place=place,
        hint="lengthen the step: it is counted in the unit of the column, in SI without one",
    )


def too_nonlinear(span: Span, ends: Sequence[str]) -> Diagnostic:
    """``ends`` says of each number of an unknown how far its interval really reaches on both sides."""
    more = f", and {len(ends) - MOST_NAMED} more" if len(ends) > MOST_NAMED else ""
    return Diagnostic(
        code=TOO_NONLINEAR,
        message=f"too nonlinear for its standard deviation; the 95 % interval reaches, against the stated one: "
        f"{'; '.join(ends[:MOST_NAMED])}{more}",
        place=span,
        hint=TOO_NONLINEAR.mend,
        severity=Severity.WARNING,
    )


def derived_not_finite(span: Span, name: str, rows: int, reason: str | None) -> Diagnostic:
    """``rows`` is in how many rows of its table a quantity has no value, 0 where it has none; why in the first."""
    where = f" in {rows} row{'s' if rows > 1 else ''}" if rows else ""
    return Diagnostic(
        code=DERIVED_NOT_FINITE,
        message=f"`{name}` has no finite value at the estimates{where}{'' if reason is None else f': {reason}'}",
        place=span,
        hint=DERIVED_NOT_FINITE.mend,
        severity=Severity.WARNING,
    )


def sampled_rows_moved(span: Span, name: str, left: list[int], entered: list[int]) -> Diagnostic:
    """``left`` are rows that were used and now lie beyond the table, ``entered`` the other way round."""
    beyond, within = "beyond the ends of the sampled table", "within the sampled table"
    parts = [f"{_listed(rows)} {what} at the estimates" for rows, what in ((left, beyond), (entered, within)) if rows]
    return Diagnostic(
        code=SAMPLED_ROWS_MOVED,
        message=f"`{name}`: {' and '.join(parts)}, otherwise than at the start",
        place=span,
        hint=SAMPLED_ROWS_MOVED.mend,
        severity=Severity.WARNING,
    )


def _listed(rows: list[int]) -> str:
    """``row 3 lies``, ``rows 3, 5 and 7 more lie``."""
    more = f" and {len(rows) - MOST_NAMED:,} more" if len(rows) > MOST_NAMED else ""
    listed = ", ".join(str(row) for row in rows[:MOST_NAMED])
    return f"row {listed} lies" if len(rows) == 1 else f"rows {listed}{more} lie"


def probability_of(chance: float) -> str:
    """A probability as messages give it, where it has a value at all."""
    return f"p = {chance:.1g}" if chance > 0.0 else "p < 1e-300"


def noise_against_data(span: Span, sigma0: float, probability: float) -> Diagnostic:
    """The χ² test fails beyond doubt."""
    chance = probability_of(probability)
    return Diagnostic(
        code=NOISE_AGAINST_DATA,
        message=f"the residuals are {sigma0:.3g} times as large as the stated noise lets expect ({chance})",
        place=span,
        hint=NOISE_AGAINST_DATA.mend,
        severity=Severity.WARNING,
    )


def prior_against_data(span: Span, name: str, innovation: float) -> Diagnostic:
    """``innovation``: the distance in standard deviations."""
    return Diagnostic(
        code=PRIOR_AGAINST_DATA,
        message=f"the prior `{name}` lies {innovation:.2g} standard deviations from what the data say without it",
        place=span,
        hint=PRIOR_AGAINST_DATA.mend,
        severity=Severity.WARNING,
    )


def open_ended(place: Place | None, names: tuple[str, ...], costs: tuple[float, ...], name: str) -> Diagnostic:
    """Where unknowns go far away, as ``names`` say, nothing is felt of them; ``costs`` and ``name`` as above."""
    cost, best = costs
    listed = " and ".join(names)
    return Diagnostic(
        code=OPEN_ENDED,
        message=f"the data do not exclude {listed}: the {name} approaches {cost:.6g} there, that of the solution "
        f"reported is {best:.6g}",
        place=place,
        hint=OPEN_ENDED.mend,
        severity=Severity.WARNING,
    )


def another_solution(
    place: Place | None, count: int, costs: tuple[float, ...], name: str, *, mirrored: bool
) -> Diagnostic:
    """There are ``count`` other minima that fit about as well as that reported, or better.

    ``costs`` are those of the first of them and of the one reported, 0 for a rounding; ``name`` is what they are.
    """
    cost, best = costs
    others = "another solution fits" if count == 1 else f"{count} other solutions fit"
    what = " (the mirror image)" if mirrored and count == 1 else ""
    lower = cost < best - LOWER * abs(best)
    well = "as well" if not lower else "better" if count == 1 else "as well or better"
    owner = "its" if count == 1 else "of the first, the"
    how = f"{owner} {name} is {cost:.6g}, that of the solution reported {best:.6g}" if any(costs) else EXACTLY
    return Diagnostic(
        code=ANOTHER_SOLUTION,
        message=f"{others} {well}{what}: {how}",
        place=place,
        hint=ANOTHER_SOLUTION.mend,
        severity=Severity.WARNING,
    )
