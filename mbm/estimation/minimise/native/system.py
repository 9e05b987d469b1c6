"""Equations in native code: what of them can be handed over, solved from many points in one call."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.types import Floats, Indices
from mbm.estimation.minimise.native.iteration import iteration_of
from mbm.estimation.minimise.native.packing import (
    ROWS_AT_A_TIME,
    Rows,
    rows_of,
    structure_of,
    system_arrays,
)
from mbm.estimation.minimise.native.range_maps import hand
from mbm.estimation.minimise.native.suited import alike, handled, sum_addresses, summable
from mbm.estimation.native.code import AnyCode, Described, NativeCode, native_code, share
from mbm.estimation.settings import Settings
from mbm.machine.records import address, inside, put, slot, view
from mbm.solver import description as of, workspace as workspace
from mbm.solver.range_maps import RangeMaps
from mbm.solver.workspace import Answer, RangeForm, Solves, Work, work_integers, work_reals
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.estimation.native.callbacks import CallbackKernels
    from mbm.kernels.native.kernels import NativeKernels

AT_A_TIME = 2e8
"""Products in one call, about a tenth of a second: between calls the user may interrupt."""

ROWS_IN_PYTHON = 8192
"""Residuals that go through kernels in Python at a time: a call takes as long as a thousand of them."""

MANY_ROWS, MANY_ROWS_OFTEN = 500, 32
"""Rows of a group from which its normal equations are summed: that takes time to compile; streams have fewer."""

ITERATIONS_OF_MANY = 20.0
"""Iterations that a solve of many takes, as a guess."""
MOST_ITERATIONS = 100.0
"""Iterations that hardly a solve exceeds: where one call has not room for them, solves are made in several."""

_GIVEN = ("constants", "parameters", "whitening", "index", "columns")
"""What `Rows` has of a system."""


def never() -> bool:
    """Nobody interrupts."""
    return False


def nothing() -> None:
    """Nothing failed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NativeEnds:
    """Where T solves ended, as `mbm.solver.description` says."""

    numbers: Floats
    results: Floats
    states: Indices
    sides: Indices
    triangles: Floats
    covariances: Floats
    multipliers: Floats

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All of it, by the names that the solver has for it."""
        first = {"numbers": self.numbers, "results": self.results, "states": self.states, "sides": self.sides}
        last = {"triangle": self.triangles, "covariance": self.covariances, "multipliers": self.multipliers}
        return {**first, **last}

    @property
    def clean(self) -> NDArray[np.bool_]:
        """Which solves (T,) ended in a minimum of full rank."""
        reasons = self.states[:, of.REASON]
        good = (reasons >= of.SMALL_OFFSET) & (reasons <= of.ONE_STEP)
        return np.asarray(good & (self.states[:, of.DEFICIENT] == 0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NativeSystem:
    """A system with its rows, ready to be solved.

    ``code`` and ``held`` keep machine code alive; ``failed`` raises what ended an evaluation in Python, if one did.
    """

    system: Indices
    constants: Floats
    rows: Rows
    code: AnyCode
    held: object = field(repr=False)
    failed: Callable[[], None] = field(default=nothing, repr=False)
    ranges: RangeMaps | None = field(default=None, repr=False)
    """What starts are compared with; None: nothing."""
    _given: tuple[int, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        # Where they begin; asking for that takes longer than a small solve.
        object.__setattr__(self, "_given", tuple(address(array) for array in self._arrays))

    @property
    def _arrays(self) -> tuple[NDArray[Any], ...]:
        """What `Rows` has of a system, by the names of `_GIVEN`."""
        rows = self.rows
        return self.constants, rows.parameters, rows.weights, rows.index, rows.columns

    @property
    def dimension(self) -> int:
        """Free coordinates n."""
        return int(self.system[of.Problem.n])

    def solve(
        self,
        points: Floats,
        which: Indices | None = None,
        *,
        workers: int = 1,
        stopped: Callable[[], bool] = never,
    ) -> NativeEnds:
        """Solve from each of ``points`` (T, N), with the data set ``which`` (T,) (None: the first).

        The answers do not depend on ``workers``, the number of threads. ``stopped`` is asked now and then; solves that
        were not made then, or not to their end, have the reason `RUNNING`.
        """
        count = len(points)
        ends = self.blank(count)
        chosen = np.zeros(count, dtype=np.int64) if which is None else np.ascontiguousarray(which, dtype=np.int64)
        starts = np.ascontiguousarray(points, dtype=np.float64)
        at_a_time = AT_A_TIME / self._products
        self.code.expect(count * self.expected)

        def part(first: int, last: int) -> None:
            work = self.scratch()
            if at_a_time < MOST_ITERATIONS:
                most = int(max(at_a_time, 1))
                for k in range(first, last):
                    if not stopped():
                        answer = {name: array[k : k + 1] for name, array in ends.arrays().items()}
                        self._alone(starts[k], int(chosen[k]), answer, work, most, stopped)
                return
            step = int(max(at_a_time / ITERATIONS_OF_MANY, 1))
            routine = self.code.routine("solve_many", object)
            solves, *_held = self.solves(chosen, starts, ends, work[0])
            for k in range(first, last, step):
                if stopped():
                    return
                put(solves, Solves, first=k, last=min(k + step, last))
                routine(solves)

        share(part, count, workers)
        self.failed()
        return ends

    @property
    def expected(self) -> float:
        """Products of one solve, as a guess."""
        return ITERATIONS_OF_MANY * self._products

    @property
    def _products(self) -> float:
        """Products in one iteration, about: however few the rows are, the damped triangle has as many as unknowns."""
        return float(max(self.system[of.Problem.most_residuals], self.dimension)) * (self.dimension + 4) ** 2

    def blank(self, count: int) -> NativeEnds:
        """Room for the answers of so many solves."""
        n = self.dimension
        return NativeEnds(
            numbers=np.zeros((count, int(self.system[of.Problem.numbers]))),
            results=np.zeros((count, of.RESULTS)),
            states=np.zeros((count, of.STATES), dtype=np.int64),
            sides=np.zeros((count, n), dtype=np.int64),
            triangles=np.zeros((count, n + 1, n + 1)),
            covariances=np.zeros((count, n, n)),
            multipliers=np.zeros((count, int(self.system[of.Problem.most_multipliers]))),
        )

    def hand(self, rows: Any) -> None:
        """Let `Rows` have what belongs to the system."""
        if isinstance(rows, np.ndarray):
            for name, begin in zip(_GIVEN, self._given, strict=True):
                rows[slot(workspace.Rows, name)] = begin
        else:
            put(rows, workspace.Rows, **dict(zip(_GIVEN, self._arrays, strict=True)))

    def scratch(self, parameters: Floats | None = None) -> tuple[Any, ...]:
        """What one thread needs beside, as `Work`, and the arrays that it refers to; with other ``parameters``."""
        count, whole = scratch_sizes(self.system[: of.HEADER].tobytes())
        reals, integers = np.empty(count), np.empty(whole, dtype=np.int64)
        work = self.code.blank(Work)
        put(work, Work, reals=reals, integers=integers)
        self.hand(inside(work, Work, "rows"))
        if parameters is not None:
            put(inside(work, Work, "rows"), workspace.Rows, parameters=parameters)
        return work, reals, integers

    def solves(self, which: Indices, starts: Floats, ends: NativeEnds, work: Any) -> tuple[Any, ...]:
        """A batch as `Solves`, with the scratch of one thread, and the arrays that it refers to beside those given."""
        found = self.code.blank(Solves)
        put(found, Solves, problem=self.system, work=work, data=self.rows.data, which=which, starts=starts)
        put(inside(found, Solves, "answers"), Answer, **ends.arrays())
        return found, *self.compare(found)

    def compare(self, solves: Any) -> tuple[NDArray[Any], ...]:
        """Let `Solves` have scratch of its own for what starts are compared with; the arrays that it refers to."""
        if self.ranges is None:
            return ()
        return hand(self.ranges, inside(solves, Solves, "form"), int(self.system[of.Problem.numbers]), self._most_rows)

    @property
    def _most_rows(self) -> int:
        """Rows of all blocks that a data set has at most."""
        return int(self.rows.data[:, of.DATA_HEAD + of.DataBlock.rows :: of.DATA_BLOCK].max(axis=0).sum())

    def one(
        self,
        start: Floats,
        *,
        which: int = 0,
        stopped: Callable[[], bool] | None = None,
        end: str = "finish_solve",
        ranges: RangeMaps | None = None,
    ) -> NativeEnds:
        """Solve from one start (N,); ``stopped`` is asked before each iteration: what is reached comes back.

        ``end`` is the routine that answers; `set_end` leaves out what is known about the answer there. It has been
        ``COMPARED`` where ``ranges`` give places, none of which may lead elsewhere.
        """
        ends = self.blank(1)
        work, begun = self.scratch(), np.ascontiguousarray(start, dtype=np.float64)
        most = 1 if stopped is not None else int(max(AT_A_TIME / self._products, 1))
        self.code.expect(self.expected)
        self._alone(begun, which, ends.arrays(), work, most, stopped or never, end)
        if ranges is not None:
            form = self.code.blank(RangeForm)
            _held = hand(ranges, form, ends.numbers.shape[1], self._most_rows)
            promises = self.code.routine("place_promises", object, object, object, object)
            ends.states[0, of.COMPARED] = promises(self.system, begun, form, work[0]) == 0
        self.failed()
        return ends

    def _alone(
        self,
        start: Floats,
        which: int,
        answer: Mapping[str, NDArray[Any]],
        scratch: tuple[Any, ...],
        most: int,
        stopped: Callable[[], bool],
        end: str = "finish_solve",
    ) -> None:
        """One solve, ``most`` iterations at a time; ``answer`` are the arrays that the routine ``end`` puts it to."""
        begin = self.code.routine("start_solve", object, object, int, object, object)
        go_on = self.code.routine("go_on", object, int, object)
        work = scratch[0]
        put(inside(work, Work, "answer"), Answer, **answer)
        begin(self.system, self.rows.data[which], 0, start, work)
        done = go_on(self.system, 0, work)
        while not done and not stopped():
            done = go_on(self.system, most, work)
        self.code.routine(end, object, object)(self.system, work)


@lru_cache(maxsize=256)
def scratch_sizes(header: bytes) -> tuple[int, int]:
    """Reals and integers that a thread needs, by the header of a description; adding them up takes longer than a small
    solve.
    """
    problem = view(of.Problem, np.frombuffer(header, dtype=np.int64))
    return int(work_reals(problem)), int(work_integers(problem))


def system_of(
    equations: Assembled,
    settings: Settings,
    *,
    direct: bool | None = None,
    strict: bool = True,
    most_rows: Sequence[int] | None = None,
    often: bool = False,
    kept: bool = True,
) -> NativeSystem | None:
    """The equations of one data set for the native solver; None: they are not for it.

    ``direct``: the one step of affine equations (None: where they are affine and nothing else is asked for).
    ``strict``: solves end at once where their Jacobian is not of full rank; else they go on, for the best they can get.
    ``most_rows`` of each group, where data sets of some of the rows are to be solved (None: all of them are one).
    ``often``: so many solves are to come that it is worth compiling a function for the rows of small groups together,
    and to sum the normal equations of others from fewer rows on.
    ``kept``: the description is looked up, and kept for equations of the same structure.
    """
    asked = settings, direct, strict
    latest = native_code(equations.groups[0].cache).latest if equations.groups and kept and not often else None
    if isinstance(latest, _Latest) and latest.asked == asked and most_rows is None and alike(latest.of, equations):
        return latest.system(rows_of(equations))
    groups = (*equations.groups, *equations.constraints) if handled(equations) else ()
    if not groups:
        return None
    code = native_code(groups[0].cache)
    kernels = kernels_of(code, groups, compiled=equations.machine_code is not None, often=often)
    guard = getattr(kernels, "guard", None)
    iteration = iteration_of(equations, settings, direct=direct, strict=strict)
    rows = [g.rows for g in groups] if most_rows is None else list(most_rows)
    together: tuple[int, ...] = ()
    own: tuple[object, ...] = ()
    if often and guard is None:
        # Loaded by streams only, so that one solve begins at once.
        from mbm.estimation.minimise.native.fusing import fused_rows, places_of, unitable

        together = unitable(groups, rows)
        own = (together, places_of(groups, together))
    key = (structure_of(equations), iteration, own) if kept else None
    known = code.systems.get(key)
    if known is None or any(a > b for a, b in zip(rows, known.rows, strict=True)):
        room = rows if known is None else [max(a, b) for a, b in zip(rows, known.rows, strict=True)]
        least = MANY_ROWS_OFTEN if often else MANY_ROWS
        many = [g if guard is None and r >= least and summable(g) else None for g, r in zip(groups, room, strict=True)]
        sums = sum_addresses(code, many)
        addresses = [(kernels.values_address(k), kernels.jacobian_address(k), sums[k]) for k in range(len(groups))]
        fused = fused_rows(equations, together, code.store) if any(together) else None
        system, constants = system_arrays(
            equations,
            addresses,
            iteration,
            most_rows=room,
            at_a_time=ROWS_AT_A_TIME if guard is None else ROWS_IN_PYTHON,
            summed_from=least,
            fused=fused,
        )
        known = Described(rows=tuple(room), system=system, constants=constants, fused=fused)
        if kept:
            code.systems[key] = known
    held, failed = (kernels, known, code), nothing if guard is None else guard.raise_failure
    made = _Latest(of=equations, asked=asked, known=known, code=code.solver, held=held, failed=failed)
    if kept and not often and most_rows is None:
        code.latest = made
    return made.system(rows_of(equations))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Latest:
    """What a system was made of, for the next equations that differ ``of`` these in their data alone."""

    of: Assembled
    asked: tuple[object, ...]
    known: Described
    code: AnyCode
    held: object
    failed: Callable[[], None]

    def system(self, rows: Rows) -> NativeSystem:
        """The system with the rows of a data set."""
        return NativeSystem(
            system=self.known.system,
            constants=self.known.constants,
            rows=rows,
            code=self.code,
            held=self.held,
            failed=self.failed,
        )


def kernels_of(
    code: NativeCode, groups: Sequence[Group], *, compiled: bool, often: bool = False
) -> NativeKernels | CallbackKernels:
    """The kernels of groups, as machine code where that is wanted; ``often`` as `KernelCode.of` takes it."""
    kernels = [g.kernel for g in groups]
    if compiled:
        return code.kernels(kernels, max((g.rows for g in groups), default=0), often=often)
    return code.callbacks([g.number for g in groups], kernels, [g.cache.stream(g.number, g.kernel) for g in groups])
