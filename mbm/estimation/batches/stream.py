"""A native system whose measured values change from data set to data set while everything else stays."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import field, replace
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices
from mbm.estimation.batches.stream_ends import NO_CODE, Rules, StreamEnds
from mbm.estimation.minimise.native.system import NativeEnds, NativeSystem, system_of
from mbm.estimation.minimise.sparsity import sparse_suits
from mbm.estimation.native.code import Routine, SolverCode, share
from mbm.estimation.search.challenge import kind_of
from mbm.estimation.search.starting import partly_foreknown
from mbm.estimation.settings import Settings
from mbm.machine.records import put
from mbm.problem.types import Problem, UnknownKind
from mbm.solver import description as of
from mbm.solver.decisions import usual_cost
from mbm.solver.range_maps import RangeMaps
from mbm.solver.workspace import Solves
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.estimation.batches.rival_starts import Rivals
    from mbm.estimation.batches.robust_stream import RobustStream
    from mbm.estimation.batches.stations import Stations

SHARE = 100
"""Solves of a thread at least: to start one takes as long as some twenty."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Room:
    """Arrays for so many data sets; ``solves`` is the batch as the solver takes it."""

    parameters: Floats
    system: NativeSystem
    ends: NativeEnds
    solves: Indices
    held: tuple[np.ndarray, ...] = field(repr=False)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beside:
    """Ranges that the solver compares starts with, unless the ``stations`` tell that nothing fits better."""

    ranges: RangeMaps
    stations: Stations

    def asked(self, found: StreamEnds) -> Indices:
        """The data sets (K,) to be solved again beside the ranges."""
        asked = found.clean.copy()
        if asked.any():
            asked &= ~self.stations.sure(found.numbers, found.cost, found.covariance)
        return np.flatnonzero(asked | found.strained)


class Stream:
    """Data sets of one shape, solved from one start. Local to one thread: its arrays are used again for each call.

    Where a closed form costs less than what the start leads to, its minimum is the answer: of ``rivals``, or of ranges
    that the ``system`` compares starts with.
    """

    def __init__(
        self, system: NativeSystem, start: Floats, rules: Rules, rivals: Rivals | Beside | None = None
    ) -> None:
        self._system = system
        self._start = start
        self._rules = rules
        self._rivals = rivals
        self.usual = rules.usual
        """The cost that a fit as stated noise lets expect stays below."""
        self._function: Callable[[int], int] | None = None
        self._room = self._single = self._made(1)
        self._first = self._single.solves.ctypes.data
        self.single: Floats = self._single.parameters[0]
        """The parameters (P,) that `solved_one` takes, to be changed in place."""
        self._covariance = self._single.ends.covariances[0]
        self._numbers = self._single.ends.numbers[0]
        self._states = self._single.ends.states[0]
        self._sides = self._single.ends.sides[0]
        self._nowhere = bytes(self._sides.nbytes)

    def parameters(self, count: int) -> Floats:
        """The parameters (count, P) of so many data sets, to be changed in place before ``solved``.

        P numbers: those of the groups one after the other, each row by row. What is never changed stays as compiled.
        """
        if len(self._room.parameters) < count:
            self._room = self._made(count)
        return self._room.parameters[:count]

    def solved(self, count: int, workers: int = 1) -> StreamEnds:
        """The solves of the first ``count`` data sets, by so many threads; their number changes nothing."""
        room = self._room
        function = self._function or self._code(count)

        def part(first: int, last: int) -> None:
            solves, scratch = room.solves.copy(), room.system.scratch()
            _held = room.system.compare(solves)
            put(solves, Solves, work=scratch[0], first=first, last=last)
            function(solves.ctypes.data)

        share(part, count, workers)
        self._system.failed()
        return self._compared(room, count, workers)

    def _compared(self, room: _Room, count: int, workers: int) -> StreamEnds:
        """The ends of a room, or what the closed form leads to where that costs less."""
        found = self._rules.judged(room.ends, count)
        if self._rivals is None:
            return found
        if isinstance(self._rivals, Beside):
            which = self._rivals.asked(found)
            if len(which):
                system = replace(room.system, ranges=self._rivals.ranges)
                ends = system.solve(np.tile(self._start, (len(which), 1)), which, workers=workers)
                found.put(which, self._rules.judged(ends, len(which)))
            return found
        which, points = self._rivals.lower(found, room.parameters[:count], room.system)
        if not len(which):
            return found
        others = self._rules.judged(room.system.solve(points, which, workers=workers), len(which))
        return found.beaten(which, others, self._rules.roundings(room.ends, which))

    def solved_one(self) -> tuple[Floats, Floats, float] | None:
        """Numbers, covariance and cost of the data set whose parameters are `single`; None where it is not clean."""
        rules = self._rules
        (self._function or self._code(1))(self._first)
        self._system.failed()
        states = self._states.tolist()
        cost = self._single.ends.results.item(of.COST)
        freedom = states[of.FREEDOM]
        held = self._sides.tobytes() != self._nowhere
        if not rules.sound(cost, states[of.REASON], states[of.DEFICIENT], held, freedom):
            return None
        fits = cost < rules.most
        if self._rivals is None and not fits:
            return None
        if self._rivals is not None and not (fits and self._alone(cost)):
            ends = self._compared(self._single, 1, 1)
            return (ends.numbers[0], ends.covariance[0], ends.cost.item()) if ends.clean.item() else None
        covariance = self._covariance.copy()
        if rules.estimated:
            covariance *= cost / max(freedom, 1)
        return rules.shown_one(self._numbers), covariance, cost

    def _alone(self, cost: float) -> bool:
        """Whether nothing costs less than the minimum of `single`, as its stations tell."""
        rivals = self._rivals
        return isinstance(rivals, Beside) and rivals.stations.sure_one(self._numbers, cost, self._covariance)

    def _code(self, count: int) -> Callable[[int], int]:
        """The solver for so many data sets; it stays when there is none that is faster."""
        code = self._system.code
        code.expect(count * self._system.expected)
        routine = code.routine("solve_many", object)
        found: Callable[[int], int] = routine.function if isinstance(routine, Routine) else routine
        if code.fast:
            self._function = found
        return found

    def _made(self, count: int) -> _Room:
        system, rows = self._system, self._system.rows
        parameters = np.tile(rows.parameters, (count, 1))
        data = np.tile(rows.data, (count, 1))
        firsts = slice(of.DATA_HEAD + of.DataBlock.parameters, None, of.DATA_BLOCK)
        data[:, firsts] += len(rows.parameters) * np.arange(count)[:, None]
        mine = replace(system, rows=replace(rows, parameters=parameters.reshape(-1), data=data))
        ends, scratch = system.blank(count), mine.scratch()
        which, starts = np.arange(count), np.tile(self._start, (count, 1))
        solves, *compared = mine.solves(which, starts, ends, scratch[0])
        put(solves, Solves, first=0, last=1)
        held = (mine.system, data, which, starts, *scratch, *compared)
        return _Room(parameters=parameters, system=mine, ends=ends, solves=solves, held=held)


