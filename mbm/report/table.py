"""Result → the table a person reads: one solve with what its search found beside, or a line for each of many."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from math import pi

from mbm.report.columns import aligned, fitting, left, wrapped
from mbm.report.digits import Measured, enclosed, measured, plain
from mbm.report.elements import Scalar, number_text, scalars, unit_text
from mbm.report.interval_table import cut_sentences, interval_lines
from mbm.report.noise import noise_sentences
from mbm.report.sentences import (
    constraint_sentences,
    diagnostic_sentence,
    fit_sentence,
    observability_sentences,
    prior_sentences,
    residual_sentences,
)
from mbm.report.types import Alternative, DerivedValue, Estimate, Kind, Piece, Result, SolveReport, SolveStatus
from mbm.text.shown import Paint, Style, cell_width, joined

MOST_SCALARS = 24
"""Rows of one vector, array or family that are shown; the table says how many more there are."""

LEAST_DOC = 40
"""Columns of a ``:doc`` that are shown in any case."""

_FIRST_SCALARS = 20


MOST_SOLUTIONS = 4
"""Other solutions that are shown; the document has all."""
MOST_NUMBERS = 4
"""Numbers of another solution that are shown: those that differ most from the best one."""
NOTHING = 1e-9
"""Numbers that differ by less, relatively, are the same."""


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
    texts = [number_text(scalar) for scalar, _ in shown]
    names = left(scalar.name for scalar, _ in shown)
    values = aligned([text.value for text in texts])
    sigmas = aligned([text.sigma for text in texts])
    units = left(unit_text(scalar.quantity) for scalar, _ in shown)
    for i, (scalar, left_out) in enumerate(shown):
        sign = "±" if texts[i].sigma else " "
        line = f"  {paint(names[i], Style.HEADING)}  {values[i]} {sign} {sigmas[i]}  {units[i]}"
        taken = 9 + sum(map(cell_width, (names[i], values[i], sigmas[i], units[i])))  # with what stands between them
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


def search_sentences(solve: SolveReport) -> Iterator[str]:
    """How many starts led where, and the other solutions that fit best; how many boxes, and the separate pieces."""
    if solve.boxes is not None:
        yield f"guaranteed bounds: {solve.boxes:,} box{'' if solve.boxes == 1 else 'es'} examined"
    for number, piece in enumerate(solve.pieces[:MOST_SOLUTIONS], 1):
        yield f"separate piece {number} of {len(solve.pieces)}{_narrowest(solve, piece)}"
    if len(solve.pieces) > MOST_SOLUTIONS:
        yield f"… and {len(solve.pieces) - MOST_SOLUTIONS} more pieces, which the document lists"
    tally = solve.starts
    if tally is not None:
        text = f"{tally.tried} starts: {tally.converged} converged, {tally.best_found} to the best fit"
        others = len(solve.alternatives)
        yield f"{text}; {others} other solution{'' if others == 1 else 's'}" if others else text
    for other in solve.alternatives[:MOST_SOLUTIONS]:
        yield _other(solve, other)
    left = len(solve.alternatives) - MOST_SOLUTIONS
    if left > 0:
        yield f"… and {left} more with larger costs, which the document lists"


def _narrowest(solve: SolveReport, piece: Piece) -> str:
    """The bounds of a piece that are narrower than those of the whole set, the narrowest first."""
    wholes: list[Estimate | DerivedValue] = [*solve.estimates, *solve.derived]
    parts: list[Estimate | DerivedValue] = [*piece.estimates, *piece.derived]
    found = []
    pairs = (zip(scalars(whole), scalars(part), strict=True) for whole, part in zip(wholes, parts, strict=True))
    for whole, part in chain.from_iterable(pairs):
        if whole.bounds is not None and part.bounds is not None:
            wide, narrow = whole.bounds[1] - whole.bounds[0], part.bounds[1] - part.bounds[0]
            if narrow < (1 - NOTHING) * wide:
                found.append((narrow / wide, part, part.bounds))
    found.sort(key=lambda each: each[0])
    texts = (f"{s.name} in {enclosed(*ends)} {unit_text(s.quantity)}".rstrip() for _, s, ends in found[:MOST_NUMBERS])
    return f": {', '.join(texts)}" if found else ""


def _other(solve: SolveReport, other: Alternative) -> str:
    cost = f"cost {plain(other.cost, 5)}"
    found = cost if other.robust_cost is None else f"sum of the losses {plain(other.robust_cost, 5)}, {cost}"
    if solve.starts is not None:
        found += f" from {other.starts} start{'' if other.starts == 1 else 's'}"
    remark = f" ({other.remark})" if other.remark else ""
    apart = sorted(_differences(solve.estimates, other.estimates), key=lambda pair: -pair[0])
    if not apart:
        return f"another solution, {found}{remark}"
    texts = (f"{s.name} = {plain(s.value, 5)} {unit_text(s.quantity)}".rstrip() for _, s in apart[:MOST_NUMBERS])
    more = len(apart) - MOST_NUMBERS
    what = "one more number that differs" if more == 1 else f"{more} more numbers that differ"
    rest = f" and {what}" if more > 0 else ""
    return f"another solution, {found}, with {', '.join(texts)}{rest}{remark}"


def _differences(best: Iterable[Estimate], other: Iterable[Estimate]) -> Iterator[tuple[float, Scalar]]:
    """The numbers of ``other`` that are not those of ``best``, each with its relative difference."""
    ours, theirs = (list(chain.from_iterable(map(scalars, items))) for items in (best, other))
    for mine, its in zip(ours, theirs, strict=True):
        apart = abs(its.value - mine.value)
        if its.quantity.kind is Kind.ANGLE:
            turn = 2 * pi / its.quantity.scale.factor
            apart = min(apart % turn, turn - apart % turn)
        size = max(abs(its.value), abs(mine.value))
        if size > 0 and apart > NOTHING * size:
            yield apart / size, its
