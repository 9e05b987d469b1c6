"""The errors of the trajectory that a problem aligns: of each pose, and over steps.

Absolute and relative pose errors (Sturm and others 2012, Zhang and Scaramuzza 2018): with the reference Q and the
aligned estimate P, both leading from the body to the world, the error of a pose is ``E = Q⁻¹ P``; that of a step from
i to j is ``E = (Qᵢ⁻¹ Qⱼ)⁻¹ (Pᵢ⁻¹ Pⱼ)``. Without rotations, positions are compared, and over steps the distances between
them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from mbm.problem.pairing import paired_rows
from mbm.problem.rows import nearest_later, travelled
from mbm.problem.tables import TIME, CellKey, PairDeclaration, StepKind
from mbm.problem.types import Block, Problem, UnknownKind
from mbm.report.trajectories import faults
from mbm.report.trajectories.sides import Laid, Place, laid, trajectory_blocks
from mbm.report.trajectories.types import Errors, Floats, Indices, Path, Segments, Trajectory
from mbm.text.types import MbmError

SHARE = 0.1
"""How far from the step that a caller asks for the times or paths of two poses may be apart, as a part of it."""

DIGITS_ALONE = 1e-9
"""Spread of positions, beside their largest coordinate, that their digits alone make."""

COLLAPSED = 0.1
"""Spread of an aligned path beside that of the reference, below which its scale tells of the noise alone: the ratio is
the correlation of the two."""

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
        MbmError: no-trajectory (a similarity that leaves nothing of the path, too), several-trajectories, bad-delta.

    """
    block = chosen_block(place.problem, observation)
    found = laid(place, block)
    _refuse_collapsed(place, found)
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


def _refuse_collapsed(place: Place, found: Laid) -> None:
    entries = [each for each in place.layout.entries if each.unknown.kind is UnknownKind.SIMILARITY]
    if not any(not bool(place.layout.fixed[each.range].all()) for each in entries):
        return
    reference, estimate = (_spread(each.positions) for each in (found.reference, found.estimate))
    still = reference <= DIGITS_ALONE * float(np.abs(found.reference.positions).max(initial=0.0))
    if len(found.positions) > 1 and (still or estimate <= COLLAPSED * reference):
        raise MbmError(faults.no_scale(place.problem.span, found.sides, still=still))


def _spread(positions: Floats) -> float:
    """The root mean square distance from their mean."""
    return float(np.sqrt(np.square(positions - positions.mean(axis=0)).sum(axis=1).mean())) if len(positions) else 0.0


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


def absolute_errors(reference: Path, estimate: Path, unit: str | None, factor: float) -> Errors:
    """The error of each pose; of the same number and order."""
    apart = estimate.positions - reference.positions
    if reference.rotations is None or estimate.rotations is None:
        return Errors(translation=_lengths(apart), unit=unit, factor=factor)
    turned = np.einsum("nji,njk->nik", reference.rotations, estimate.rotations)
    return _errors(turned, np.einsum("nji,nj->ni", reference.rotations, apart), unit, factor)


def relative_errors(paths: tuple[Path, Path], start: Indices, end: Indices, unit: str | None, factor: float) -> Errors:
    """The errors of the steps from ``start`` (k,) to ``end`` (k,); ``paths`` are the reference and the estimate."""
    begin, finish = ([path.take(rows) for path in paths] for rows in (start, end))
    if any(path.rotations is None for path in paths):
        lengths = [_lengths(b.positions - a.positions) for a, b in zip(begin, finish, strict=True)]
        return Errors(translation=np.abs(lengths[1] - lengths[0]), unit=unit, factor=factor)
    steps = [_step(a, b) for a, b in zip(begin, finish, strict=True)]
    (turn, move), (own_turn, own_move) = steps
    turned = np.einsum("nji,njk->nik", turn, own_turn)
    return _errors(turned, np.einsum("nji,nj->ni", turn, own_move - move), unit, factor)


def segments(
    paths: tuple[Path, Path],
    pairs: tuple[Indices, Indices],
    said: tuple[str | None, str, float, str | None],
    unit: str | None,
    factor: float,
) -> Segments:
    """The errors over steps; ``said`` is the name of the pair, what it goes by, its step and unit."""
    start, end = pairs
    positions = paths[0].positions
    gone = np.concatenate([np.zeros(1), np.cumsum(_lengths(np.diff(positions, axis=0)))])
    name, by, step, own = said
    return Segments(
        name=name,
        by=by,
        step=step,
        unit=own,
        start=start,
        end=end,
        lengths=np.abs(gone[end] - gone[start]),
        errors=relative_errors(paths, start, end, unit, factor),
    )


def _step(begin: Path, finish: Path) -> tuple[Floats, Floats]:
    """The rotations and translations from one pose to another, in the axes of the first."""
    if begin.rotations is None or finish.rotations is None:
        raise TypeError(begin)
    turn = np.einsum("nji,njk->nik", begin.rotations, finish.rotations)
    return turn, np.einsum("nji,nj->ni", begin.rotations, finish.positions - begin.positions)


def _errors(turned: Floats, moved: Floats, unit: str | None, factor: float) -> Errors:
    apart = np.square(turned - np.eye(turned.shape[1])).sum(axis=(1, 2))
    return Errors(
        translation=_lengths(moved),
        rotation=_angles(turned),
        turned=np.sqrt(apart),
        full=np.sqrt(apart + np.square(moved).sum(axis=1)),
        unit=unit,
        factor=factor,
    )


def _angles(turned: Floats) -> Floats:
    """The angles (n,) of rotations, in [0, π]; exact for small ones, where the trace has lost its digits."""
    if turned.shape[1] == 2:
        return np.asarray(np.abs(np.arctan2(turned[:, 1, 0], turned[:, 0, 0])))
    axis = np.stack(
        [
            turned[:, 2, 1] - turned[:, 1, 2],
            turned[:, 0, 2] - turned[:, 2, 0],
            turned[:, 1, 0] - turned[:, 0, 1],
        ],
        axis=1,
    )
    return np.asarray(np.arctan2(_lengths(axis), np.trace(turned, axis1=1, axis2=2) - 1.0))


def _lengths(vectors: Floats) -> Floats:
    return np.asarray(np.sqrt(np.square(vectors).sum(axis=1)))
