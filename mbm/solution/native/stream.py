"""A native system whose measured values change from data set to data set while everything else stays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from math import sqrt
from typing import Any

import numpy as np

from mbm.problem.types import Method, Problem, UnknownKind
from mbm.solution.assembly import Assembled
from mbm.solution.challenge import USUAL
from mbm.solution.native.system import NativeEnds, NativeSystem, system_of
from mbm.solution.settings import Settings
from mbm.solution.sparsity import sparse_suits
from mbm.solution.types import Floats, Indices, Mask
from mbm.target.solver import description as of
from mbm.target.solver.workspace import work_integers, work_reals
from mbm.values import dataclass

SOLVE = "solve_many"
KINDS = (*[object] * 9, int, int, *[object] * 9)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StreamEnds:
    """Where T solves ended: ``numbers`` (T, N) in SI, angles in (-π, π]; ``covariance`` (T, n, n); ``cost`` (T,).

    ``clean`` (T,): a minimum of full rank, away from all bounds, that fits as stated noise lets expect. Of one solve
    the same without the leading axis.
    """

    numbers: Floats
    covariance: Floats
    cost: Floats | float
    clean: Mask | bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rules:
    """What an end is judged and finished by.

    ``most`` is the largest cost that stated noise lets expect (infinite: nothing is expected), ``estimated`` whether
    one factor of the noise follows from the residuals, ``angles`` the numbers that are angles.
    """

    most: float
    estimated: bool
    angles: Indices

    def clean(self, cost: Any, reason: Any, deficient: Any, held: Any, freedom: Any) -> Any:
        """Whether nothing speaks against an end: numbers of one solve, or arrays of all."""
        good = (reason >= of.SMALL_OFFSET) & (reason <= of.ONE_STEP) & (deficient == 0) & (held == 0)
        good &= cost < self.most
        return good & (freedom > 0) & (cost > 0.0) if self.estimated else good

    def shown(self, numbers: Floats) -> Floats:
        """A copy of numbers (…, N) with angles in (-π, π]."""
        found = numbers.copy()
        if self.angles.size:
            turned = found[..., self.angles]
            found[..., self.angles] = turned - 2 * np.pi * np.ceil(turned / (2 * np.pi) - 0.5)
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Room:
    """Arrays for so many data sets, and their addresses in the order of the arguments."""

    parameters: Floats
    ends: NativeEnds
    before: tuple[int, ...]
    behind: tuple[int, ...]
    held: tuple[np.ndarray, ...] = field(repr=False)


class Stream:
    """Data sets of one shape, solved from one start. Local to one thread: its arrays are used again for each call."""

    def __init__(self, system: NativeSystem, start: Floats, rules: Rules) -> None:
        self._system = system
        self._start = start
        self._rules = rules
        self._function: Callable[..., int] | None = None
        self._room = self._made(1)

    def parameters(self, count: int) -> Floats:
        """The parameters (count, P) of so many data sets, to be changed in place before ``solved``.

        P numbers: those of the groups one after the other, each row by row. What is never changed stays as compiled.
        """
        if len(self._room.parameters) < count:
            self._room = self._made(count)
        return self._room.parameters[:count]

    def solved(self, count: int) -> StreamEnds:
        """The solves of the first ``count`` data sets."""
        room, rules = self._room, self._rules
        (self._function or self._code(count))(*room.before, 0, count, *room.behind)
        states = room.ends.states[:count]
        cost = room.ends.results[:count, of.COST].copy()
        freedom = states[:, of.FREEDOM]
        held = room.ends.sides[:count].any(axis=1)
        clean = rules.clean(cost, states[:, of.REASON], states[:, of.DEFICIENT], held, freedom)
        covariance = room.ends.covariances[:count].copy()
        if rules.estimated:
            covariance *= (cost / np.maximum(freedom, 1))[:, None, None]
        return StreamEnds(
            numbers=rules.shown(room.ends.numbers[:count]), covariance=covariance, cost=cost, clean=np.asarray(clean)
        )

    def solved_one(self) -> StreamEnds:
        """The solve of the first data set: what ``solved(1)`` says, with a tenth of its overhead."""
        room, rules = self._room, self._rules
        (self._function or self._code(1))(*room.before, 0, 1, *room.behind)
        states = room.ends.states[0].tolist()
        cost = room.ends.results.item(0, of.COST)
        freedom = states[of.FREEDOM]
        held = any(room.ends.sides[0].tolist())
        clean = rules.clean(cost, states[of.REASON], states[of.DEFICIENT], held, freedom)
        covariance = room.ends.covariances[0].copy()
        if rules.estimated:
            covariance *= cost / max(freedom, 1)
        return StreamEnds(numbers=rules.shown(room.ends.numbers[0]), covariance=covariance, cost=cost, clean=clean)

    def _code(self, count: int) -> Callable[..., int]:
        """The solver for so many data sets; it stays when there is none that is faster."""
        code = self._system.code
        code.expect(count * self._system.expected)
        found: Callable[..., int] = code.routine(SOLVE, *KINDS).function
        if code.fast:
            self._function = found
        return found

    def _made(self, count: int) -> _Room:
        system, rows = self._system, self._system.rows
        n = system.dimension
        parameters = np.tile(rows.parameters, (count, 1))
        data = np.tile(rows.data, (count, 1))
        firsts = slice(of.DATA_HEAD + of.DATA_PARAMETERS, None, of.DATA_BLOCK)
        data[:, firsts] += len(rows.parameters) * np.arange(count)[:, None]
        ends = NativeEnds(
            numbers=np.zeros((count, int(system.system[of.NUMBERS]))),
            results=np.zeros((count, of.RESULTS)),
            states=np.zeros((count, of.STATES), dtype=np.int64),
            sides=np.zeros((count, n), dtype=np.int64),
            triangles=np.zeros((count, n + 1, n + 1)),
            covariances=np.zeros((count, n, n)),
            multipliers=np.zeros((count, int(system.system[of.MULTIPLIERS]))),
        )
        before = (
            system.system,
            system.constants,
            parameters,
            rows.weights,
            rows.index,
            rows.columns,
            data,
            np.arange(count),
            np.tile(self._start, (count, 1)),
        )
        behind = (
            np.zeros(int(work_reals(system.system))),
            np.zeros(int(work_integers(system.system)), dtype=np.int64),
            ends.numbers,
            ends.results,
            ends.states,
            ends.sides,
            ends.triangles,
            ends.covariances,
            ends.multipliers,
        )
        return _Room(
            parameters=parameters,
            ends=ends,
            before=tuple(array.ctypes.data for array in before),
            behind=tuple(array.ctypes.data for array in behind),
            held=(*before, *behind),
        )


def stream_of(problem: Problem, equations: Assembled, settings: Settings, estimates: Floats) -> Stream | None:
    """The equations of one data set as a stream; None where the general path takes others than native code.

    Solves begin at the stated start, or at the ``estimates`` (N,) for this data set where none is stated.
    """
    if settings.robust is not None or settings.routine is not None or sparse_suits(equations):
        return None
    if settings.method not in (Method.AUTO, Method.MARQUARDT) or equations.lossy:
        return None
    if _estimated(problem) and len(problem.blocks) > 1:
        return None
    system = system_of(equations, settings)
    if system is None:
        return None
    layout = equations.layout
    given = not bool((np.isnan(layout.start) | layout.guessed).any())
    names = tuple(entry.unknown.name for entry in layout.entries)
    kind = (names, tuple(group.rows for group in equations.groups))
    known = equations.groups[0].cache.without_closed_form
    # what was learnt of closed forms is not relied on where stated noise tells a bad fit
    unchallenged = bool(equations.constraints) or (kind in known and _estimated(problem))
    alone = equations.linear or (given and unchallenged)
    if not alone and _estimated(problem):
        return None
    freedom = max(equations.count - equations.dimension, 1)
    angles = [np.arange(e.offset, e.offset + e.count) for e in layout.entries if e.unknown.kind is UnknownKind.ANGLE]
    rules = Rules(
        most=np.inf if alone else freedom + USUAL * sqrt(2.0 * freedom),
        estimated=_estimated(problem),
        angles=np.concatenate([np.zeros(0, dtype=np.int64), *angles]),
    )
    return Stream(system, layout.start if given else estimates, rules)


def _estimated(problem: Problem) -> bool:
    """Whether some noise follows from the residuals."""
    return any(block.unknown_factor for block in problem.blocks)
