"""Consensus of many data sets in native code: which units agree in each, and where."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.consensus.rules import Rules
from mbm.estimation.minimise.native.packing import blocks_of
from mbm.estimation.minimise.native.system import AT_A_TIME, NativeSystem, never
from mbm.estimation.native.code import AnyCode, share
from mbm.machine.kinds import LANES
from mbm.machine.records import inside as inside_of, put, view
from mbm.solver import consensus_records as c, description as of
from mbm.values import dataclass

TRIALS = 10
"""The work of a consensus in units of solves with all rows, as a guess."""

SHAPES = 100
"""Rooms that are remembered."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConsensusEnds:
    """What D data sets agree on; their units stand one after the other.

    ``points`` (D, N) is where the units agree, the first start where they do not; ``states`` (D, `Verdict`). For each
    unit ``inside`` says whether it agrees, with squared norms up to ``limits``; ``variances`` are those of the noise,
    and ``information`` is what inliers inform by where there is an answer (`inform_units`).
    ``cut_short``: the one data set there is was interrupted.
    """

    points: Floats
    states: Indices
    inside: Mask
    limits: Floats
    variances: Floats
    information: Floats
    cut_short: bool = False

    @property
    def agreed(self) -> Mask:
        """Where there is an answer (D,); elsewhere another method should take over."""
        return np.asarray(self.states[:, c.Verdict.agreed] == 1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Begun:
    """Where D data sets begin: ``starts`` (D, S, N), all finite but for what the closed form gives.

    ``forms`` (units of all data sets, width) is what a closed form knows of each unit (None: nothing). ``startless``:
    it gives the starts, and those here hold the other numbers. ``near``: the starts are what some of the units agree
    with already. ``units_at`` (D + 1,) is where the units of each data set begin, and the end of the last ones (None:
    no unit is left out by its weight).
    """

    starts: Floats
    forms: Floats | None = None
    startless: bool = False
    near: bool = False
    units_at: Indices | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Room:
    """A system's header and the table of rules with room for some numbers of rows, and what scratch they ask for.

    ``reals`` and ``integers`` are numbers of them. ``held`` is what all that follows from.
    """

    header: Indices
    table: Indices
    reals: int
    integers: int
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
    first = of.DATA_HEAD + of.DataBlock.rows
    return np.asarray(
        system.rows.data[
            :, first : first + of.DATA_BLOCK * int(system.system[of.Problem.residual_blocks]) : of.DATA_BLOCK
        ]
    )


def units_of_rows(system: NativeSystem, rules: Rules) -> Indices:
    """The units of a row of each block (blocks,), 0 where no rule acts."""
    units = blocks_of(system.system)[: len(rules.ruled), of.Block.unit_count]
    return np.asarray(units * np.array(rules.ruled))


def units_at_of(system: NativeSystem, rules: Rules) -> Indices:
    """Where the units of each data set begin, and the end of the last ones (D + 1,)."""
    counts = (rows_of_blocks(system) * units_of_rows(system, rules)).sum(axis=1)
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _room(system: NativeSystem, rules: Rules, most: list[int]) -> Room:
    header, table = side_by_side(system.system), rules.rules.copy()
    room = 0
    for b, (ruled, rows) in enumerate(zip(rules.ruled, most, strict=True)):
        block = blocks_of(header)[b]
        widths = (of.Block.parameters, of.Block.weights, of.Block.variables, of.Block.tangents)
        room += ((int(header[of.Problem.n]) if ruled else rows) + 1) * max(int(block[width]) for width in widths)
    units = int((units_of_rows(system, rules) * most).sum())
    put(table, c.Rules, most_units=max(units, 1), most_rows=room + 1)
    asked = view(c.Rules, table)
    c.take_sizes(view(of.Problem, header), asked)
    return Room(
        header=header,
        table=table,
        reals=int(c.consensus_reals(asked)),
        integers=int(c.consensus_integers(asked)),
        held=(system.system, rules),
    )


def side_by_side(system: Indices) -> Indices:
    """The ``system`` array with room for all rows in one chunk, as consensus takes them."""
    found = system.copy()
    found[of.Problem.chunk] = -(-int(found[of.Problem.most_residuals]) // LANES) * LANES
    blocks = blocks_of(found)
    wide = blocks[:, of.Block.outputs] + blocks[:, of.Block.nonzero_count]
    found[of.Problem.most_outputs] = int(
        (wide * (found[of.Problem.chunk] // np.maximum(blocks[:, of.Block.outputs], 1) + LANES)).max()
    )
    return found


def consensus_many(
    system: NativeSystem,
    code: AnyCode,
    rules: Rules,
    begun: Begun,
    *,
    workers: int = 1,
    rooms: Rooms | None = None,
    stopped: Callable[[], bool] = never,
) -> ConsensusEnds:
    """The units that agree in each data set of a system.

    Args:
        system: the equations and their data sets.
        code: the compiled consensus.
        rules: what is asked for.
        begun: where they begin.
        workers: threads; the answers do not depend on it.
        rooms: those made for such data sets before.
        stopped: asked now and then; data sets that were not looked at by then do not agree. Of a single one, the best
            of the trials that were made by then is the answer.
    """
    count = len(system.rows.data)
    units_at = units_at_of(system, rules) if begun.units_at is None else begun.units_at
    total, numbers = int(units_at[-1]), int(system.system[of.Problem.numbers])
    known = np.zeros(1) if begun.forms is None else np.ascontiguousarray(begun.forms, dtype=np.float64)
    starts = np.ascontiguousarray(begun.starts, dtype=np.float64)
    room = (rooms or Rooms()).of(system, rules)
    room = replace(room, table=room.table.copy())
    put(room.table, c.Rules, startless=int(begun.startless), near=int(begun.near))
    points, states = np.zeros((count, numbers)), np.zeros((count, c.ANSWERS), dtype=np.int64)
    inside, (limits, variances, information) = np.zeros(total, dtype=np.int64), np.zeros((3, total))
    code.expect(count * TRIALS * system.expected)
    every = code.blank(c.ConsensusBatch)
    rows = system.rows
    put(every, c.ConsensusBatch, problem=room.header, data=rows.data, stride=int(rows.data.shape[1]), units_at=units_at)
    put(every, c.ConsensusBatch, forms=known, starts=starts, numbers=points, verdicts=states)
    put(every, c.ConsensusBatch, inlier=inside, limits=limits, noise=variances, information=information)

    def part(first: int, last: int) -> None:
        mine, *_held = _ready(code, system, room, rules, every)
        routine = code.routine("consensus_many", object)
        step = int(max(AT_A_TIME / (TRIALS * system.expected), 1))
        end = first
        while end < last and not stopped():
            begin = end
            end = min(begin + step, last)
            put(mine, c.ConsensusBatch, first=begin, last=end)
            routine(mine)

    cut = False
    if count == 1 and stopped is not never:
        most = int(max(AT_A_TIME / system.expected, 1))
        cut = _by_and_by(code, _ready(code, system, room, rules, every), most, stopped)
    else:
        share(part, count, workers)
    system.failed()
    return ConsensusEnds(
        points=points,
        states=states,
        inside=inside == 1,
        limits=limits,
        variances=variances,
        information=information,
        cut_short=cut,
    )


def _ready(code: AnyCode, system: NativeSystem, room: Room, rules: Rules, every: Any) -> tuple[Any, ...]:
    """A batch with the scratch of one thread, and what they refer to."""
    mine, work = copy(every), code.blank(c.ConsensusWork)
    reals, integers = np.zeros(room.reals), np.zeros(room.integers, dtype=np.int64)
    put(work, c.ConsensusWork, rules=room.table, levels=rules.levels, reals=reals, integers=integers)
    system.hand(inside_of(work, c.ConsensusWork, "rows"))
    put(mine, c.ConsensusBatch, work=work)
    return mine, work, reals, integers


def _by_and_by(code: AnyCode, ready: tuple[Any, ...], most: int, stopped: Callable[[], bool]) -> bool:
    """The one data set of a system, in portions of ``most`` trials; the answers are those of all trials at once.

    Whether it was interrupted.
    """
    routine = code.routine("consensus_in_portions", int, int, int, object)
    left = routine(most, 1, 0, ready[0])
    while left > 0 and not stopped():
        left = routine(most, 0, 0, ready[0])
    routine(0, 0, 1, ready[0])
    return left > 0
