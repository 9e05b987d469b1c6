"""What robust estimation may have to say about its answer."""

from __future__ import annotations

from mbm.text.types import Code, Diagnostic, Severity, Span

TOO_FEW_AGREE = Code(
    "too-few-agree",
    "Fewer than half of the measurements agree with any one solution: which of them are wrong cannot be told.",
    "Check the model, the stated `:sigma` and the units; or measure more.",
)
AMBIGUOUS_CONSENSUS = Code(
    "ambiguous-consensus",
    "Two different solutions explain equally many measurements: which of them are outliers cannot be told. It "
    "is also said where a row that is left out would hold what another row holds alone, as a false loop to the end of "
    "a chain of poses and a step of that chain do.",
    "Add measurements, a prior, or bounds that decide between the two; give rows that are known to be right no loss, "
    "or say which they are by `:robust (gnc :quantile 99% :trust FORM)`.",
)
NO_SUBSET = Code(
    "no-subset",
    "The rule for outliers fits subsets of the rows, and no subset determines all states: transitions, which join the "
    "steps, belong to none.",
    "Use `:robust (gnc :quantile 99%)`, which judges each row by fits to all others, or a `:loss`.",
)
ONE_SIDED_OUTLIERS = Code(
    "one-sided-outliers",
    "Nearly all outliers of a clause under a loss lie on one side, as ranges around corners do, which are too long. "
    "A loss bounds what each of them does; together they draw the estimates to their side, by more than standard "
    "deviations tell (a warning).",
    "Use a loss that leaves outliers out (`tukey`, `geman-mcclure`) or `:robust`, or describe the errors: an offset, "
    "rows that are no measurement by `:when`.",
)


def no_subset(span: Span, rule: str) -> Diagnostic:
    """States with too few rows for the ``rule``."""
    message = f"`{rule}` fits subsets of the rows, and the rows of no subset determine all states"
    return Diagnostic(code=NO_SUBSET, message=message, place=span, hint=NO_SUBSET.mend)


def too_few_agree(span: Span, agreeing: int, units: int) -> Diagnostic:
    """A consensus of a minority."""
    return Diagnostic(
        code=TOO_FEW_AGREE,
        message=f"only {agreeing} of {units} measurements agree with the best solution that was found",
        place=span,
        hint=TOO_FEW_AGREE.mend,
        severity=Severity.WARNING,
    )


def ambiguous_consensus(span: Span) -> Diagnostic:
    """Two majorities."""
    return Diagnostic(
        code=AMBIGUOUS_CONSENSUS,
        message="another solution, which takes other measurements for outliers, explains the data as well",
        place=span,
        hint=AMBIGUOUS_CONSENSUS.mend,
        severity=Severity.WARNING,
    )


def denied_trust(span: Span, name: str, first: str, second: str, rows: int) -> Diagnostic:
    """A step of a chain from member ``first`` of a family to ``second``, which is trusted, against ``rows``."""
    return Diagnostic(
        code=AMBIGUOUS_CONSENSUS,
        message=f"{rows} rows that are left out agree with one another, and contradict a trusted step of `{name}`, "
        f"from {first} to {second} or another that they span",
        place=span,
        hint="look at these steps; where one may be wrong, leave its row out of `:trust`",
        severity=Severity.WARNING,
    )


def lost_rows(span: Span, name: str, count: int, where: str) -> Diagnostic:
    """So many steps of the clause ``name`` after one another, ``where`` the column of the steps says."""
    return Diagnostic(
        code=AMBIGUOUS_CONSENSUS,
        message=f"{count} steps of `{name}` after one another, {where}, are left out, though they agree: the states "
        "may be there, and lost",
        place=span,
        hint="give `dynamics` the noise of what happened there; or leave the readings out by `:when`, if wrong",
        severity=Severity.WARNING,
    )


def one_sided_outliers(span: Span, name: str, aside: int, count: int) -> Diagnostic:
    """So many outliers of a clause on one side, of all."""
    return Diagnostic(
        code=ONE_SIDED_OUTLIERS,
        message=f"{aside} of {count} outliers of `{name}` lie on one side, and draw the estimates to it",
        place=span,
        hint=ONE_SIDED_OUTLIERS.mend,
        severity=Severity.WARNING,
    )
