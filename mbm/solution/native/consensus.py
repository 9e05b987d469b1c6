"""Consensus of many data sets in native code: which units agree in each, and where."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbm.solution.native.code import SolverCode
from mbm.solution.native.consensus_rules import Rules
from mbm.solution.native.system import AT_A_TIME, NativeSystem, never
from mbm.solution.types import Floats, Indices, Mask
from mbm.target.solver import consensus_description as c
from mbm.target.solver import description as of
from mbm.target.solver.description import LANES
from mbm.target.solver.workspace import work_reals
from mbm.values import dataclass

TRIALS = 10
"""The work of a consensus in units of solves with all rows, as a guess."""

SHAPES = 100
"""Rooms that are remembered."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConsensusEnds:
    """What D data sets agree on; their units stand one after the other.

    ``points`` (D, N) is where the units agree, the first start where they do not; ``states`` (D, `ANSWERS`). For each
    unit ``inside`` says whether it agrees, with squared norms up to ``limits``; ``variances`` are those of the noise.
    ``cut_short``: the one data set there is was interrupted.
    """

    points: Floats
    states: Indices
    inside: Mask
    limits: Floats
    variances: Floats
    cut_short: bool = False

    @property
    def agreed(self) -> Mask:
        """Where there is an answer (D,); elsewhere another method should take over."""
        return np.asarray(self.states[:, c.AGREED] == 1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Room:
    """A system's header and the table of rules with room for some numbers of rows, and what scratch they ask for.

    ``work`` and ``bench`` are numbers of reals, ``places`` of integers. ``held`` is what all that follows from.
    """

    header: Indices
    table: Indices
    work: int
    bench: int
    places: int
    held: tuple[object, ...]


class Rooms:
    """Rooms that were made, for data sets of the same shape: to make one takes longer than a small consensus."""

    def __init__(self) -> None:
        self._known: dict[object, Room] = {}

    def of(self, system: NativeSystem, rules: Rules) -> Room:
        """The room for the largest data set of a system."""
        most = rows_of_blocks(system).max(axis=0).tolist()
        key = (id(system.system), id(rules), *most)
        found = self._known.get(key)
        if found is None:
            if len(self._known) >= SHAPES:
                self._known.clear()
            found = self._known[key] = _room(system, rules, most)
        return found


def rows_of_blocks(system: NativeSystem) -> Indices:
    """How many rows each data set has in each block of residuals (D, blocks)."""
    first = of.DATA_HEAD + of.DATA_ROWS
    return np.asarray(
        system.rows.data[:, first : first + of.DATA_BLOCK * int(system.system[of.BLOCKS]) : of.DATA_BLOCK]
    )


def units_of_rows(system: NativeSystem, rules: Rules) -> Indices:
    """The units of a row of each block (blocks,), 0 where no rule acts."""
    first, size = int(system.system[of.BLOCKS_AT]), of.BLOCK
    units = system.system[first + of.BLOCK_UNITS : first + size * len(rules.ruled) : size]
    return np.asarray(units * np.array(rules.ruled))


def units_at_of(system: NativeSystem, rules: Rules) -> Indices:
    """Where the units of each data set begin, and the end of the last ones (D + 1,)."""
    counts = (rows_of_blocks(system) * units_of_rows(system, rules)).sum(axis=1)
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _room(system: NativeSystem, rules: Rules, most: list[int]) -> Room:
    header, table = side_by_side(system.system), rules.rules.copy()
    table[c.MOST_UNITS] = max(int((units_of_rows(system, rules) * most).sum()), 1)
    room = 0
    for b, (ruled, rows) in enumerate(zip(rules.ruled, most, strict=True)):
        block = header[int(header[of.BLOCKS_AT]) + b * of.BLOCK :]
        widths = (of.BLOCK_PARAMETERS, of.BLOCK_WEIGHTS, of.BLOCK_VARIABLES, of.BLOCK_TANGENTS)
        room += ((int(header[of.COORDINATES]) if ruled else rows) + 1) * max(int(block[width]) for width in widths)
    table[c.MOST_ROWS] = room + 1
    return Room(
        header=header,
        table=table,
        work=int(work_reals(header)),
        bench=int(c.bench_reals(header, table)),
        places=int(c.places_integers(header, table)),
        held=(system.system, rules),
    )


def side_by_side(system: Indices) -> Indices:
    """The ``system`` array with room for all rows in one chunk, as consensus takes them."""
    found = system.copy()
    found[of.CHUNK] = -(-int(found[of.RESIDUALS]) // LANES) * LANES
    first, count = int(found[of.BLOCKS_AT]), int(found[of.BLOCKS] + found[of.CONSTRAINTS])
    blocks = found[first : first + count * of.BLOCK].reshape(count, of.BLOCK)
    wide = blocks[:, of.BLOCK_OUTPUTS] + blocks[:, of.BLOCK_NONZEROS]
    found[of.OUTPUTS] = int((wide * (found[of.CHUNK] // np.maximum(blocks[:, of.BLOCK_OUTPUTS], 1) + LANES)).max())
    return found


def consensus_many(
    system: NativeSystem,
    code: SolverCode,
    rules: Rules,
    starts: Floats,
    forms: Floats | None = None,
    *,
    startless: bool = False,
    workers: int = 1,
    rooms: Rooms | None = None,
    stopped: Callable[[], bool] = never,
) -> ConsensusEnds:
    """The units that agree in each data set of a system.

    Args:
        system: the equations and their data sets.
        code: the compiled consensus.
        rules: what is asked for.
        starts: points (D, S, N), all finite but for what the closed form gives.
        forms: what the closed form knows of each unit (units of all data sets, width).
        startless: the closed form gives the starts; those given hold the other numbers.
        workers: threads; the answers do not depend on it.
        rooms: those made for such data sets before.
        stopped: asked now and then; data sets that were not looked at by then do not agree. Of a single one, the best
            of the trials that were made by then is the answer.
    """
    count = len(system.rows.data)
    units_at = units_at_of(system, rules)
    total = int(units_at[-1])
    numbers = int(system.system[of.NUMBERS])
    known = np.zeros(1) if forms is None else np.ascontiguousarray(forms, dtype=np.float64)
    begun = np.ascontiguousarray(starts, dtype=np.float64)
    room = (rooms or Rooms()).of(system, rules)
    table = room.table.copy()
    table[c.STARTLESS] = startless
    points, states = np.zeros((count, numbers)), np.zeros((count, c.ANSWERS), dtype=np.int64)
    inside, limits, variances = np.zeros(total, dtype=np.int64), np.zeros(total), np.zeros(total)
    answers = (points, states, inside, limits, variances)
    code.expect(count * TRIALS * system.expected)
    routine = code.routine("agree_many", int, int, *[object] * 3, int, *[object] * 18)

    def part(first: int, last: int) -> None:
        work, desk, bench = np.zeros(room.work), np.zeros(room.work), np.zeros(room.bench)
        places = np.zeros(room.places, dtype=np.int64)
        step = int(max(AT_A_TIME / (TRIALS * system.expected), 1))
        end = first
        while end < last and not stopped():
            begin = end
            end = min(begin + step, last)
            routine(
                begin, end, room.header, system.constants, system.rows.data, int(system.rows.data.shape[1]),
                system.rows.parameters, system.rows.weights, system.rows.index, system.rows.columns,
                table, rules.levels, units_at, known, begun, work, desk, bench, places, *answers,
            )  # fmt: skip

    cut = False
    if count == 1 and stopped is not never:
        cut = _by_and_by(system, code, replace(room, table=table), (rules.levels, known, begun), answers, stopped)
    else:
        _shared(part, count, workers)
    return ConsensusEnds(
        points=points,
        states=states,
        inside=inside == 1,
        limits=limits,
        variances=variances,
        cut_short=cut,
    )


def _shared(work: Callable[[int, int], None], count: int, workers: int) -> None:
    """``work(first, last)`` for all of ``count``, shared by so many threads."""
    if workers <= 1 or count < 2:
        work(0, count)
        return
    from concurrent.futures import ThreadPoolExecutor  # loads what logs; one data set needs no threads

    cuts = np.linspace(0, count, min(workers, count) + 1).astype(int).tolist()
    with ThreadPoolExecutor(len(cuts) - 1) as pool:
        list(pool.map(work, cuts[:-1], cuts[1:]))


def _by_and_by(
    system: NativeSystem,
    code: SolverCode,
    room: Room,
    given: tuple[Floats, ...],
    answers: tuple[NDArray[Any], ...],
    stopped: Callable[[], bool],
) -> bool:
    """The one data set of a system, in portions of trials; the answers are those of all trials at once.

    ``given`` are the levels of units, what closed forms know of them, and the starts. Whether it was interrupted.
    """
    routine = code.routine("agree_by_and_by", int, int, int, *[object] * 20)
    scratch = (np.zeros(room.work), np.zeros(room.work), np.zeros(room.bench), np.zeros(room.places, dtype=np.int64))
    progress = scratch[3][int(c.progress_at(room.header, room.table)) :]
    rows, most = system.rows, int(max(AT_A_TIME / system.expected, 1))
    levels, known, begun = given

    def portion(trials: int, begin: int, end: int) -> None:
        routine(
            trials, begin, end, room.header, system.constants, rows.data, rows.parameters, rows.weights, rows.index,
            rows.columns, room.table, levels, known, begun, *scratch, *answers,
        )  # fmt: skip

    portion(most, 1, 0)
    while progress[c.TRIALS_MADE] < progress[c.TRIALS_WANTED] and not stopped():
        portion(most, 0, 0)
    cut_short = bool(progress[c.TRIALS_MADE] < progress[c.TRIALS_WANTED])
    portion(0, 0, 1)
    return cut_short
