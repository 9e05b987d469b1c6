"""The errors of the trajectory that a problem aligns: of each pose, and over steps."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from mbm.problem.pairing import paired_rows
from mbm.problem.self_pairing import nearest_later, travelled
from mbm.problem.tables import TIME, CellKey, PairDeclaration, StepKind
from mbm.problem.types import Block, Problem
from mbm.report.trajectories import faults
from mbm.report.trajectories.errors import absolute_errors, segments
from mbm.report.trajectories.sides import Laid, Place, laid, trajectory_blocks
from mbm.report.trajectories.types import Floats, Indices, Segments, Trajectory
from mbm.text.types import MbmError

SHARE = 0.1
"""How far from the step that a caller asks for the times or paths of two poses may be apart, as a part of it."""

_DELTA = re.compile(r"([0-9]*\.?[0-9]+(?:[eE][+-]?[0-9]+)?)(f|s|m)")
_WORDS = {StepKind.ROWS: "rows", StepKind.TIME: "time", StepKind.DISTANCE: "distance"}
_UNITS = {StepKind.TIME: "s", StepKind.DISTANCE: "m"}
_KINDS = {"f": StepKind.ROWS, "s": StepKind.TIME, "m": StepKind.DISTANCE}


def chosen_block(problem: Problem, name: str | None) -> Block:
    """The observation of that name, or the only one of a trajectory.

    Raises:
        MbmError: no-trajectory, several-trajectories.

    """
    found = trajectory_blocks(problem)
    if name is not None:
        found = tuple(block for block in found if block.name == name)
    if not found:
        why = "no observation compares two positions or poses" if name is None else f"`{name}` compares none"
        raise MbmError(faults.no_trajectory(problem.span, why))
    if len(found) > 1:
        raise MbmError(faults.several_trajectories([block.name for block in found]))
    return found[0]


def trajectory(
    place: Place, key: Mapping[str, CellKey], deltas: Sequence[str] = (), observation: str | None = None
) -> Trajectory:
    """The trajectory of a problem with its errors; those over steps are of the pairs of its table with itself.

    ``deltas`` are further steps: ``10f`` rows, ``0.5s`` times, ``2m`` of the reference's path. Without either, rows are
    compared with the next. Every row starts a step, as evo has it with ``--all_pairs``.

    Raises:
        MbmError: no-trajectory, several-trajectories, bad-delta.

    """
    block = chosen_block(place.problem, observation)
    found = laid(place, block)
    times = _times(found)
    rpe: list[Segments | None] = [*_stated(place, block, found)]
    rpe += [_asked(text, found, times) for text in deltas or (() if rpe else ("1f",))]
    return Trajectory(
        clause=block.name,
        key=key,
        sides=found.sides,
        rows=found.table.rows[found.positions],
        times=times,
        estimate=found.estimate,
        reference=found.reference,
        ape=absolute_errors(found.reference, found.estimate, found.unit, found.factor),
        rpe=tuple(each for each in rpe if each is not None),
    )


def _times(found: Laid) -> Floats | None:
    column = found.table.columns.get(TIME)
    return None if column is None or column.numbers is None else column.numbers[found.positions]


def _stated(place: Place, block: Block, found: Laid) -> Iterator[Segments]:
    """The errors over the steps that pairs of the problem state."""
    number = {int(position): i for i, position in enumerate(found.positions)}
    for pair in place.problem.pairs:
        if pair.steps is None or pair.first != block.table:
            continue
        start, end = paired_rows(pair, found.table)
        both = [i for i, (a, b) in enumerate(zip(start, end, strict=True)) if int(a) in number and int(b) in number]
        if not both:
            raise MbmError(faults.no_steps(f"as far as `{pair.name}` wants"))
        rows = tuple(np.array([number[int(side[i])] for i in both], dtype=np.int64) for side in (start, end))
        yield _over((rows[0], rows[1]), (pair.name, *_said(pair)), found)


def _said(pair: PairDeclaration) -> tuple[str, float, str | None]:
    if pair.steps is None:
        raise TypeError(pair.name)
    kind = pair.steps.kind
    return _WORDS[kind], pair.steps.step, _UNITS.get(kind)


def _asked(text: str, found: Laid, times: Floats | None) -> Segments | None:
    """The errors over a step that the caller asks for; the usual one of a single pose has none."""
    match = _DELTA.fullmatch(text.strip())
    step = float(match[1]) if match else math.nan
    kind = _KINDS[match[2]] if match else StepKind.ROWS
    if not 0 < step < math.inf or (kind is StepKind.ROWS and not step.is_integer()):
        raise MbmError(faults.bad_delta(text))
    count = len(found.positions)
    if kind is StepKind.ROWS:
        begin = np.arange(max(count - int(min(step, count)), 0))
        pairs = (begin, begin + int(min(step, count)))
    elif kind is StepKind.DISTANCE:
        pairs = nearest_later(travelled(found.reference.positions), step, SHARE * step)
    else:
        if times is None:
            raise MbmError(faults.no_times(found.table.name))
        order = np.argsort(times, kind="stable")
        begin, end = nearest_later(times[order], step, SHARE * step)
        pairs = (order[begin], order[end])
    if not len(pairs[0]):
        if count < 2:
            return None
        raise MbmError(faults.no_steps(text))
    return _over(pairs, (None, _WORDS[kind], step, _UNITS.get(kind)), found)


def _over(pairs: tuple[Indices, Indices], said: tuple[str | None, str, float, str | None], found: Laid) -> Segments:
    return segments((found.reference, found.estimate), pairs, said, found.unit, found.factor)
