"""Result → the table a person reads: one solve with what its search found beside, or a line for each of many."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from math import pi

from mbm.report.columns import aligned, fitting, laid_out, left, wrapped
from mbm.report.digits import Measured, enclosed, measured, plain
from mbm.report.elements import Scalar, number_text, scalars, unit_text
from mbm.report.intervals import cut_sentences, interval_lines
from mbm.report.noise import noise_sentences
from mbm.report.sentences import (
    constraint_sentences,
    diagnostic_sentence,
    fit_sentence,
    observability_sentences,
    prior_sentences,
    residual_sentences,
    search_sentences,
)
from mbm.report.types import DerivedValue, Estimate, Kind, Result, SolveReport, SolveStatus
from mbm.text.shown import Paint, Style, cell_width, joined

MOST_SCALARS = 24
"""Rows of one vector, array or family that are shown; the table says how many more there are."""

LEAST_DOC = 40
"""Columns of a ``:doc`` that are shown in any case."""

_FIRST_SCALARS = 20


def table(result: Result, *, width: int = 80, color: bool = False, full: bool = False, intervals: bool = False) -> str:
    """The table, lines of at most about ``width`` columns, with a line break at the end.

    ``color`` adds ANSI escapes; ``full`` shows every row of long families and of many solves, and how it was solved;
    ``intervals`` adds those of the estimates.
    """
    paint = Paint(color)
    if len(result.solves) == 1 and not result.solves[0].key:
        lines = list(_one_solve(result, result.solves[0], width, paint, full))
    else:
        from mbm.report.many import many_solves

        lines = [_heading(result, None, paint), "", *many_solves(result.solves, width, paint, full)]
    if intervals:
        lines += ["", *interval_lines(result.solves, paint, full)]
    return joined((line.rstrip() for line in lines), color=color).rstrip("\n") + "\n"


def headline(result: Result, *, color: bool = False) -> str:
    """One line that says how all solves ended, with a line break at the end."""
    paint, solves = Paint(color), result.solves
    if len(solves) == 1 and not solves[0].key:
        line = _heading(result, solves[0].status, paint)
    else:
        from mbm.report.many import statuses_in_words

        line = f"{_heading(result, None, paint)}: {statuses_in_words(solves)}"
    return joined((line,), color=color) + "\n"


def _heading(result: Result, status: SolveStatus | None, paint: Paint) -> str:
    where = f"{result.file}: " if result.file else ""
    head = paint(f"{where}problem `{result.problem}`", Style.HEADING)
    if status is None:
        return head
    return f"{head}: {paint(status.value, Style.GOOD if status.trusted else Style.BAD)}"


def _one_solve(result: Result, solve: SolveReport, width: int, paint: Paint, full: bool) -> Iterator[str]:
    yield _heading(result, solve.status, paint)
    cause = next((each for each in solve.diagnostics if each.message == solve.message), None)
    if cause is not None:
        yield from (paint(line, Style.WARNING) for line in wrapped(diagnostic_sentence(cause), width))
    elif not solve.status.trusted:
        yield from wrapped(solve.message or solve.status.sentence, width)
    if solve.estimates or solve.derived:
        yield ""
        yield from estimate_lines(chain(solve.estimates, solve.derived), width, paint, full)
    yield ""
    fit = fit_sentence(solve)
    if fit is not None:
        yield from wrapped(fit, width)
    for sentence in chain(noise_sentences(solve.noise, solve.noise_units), residual_sentences(solve)):
        yield from wrapped(sentence, width)
    remarks = chain(observability_sentences(solve.observability), constraint_sentences(solve), prior_sentences(solve))
    for sentence in remarks:
        yield from (paint(line, Style.WARNING) for line in wrapped(sentence, width))
    for sentence in chain(cut_sentences(solve), search_sentences(solve)):
        yield from wrapped(sentence, width)
    for what, why in solve.not_examined.items():
        yield from wrapped(f"not examined: {what} ({why})", width)
    for diagnostic in (each for each in solve.diagnostics if each is not cause):
        yield from (paint(line, Style.WARNING) for line in wrapped(diagnostic_sentence(diagnostic), width))
    if full:
        yield from (paint(line, Style.QUIET) for line in wrapped(_how(solve), width))


def _how(solve: SolveReport) -> str:
    done = f"{solve.iterations} iterations, {solve.evaluations} evaluations"
    if solve.boxes is not None:
        done = f"{solve.boxes:,} boxes"
    return f"{solve.method or 'no method'}: {done}, {plain(solve.seconds * 1e3, 3)} ms; {solve.message}"


def estimate_lines(items: Iterable[Estimate | DerivedValue], width: int, paint: Paint, full: bool) -> Iterator[str]:
    """One line for each scalar: name, value ± sigma or bounds, unit, and what else is known of it."""
    shown: list[tuple[Scalar, int]] = []
    for item in items:
        every = list(scalars(item))
        kept = every if full or len(every) <= MOST_SCALARS else every[:_FIRST_SCALARS]
        shown.extend((scalar, 0) for scalar in kept[:-1])
        shown.extend((scalar, len(every) - len(kept)) for scalar in kept[-1:])
    rows = [(s.name, number_text(s).value, number_text(s).sigma, unit_text(s.quantity)) for s, _ in shown]
    for (scalar, left_out), cells in zip(shown, laid_out(rows, (left, aligned, aligned, left)), strict=True):
        name, value, sigma, unit = cells
        line = f"  {paint(name, Style.HEADING)}  {value} {'±' if sigma.strip() else ' '} {sigma}  {unit}"
        taken = 9 + sum(map(cell_width, cells))  # with what stands between them
        yield line + _notes(scalar, width - taken, paint)
        if left_out:
            yield paint(f"  … {left_out} more of `{scalar.quantity.name}` (-v shows all)", Style.QUIET)


def _notes(scalar: Scalar, room: int, paint: Paint) -> str:
    """What is known beside the number, as far as there is room; the reason of a missing sigma always.

    Of a ``:doc`` that stands alone a part is shown: where a terminal goes on with it on the next line, it would seem to
    be a line of the table.
    """
    notes: list[str] = []
    if scalar.fixed:
        notes.append("fixed")
    elif scalar.at_bound:
        notes.append("held at its bound")
    elif scalar.sigma != scalar.sigma and scalar.bounds is None:
        notes.append(scalar.reason or "not determined")
    if scalar.quantity.kind is Kind.ANGLE and unit_text(scalar.quantity) == "rad":
        notes.append(f"= {_in_degrees(scalar)}")
    if scalar.derived:
        notes.append("derived")
    if scalar.quantity.doc and not scalar.name.endswith("]"):
        notes.append(scalar.quantity.doc if notes else fitting(scalar.quantity.doc, max(room - 2, LEAST_DOC)))
    text = ""
    for i, note in enumerate(notes):
        longer = f"{text}, {note}" if text else note
        if i > 0 and cell_width(longer) + 2 > room:
            break
        text = longer
    return f"  {paint(text, Style.QUIET)}" if text else ""


def _in_degrees(scalar: Scalar) -> str:
    if scalar.bounds is not None and not scalar.fixed:
        return f"{enclosed(*(end * 180 / pi for end in scalar.bounds))} deg"
    text: Measured = measured(
        scalar.value * 180 / pi, scalar.sigma * 180 / pi, exact=scalar.fixed or scalar.at_bound or not scalar.sigma >= 0
    )
    return f"{text} deg"
