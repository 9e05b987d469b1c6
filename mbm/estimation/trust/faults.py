"""What a solve may have to say against its own answer."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from mbm.equations.types import Floats
from mbm.estimation.consensus.faults import AMBIGUOUS_CONSENSUS
from mbm.text.types import Code, Diagnostic, Label, Severity, Span

CONTRADICTING_ROWS = Code(
    "contradicting-rows",
    "Rows of a pose graph contradict the others, as false loop closures do: least squares bends all that they span, "
    "and the answer is that of neither. The status is `not-converged`.",
    "Check the rows that are named; leave them out with `:when`, or reject them by "
    "`:robust (gnc :quantile 99% :trust FORM)`.",
)
AUTOCORRELATED_RESIDUALS = Code(
    "autocorrelated-residuals",
    "Residuals of rows that follow one another are alike (or opposed) more than independent noise lets expect: the "
    "noise is correlated, or the model lacks something that varies slowly. Standard deviations suppose independent "
    "rows; where neighbours are alike they are too small, often by half (a warning). In rows without any order, "
    "correlation by chance is said of one solve in twenty, below 8 degrees of freedom of one in fifty. Of odometry "
    "between neighbours of a family, of transitions of states and of rows with `previous` the message names the "
    "clause, by chance in one of a hundred solves.",
    "Plot the residuals by row. Add what the model lacks (a drift, a curve, a common offset), or state how the noise "
    "is correlated (`:correlation`, `:common`); rows sorted by the measured value have to be put into another order.",
)
BAD_LEVERAGE = Code(
    "bad-leverage",
    "A row under a loss stands far away from the others, disagrees with them, and draws the fit to itself. A loss "
    "bounds the influence of large residuals, but such a row makes its own residual small (a warning).",
    "Check these rows. Leave them out with `:when`, or use consensus (`:robust lmeds`), which has no such weakness.",
)
IMPROBABLE_NOISE = Code(
    "improbable-noise",
    "Chi² is as large, or as small, as the stated noise makes it in one of a hundred solves: the noise is probably "
    "stated too small or too large, and so are the standard deviations, which follow it (a warning).",
    "Check `:sigma`; let the residuals tell it with `:sigma (unknown FORM)`. Counts that scatter more than their "
    "distribution lets them vary between rows: `:sigma (unknown (sqrt model))` in its place.",
)
UNEVEN_NOISE = Code(
    "uneven-noise",
    "The errors of a clause grow (or shrink) with what it reads, or along its rows, beside what is stated of them: the "
    "rank correlation of the residuals' sizes with the model's values, their sizes, or the order of the rows is one "
    "that errors which are as stated have in one of a hundred solves. Rows are then weighted wrongly, and standard "
    "deviations are too large where the errors are small, and too small where they are large (a warning).",
    "Plot the residuals by the model's value. State how the errors grow, "
    "`:sigma (unknown model)`, `(sqrt (+ (^ s0 2) (^ (* r model) 2)))` with unknown `s0` and `r`, or `:sigma` by row.",
)
REPEATED_EQUATIONS = Code(
    "repeated-equations",
    "A clause over a table states an equation without anything measured (`(= 0 (deviation lab))`) once more for every "
    "row of the same key: stated noise then weighs as often, and unknown noise is estimated as 0, or too small (a "
    "warning).",
    "State it once for each value of the key: `(observe d.lab …)` in place of `(observe d …)`, or over a table with "
    "one row for each.",
)
HIDDEN_OUTLIERS = Code(
    "hidden-outliers",
    "Most errors of a clause are far smaller than stated (0.6 times as large, or less), and some lie far beyond these: "
    "the kurtosis of the residuals is one that normal errors, of whatever size, have in one of a hundred solves. "
    "Outliers, such as false loop closures of a pose graph, hide within the stated noise: chi² does not show them, "
    "consensus keeps them, and the estimates follow them (a warning).",
    "Check the rows that are named. State the noise that most rows have with `:sigma`, and reject outliers "
    "by `:robust`; or let the residuals tell it, with a loss (`:sigma (unknown FORM) :loss cauchy`).",
)
BEHIND_CAMERA = Code(
    "behind-camera",
    "Most rows of a clause see points that are behind their camera: by the model, such points have an image, turned by "
    "180°; by a camera they have none. The answer is the mirror image of what was photographed (a warning).",
    "Look at the axes: a camera that looks along −z has `:axes opengl`, an image whose second coordinate grows upwards "
    "a focal length of the other sign, `:focal (f (- f))`. If they are right, give the pose an `:init` before the "
    "camera.",
)
ANY_TURN = Code(
    "any-turn",
    "The standard deviation of an angle, a direction or a rotation is above π/√3 (104°), that of an angle of which "
    "nothing is known: the data tell no more of it than that it is some angle. So end scenes that shrink to a point, "
    "where the priors of all points have one mean and nothing states their scale (a warning).",
    "Add what tells the angle, or fix it. In a scene of cameras and points state what tells its frame and its size: "
    "`:fixed` for one pose, a distance, or priors that tell the points apart.",
)
SMALL_SAMPLE = Code(
    "small-sample",
    "The noise is estimated from so few rows that even intervals with Student's t and the corrections for small "
    "samples hold the true value less often than they say (a warning).",
    "Add rows, or state the noise with `:sigma`.",
)
COARSE_READINGS = Code(
    "coarse-readings",
    "Readings are rounded to steps that are coarse beside their scatter. Rounding errors are then no independent "
    "noise: readings of one value are alike, the residuals tell the noise too small, and the mean keeps an error of up "
    "to half a step, however many readings there are (a warning).",
    "State the step and the scatter before rounding, `:resolution STEP :sigma FORM`, or read more digits.",
)
WEIGHTS_FROM_READINGS = Code(
    "weights-from-readings",
    "The standard deviations that are stated follow the readings themselves. Readings that came out low, or high "
    "where they fall with them, then weigh more than others, and draw the estimates to themselves: counts with the "
    "root of each count as its standard deviation are estimated one too low, however many rows there are (a warning).",
    "Let the standard deviation follow the model: `:sigma (sqrt model)`, `(* 5% model)`; of counts say "
    "`:distribution poisson`.",
)
OUTLYING_ROW = Code(
    "outlying-row",
    "One row is so far from what the others say that it alone makes the unknown noise large: without it the noise "
    "would be estimated less than two thirds as large. The distance has Student's t distribution with the degrees of "
    "freedom that are left, and is said of rows that chance puts as far in three of a hundred solves. Intervals are "
    "then too wide, and the estimates drawn to that row (a warning).",
    "Check the row; leave it out with `:when`, or give the noise long tails, "
    "`:sigma (unknown FORM) :loss huber` or `:distribution (student 4)` with a stated `:sigma`.",
)
READINGS_AT_EDGE = Code(
    "readings-at-edge",
    "Several readings of a clause are the same value, the least or the largest of all, where the others differ; or one "
    "is exactly 0. So look readings beyond a limit that are entered as the limit: a negative reading shown as 0, a "
    "value below the limit of detection, the end of a scale. They draw the estimates to the inside, and scatter too "
    "little (a warning).",
    "Say which readings are limits, `:below FORM` or `:above FORM`, and state `:sigma`; or get the readings "
    "themselves. A zero by definition is no reading: leave it out with `:when`.",
)
VANISHING_SCALE = Code(
    "vanishing-scale",
    "A standard deviation that is estimated by an unknown in `:sigma` is estimated as zero: the readings fit exactly, "
    "so that the likelihood grows or stays as it is while the scale falls to zero; or another part of the noise "
    "explains the scatter alone. The standard deviation of such a scale means nothing, and if no other noise is left, "
    "neither do those of the other estimates (a warning).",
    "State the noise without the scale (`:sigma FORM`), or leave the part of the noise out that is zero.",
)
COUNTED = "If these are counts, say so: `:distribution poisson`, or `(binomial n)` of n trials."
MOST_LISTED = 6
"""Rows that the message lists."""


def contradicting_rows(
    span: Span, name: str, rows: Sequence[tuple[int, float]], cost: float, worst: Label
) -> Diagnostic:
    """Of each of the ``rows`` of the clause ``name``, the worst first, what χ², ``cost``, falls by without it."""
    more = f" and {len(rows) - MOST_LISTED:,} more" if len(rows) > MOST_LISTED else ""
    listed = ", ".join(f"{row} ({fall:.3g})" for row, fall in rows[:MOST_LISTED])
    what = f"rows {listed}{more} contradict" if len(rows) > 1 else f"row {listed} contradicts"
    return Diagnostic(
        code=CONTRADICTING_ROWS,
        message=f"{what} the others of `{name}` (in brackets what chi², {cost:.3g}, falls by without it)",
        place=span,
        labels=(worst,),
        hint=CONTRADICTING_ROWS.mend,
        severity=Severity.WARNING,
    )


def _too_small(*, overstated: bool) -> str:
    """What positive correlation means; where chi² is too small, the deviations that are stated may hold yet."""
    if overstated:
        return "were the stated noise as small as the residuals are, the standard deviations would be too small"
    return "the standard deviations are too small"


def autocorrelated_residuals(
    span: Span, found: float, expected: float, spread: float, *, overstated: bool
) -> Diagnostic:
    """The correlation of neighbours, and what independent noise lets expect of it; ``overstated``: the stated noise is
    too large.
    """
    how = "alike" if found > expected else "opposed"
    return Diagnostic(
        code=AUTOCORRELATED_RESIDUALS,
        message=f"residuals of successive rows are {how}: their correlation is {found:.2f}, that of independent noise "
        f"would be {expected:.2f} ± {spread:.2f}; "
        + (_too_small(overstated=overstated) if found > expected else "the standard deviations mislead"),
        place=span,
        hint=AUTOCORRELATED_RESIDUALS.mend,
        severity=Severity.WARNING,
    )


def behind_camera(span: Span, name: str, behind: int, rows: int) -> Diagnostic:
    """Most rows of a clause see points behind the camera."""
    return Diagnostic(
        code=BEHIND_CAMERA,
        severity=Severity.WARNING,
        message=f"the points of {behind} of {rows} rows of `{name}` are behind the camera, which sees none there: "
        "look at its `:axes` and the signs of `:focal`",
        place=span,
        hint=BEHIND_CAMERA.mend,
    )


def any_turn(span: Span, names: Sequence[str], widest: float) -> Diagnostic:
    """Angles and rotations of an unknown whose standard deviations, ``widest`` rad, are those of any angle."""
    more = f" and {len(names) - MOST_LISTED:,} more" if len(names) > MOST_LISTED else ""
    return Diagnostic(
        code=ANY_TURN,
        severity=Severity.WARNING,
        message=f"nothing is known of {', '.join(f'`{name}`' for name in names[:MOST_LISTED])}{more}: the standard "
        f"deviation is {widest:.3g} rad, and that of any angle at all is 1.81 rad",
        place=span,
        hint=ANY_TURN.mend,
    )


def uneven_noise(span: Span, name: str, grown: str, correlation: float) -> Diagnostic:
    """The errors of the clause ``name`` grow or shrink with what ``grown`` says; ``correlation`` is that of ranks."""
    return Diagnostic(
        code=UNEVEN_NOISE,
        message=f"errors of `{name}` {'grow' if correlation > 0.0 else 'shrink'} with {grown}, beside what is stated "
        f"of them: rank correlation {correlation:.2f} of the sizes of residuals; "
        "standard deviations are too large for what rows with small errors tell, and too small for the others",
        place=span,
        hint=UNEVEN_NOISE.mend,
        severity=Severity.WARNING,
    )


def correlated_chain(
    span: Span, name: str, sums: Floats, decay: float, *, carried: bool, overstated: bool
) -> Diagnostic:
    """The rows of the clause ``name`` follow one another, and their errors are positively correlated.

    ``sums`` is a sum of products of residuals with those before, weighted by ``decay``, and its mean and standard
    deviation with independent noise. ``carried``: they are the transitions of a state; ``overstated``: the stated
    noise is too large.
    """
    found, expected, spread = sums
    reach = "neighbouring steps" if decay == 0.0 else f"steps up to some {round(1.0 / (1.0 - decay))} apart"
    where = "the transition" if carried else f"`{name}`"
    mend = (
        "declare what drifts as a state of its own, `(bias :init 0 :sigma …)` with `(random-walk bias :sigma …)`, and "
        "add it in FORM; or state a larger `:sigma` of the transition, with filters too"
        if carried
        else "declare what drifts as unknown and add it to the model (one `bias`, or one for each stretch, "
        "`(bias :per TABLE)`), or state a larger `:sigma`: over n steps errors that are alike add up to n σ, not √n σ"
    )
    return Diagnostic(
        code=AUTOCORRELATED_RESIDUALS,
        message=f"errors of {where} are positively correlated at {reach}: their residuals' weighted "
        f"products sum to {found:.3g} of their squares, with independent noise to {expected:.3g} ± {spread:.2g}; "
        + _too_small(overstated=overstated),
        place=span,
        hint=mend,
        severity=Severity.WARNING,
    )


def bad_leverage(span: Span, name: str, rows: Sequence[int]) -> Diagnostic:
    """Rows of the clause ``name`` that draw the fit to themselves."""
    more = f" and {len(rows) - MOST_LISTED:,} more" if len(rows) > MOST_LISTED else ""
    listed = ", ".join(str(row) for row in rows[:MOST_LISTED])
    what = f"rows {listed}{more} disagree" if len(rows) > 1 else f"row {listed} disagrees"
    return Diagnostic(
        code=BAD_LEVERAGE,
        message=f"{what} with the others of `{name}`, and the fit follows {'them' if len(rows) > 1 else 'it'} in spite "
        "of the loss",
        place=span,
        hint=BAD_LEVERAGE.mend,
        severity=Severity.WARNING,
    )


def equal_rows(span: Span, name: str, out: int, rows: Sequence[int], clauses: Sequence[str]) -> Diagnostic:
    """The row ``out`` of the clause ``name`` is left out; any of its ``rows``, or of other ``clauses``, could be."""
    more = f" and {len(rows) - MOST_LISTED:,} more" if len(rows) > MOST_LISTED else ""
    listed = ", ".join(str(row) for row in rows[:MOST_LISTED]) + more
    which = [f"row{'s' if len(rows) > 1 else ''} {listed}"] if rows else []
    which += [f"the rows of {', '.join(f'`{each}`' for each in clauses)}"] if clauses else []
    return Diagnostic(
        code=AMBIGUOUS_CONSENSUS,
        message=f"row {out} of `{name}` is left out, and one of {' and '.join(which)} could be in its place: the cost "
        "is about the same, and nothing else tells which is wrong",
        place=span,
        hint=AMBIGUOUS_CONSENSUS.mend,
        severity=Severity.WARNING,
    )


def improbable_noise(span: Span, sigma0: float, probability: float, *, large: bool) -> Diagnostic:
    """``probability``: that of a chi² as large, or as small."""
    size = "large" if large else "small"
    return Diagnostic(
        code=IMPROBABLE_NOISE,
        message=f"chi² is improbably {size} for the stated noise (p = {probability:.1g}): the residuals are "
        f"{sigma0:.3g} times as large as it lets expect",
        place=span,
        hint=IMPROBABLE_NOISE.mend,
        severity=Severity.WARNING,
    )


def coarse_readings(span: Span, name: str, scatter: float, *, counts: bool) -> Diagnostic:
    """Readings of the clause ``name`` in steps that are coarse beside their ``scatter``, in steps.

    ``counts``: they are whole numbers from 0 on, and may be counted.
    """
    return Diagnostic(
        code=COARSE_READINGS,
        message=f"the readings of `{name}` are rounded: they scatter by {scatter:.2f} of their steps about the "
        "model, too little to average the rounding errors out",
        place=span,
        hint=f"{COUNTED} {COARSE_READINGS.mend}" if counts else COARSE_READINGS.mend,
        severity=Severity.WARNING,
    )


def weights_from_readings(span: Span, name: str, shift: float, end: str) -> Diagnostic:
    """The ``shift`` of estimates, in standard deviations, by weights that follow the readings of a clause.

    ``end`` names the readings that weigh more, ``low`` or ``high``.
    """
    return Diagnostic(
        code=WEIGHTS_FROM_READINGS,
        message=f"the standard deviations of `{name}` follow its own readings, so that those that came out {end} "
        f"weigh more: that draws the estimates by some {shift:.2g} standard deviations",
        place=span,
        hint=WEIGHTS_FROM_READINGS.mend,
        severity=Severity.WARNING,
    )


def outlying_row(span: Span, name: str, row: int, distance: float, probability: float, widened: float) -> Diagnostic:
    """The ``row`` of the clause ``name`` is so far off, in standard deviations; noise is so many times as large."""
    said = (
        f"row {row} of `{name}` is {distance:.3g} standard deviations from what the other rows say "
        f"(p = {probability:.1g} for the farthest row), and alone makes the unknown noise {widened:.2g} times as large"
    )
    return Diagnostic(
        code=OUTLYING_ROW,
        message=said
        if isfinite(widened)
        else f"without row {row} of `{name}` all residuals are zero: the unknown noise is told by it alone",
        place=span,
        hint=OUTLYING_ROW.mend,
        severity=Severity.WARNING,
    )


def readings_at_edge(span: Span, name: str, counts: tuple[int, int], edge: float, *, lower: bool) -> Diagnostic:
    """Of the readings of the clause ``name`` some are the ``edge``; ``counts`` are theirs and that of all."""
    some, every = counts
    which, option = ("least", ":below") if lower else ("largest", ":above")
    return Diagnostic(
        code=READINGS_AT_EDGE,
        message=f"{some} of the {every} readings of `{name}` {'are' if some > 1 else 'is'} exactly {edge:.6g}, the "
        f"{which} of all, and others are not so coarse: values beyond a limit seem to be entered as it (`{option}`)",
        place=span,
        hint=READINGS_AT_EDGE.mend,
        severity=Severity.WARNING,
    )


def vanishing_scale(span: Span, name: str, scales: Sequence[str], *, exact: bool) -> Diagnostic:
    """Scales of the clause ``name`` that are nothing; ``exact``: because its readings fit exactly."""
    listed = ", ".join(f"`{each}`" for each in scales)
    are = "are" if len(scales) > 1 else "is"
    why = (
        f"the readings of `{name}` fit exactly, so that the likelihood of {listed} has no maximum: all standard "
        "deviations are those of an arbitrary scale"
        if exact
        else f"{listed} in the noise of `{name}` {are} estimated as zero; the standard deviation that is stated of "
        f"{'them' if len(scales) > 1 else 'it'} means nothing"
    )
    return Diagnostic(
        code=VANISHING_SCALE,
        message=why,
        place=span,
        hint=VANISHING_SCALE.mend,
        severity=Severity.WARNING,
    )


def hidden_outliers(span: Span, name: str, core: float, rows: Sequence[tuple[int, float]]) -> Diagnostic:
    """Most errors of the clause ``name`` are ``core`` times the stated ones.

    Of each of the ``rows``, the worst first, how far out it is beside those.
    """
    more = f" and {len(rows) - MOST_LISTED:,} more" if len(rows) > MOST_LISTED else ""
    listed = ", ".join(f"{row} ({far:.3g})" for row, far in rows[:MOST_LISTED])
    return Diagnostic(
        code=HIDDEN_OUTLIERS,
        message=f"most errors of `{name}` are {core:.2g} times as large as stated, and some far larger than those: "
        f"row{'s' if len(rows) > 1 else ''} {listed}{more} (in brackets how many of their standard deviations); "
        "outliers hide within the stated noise",
        place=span,
        hint=HIDDEN_OUTLIERS.mend,
        severity=Severity.WARNING,
    )


def small_sample(span: Span) -> Diagnostic:
    """Noise that too few rows tell."""
    return Diagnostic(
        code=SMALL_SAMPLE,
        message="the noise is estimated from so few rows that intervals hold the true value less often than they say",
        place=span,
        hint=SMALL_SAMPLE.mend,
        severity=Severity.WARNING,
    )