def threads(workers: int | None, count: int) -> int:
    """Threads for so many solves; ``workers`` None: one a processor."""
    return max(1, min(workers or os.cpu_count() or 1, count // SHARE))


def stream_of(
    problem: Problem, equations: Assembled, settings: Settings, estimates: Floats, changing: Sequence[Indices | slice]
) -> Stream | RobustStream | str:
    """The equations of one data set as a stream; why there is none, where solves need what only the general path has.

    Solves begin at the stated start, or at the ``estimates`` (N,) for this data set where none is stated.
    ``changing`` are the places of the parameters that data sets change.
    """
    corrected = any(block.errors for block in problem.blocks)
    unsuited = {
        "`:method` names a way of its own": settings.routine is not None or not settings.iterative,
        "the equations are large and sparse": sparse_suits(equations),
        "a robust loss is looked at from several sides": equations.lossy,
        "rows share noise": equations.structure is not None,
        "the information of a likelihood is no square of its residuals": equations.likely,
        "trusted rows, and those kept, are looked at by more than one fit": settings.robust is not None
        and settings.robust.literal,
        "consensus beside `:errors` takes several passes": corrected and settings.robust is not None,
        "several noises are unknown": settings.robust is None and problem.estimates_noise and len(problem.blocks) > 1,
    }
    for why, holds in unsuited.items():
        if holds:
            return why
    layout = equations.layout
    places = layout.number[equations.free]
    given = not bool((np.isnan(layout.start) | layout.guessed).any())
    if settings.robust is not None:
        from mbm.estimation.batches.robust_stream import robust_stream_of

        rules = Rules(most=np.inf, estimated=False, angles=_angles(equations), places=places)
        return robust_stream_of(problem, equations, settings, rules, given=given)
    system = system_of(equations, settings, often=True)
    if system is None or not isinstance(system.code, SolverCode):
        return NO_CODE
    system.system[of.Problem.scaled] = problem.estimates_noise
    known = equations.groups[0].cache.without_closed_form
    # what was learnt of closed forms is not relied on where stated noise tells a bad fit
    unchallenged = bool(equations.constraints) or (kind_of(equations) in known and problem.estimates_noise)
    alone = not corrected and (equations.linear or (given and unchallenged))
    if not alone and problem.estimates_noise:
        return "a fit of unknown noise does not show that a better one is elsewhere: state a start, or the noise"
    usual = np.inf if problem.estimates_noise else usual_cost(equations.count - equations.dimension)
    rules = Rules(
        most=np.inf if alone else usual,
        usual=usual,
        estimated=problem.estimates_noise,
        angles=_angles(equations),
        places=places,
    )
    start = layout.start if given else estimates
    if alone:
        return Stream(system, start, rules)
    # Loaded by streams that start anywhere only.
    from mbm.estimation.batches.rival_starts import Rivals, form_of_stream, without_a_step
    from mbm.estimation.batches.stations import stations_of

    form = form_of_stream(equations, settings)
    costs = None if form is None else without_a_step(form, settings)
    if form is None or costs is None:
        return Stream(system, start, rules)
    if partly_foreknown(equations):
        return "priors that speak of some unknowns only give one more place to compare a start with"
    ranges = form.ranges(stated=not problem.estimates_noise)
    if ranges is None:
        return Stream(system, start, rules, Rivals(form=form, costs=costs))
    stations = stations_of(form, costs, changing)
    if stations is None:
        return Stream(replace(system, ranges=ranges), start, rules)
    return Stream(system, start, rules, Beside(ranges=ranges, stations=stations))


def _angles(equations: Assembled) -> tuple[int, ...]:
    """The numbers that are angles."""
    turning = (entry for entry in equations.layout.entries if entry.unknown.kind is UnknownKind.ANGLE)
    return tuple(number for entry in turning for number in range(entry.offset, entry.offset + entry.count))
