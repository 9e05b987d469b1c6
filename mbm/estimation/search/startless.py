"""Unknowns without a start: whether random points may serve, and whose `:init` would do where they may not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mbm.problem import faults
from mbm.problem.manifold import Piece
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from mbm.equations.assembly import Assembled
    from mbm.equations.layout import Entry
    from mbm.equations.types import Floats
    from mbm.estimation.settings import Settings

MOST_ROTATIONS = 3
"""Rotations of space that random points may guess at once; one of 128 is near four of them in one case of 1,000."""


def may_be_startless(problem: Problem, tables: Mapping[str, Table]) -> bool:
    """Whether more rotations of space are without a start than random points may guess."""
    count = 0
    for unknown in problem.unknowns:
        turns = sum(piece is Piece.QUATERNION for piece in unknown.manifold.pieces)
        if turns and unknown.start is None:
            count += turns * (1 if unknown.family is None else len(tables[unknown.family.rows]))
    return count > MOST_ROTATIONS


def refuse_guessing(equations: Assembled, numbers: Floats, settings: Settings) -> None:
    """What closed forms leave open (N,), NaN there, must not be too much to be guessed.

    Raises:
        MbmError: more rotations of space are left than random points may guess. It names the unknowns whose `:init`
            would do.

    """
    layout = equations.layout
    turns = [c.numbers for c in layout.curved if c.piece is Piece.QUATERNION]
    if sum(int(np.isnan(numbers[each]).any(axis=1).sum()) for each in turns) <= MOST_ROTATIONS:
        return
    wanted = sufficient(equations, numbers, settings)
    others = len(wanted) < sum(bool(np.isnan(numbers[entry.range]).any()) for entry in layout.entries)
    raise MbmError(*(faults.missing_start(e.unknown.span, e.unknown.name, others=others) for e in wanted))


def sufficient(equations: Assembled, numbers: Floats, settings: Settings) -> list[Entry]:
    """Unknowns whose starts would do: the smaller ones until nothing is left open, but for those that others tell."""
    missing = [entry for entry in equations.layout.entries if bool(np.isnan(numbers[entry.range]).any())]
    given: list[Entry] = []
    for entry in sorted(missing, key=lambda each: each.count):
        given.append(entry)
        if _complete(equations, numbers, settings, given):
            break
    for entry in tuple(given):
        fewer = [each for each in given if each is not entry]
        if fewer and _complete(equations, numbers, settings, fewer):
            given = fewer
    return given


def _complete(equations: Assembled, numbers: Floats, settings: Settings, given: Sequence[Entry]) -> bool:
    """Whether closed forms give all numbers, if those of some unknowns are known."""
    from mbm.estimation.starts.magnitudes import magnitudes

    layout = equations.layout
    missing = replace(layout, start=numbers).missing()
    flat = layout.number >= 0
    likely = np.zeros(len(numbers))
    likely[layout.number[flat]] = magnitudes(equations, numbers, missing).middle[flat]
    for curved in layout.curved:
        likely[curved.numbers] = np.eye(curved.piece.size)[0]
    known = numbers.copy()
    for entry in given:
        known[entry.range] = np.where(np.isnan(numbers[entry.range]), likely[entry.range], numbers[entry.range])
    return bool(completed(equations, known, settings))


def completed(equations: Assembled, numbers: Floats, settings: Settings) -> tuple[Floats, ...]:
    """All numbers (N,) as closed forms give what some of them leave open, in each way that leaves nothing open."""
    from mbm.estimation.starts.closed_forms.completion import completions
    from mbm.estimation.starts.closed_forms.rows import ENOUGH
    from mbm.estimation.starts.closed_forms.types import Situation

    situation = Situation(layout=equations.layout, groups=equations.groups, numbers=numbers, most=ENOUGH)
    found = (each.numbers for each in completions(situation, settings.closed_forms))
    return tuple(each for each in found if not bool(np.isnan(each).any()))
