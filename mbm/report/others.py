"""What a search found beside the best solution, in words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from math import pi

from mbm.report.digits import plain
from mbm.report.elements import Scalar, scalars, unit_text
from mbm.report.types import Alternative, Estimate, Kind, SolveReport

MOST_SOLUTIONS = 4
"""Other solutions that are shown; the document has all."""

MOST_NUMBERS = 4
"""Numbers of another solution that are shown: those that differ most from the best one."""

NOTHING = 1e-9
"""Numbers that differ by less, relatively, are the same."""


def search_sentences(solve: SolveReport) -> Iterator[str]:
    """How many starts led where, and the other solutions that fit best."""
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


def _other(solve: SolveReport, other: Alternative) -> str:
    found = f"cost {plain(other.cost, 5)} from {other.starts} start{'' if other.starts == 1 else 's'}"
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
            turn = 2 * pi / its.quantity.factor
            apart = min(apart % turn, turn - apart % turn)
        size = max(abs(its.value), abs(mine.value))
        if size > 0 and apart > NOTHING * size:
            yield apart / size, its
