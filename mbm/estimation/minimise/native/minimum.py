"""Minima by the native solver, as every solver answers: one, or those of many starts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.metric import first_bad
from mbm.equations.types import Equations, Floats, Indices, Mask, Minimum, Reason
from mbm.estimation.minimise.native.system import NativeEnds, NativeSystem, system_of
from mbm.estimation.settings import Settings
from mbm.solver import description as of
from mbm.solver.decisions import MEMORY
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.solver.range_maps import RangeMaps


SETTLED = 1e-6
"""Relative offset at which a descent ends: what is left is far below what tells two ends apart."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StartEnds:
    """Where T starts lead to: ``points`` (T, N), ``cost`` (T,) = Σ r², inf where a start has no finite value.

    ``settled`` (T,): a minimum, to the accuracy that was asked for; the others ran out of ``iterations`` (T,) or of
    finite points. ``evaluations`` (T,) of the equations were made on the way.
    """

    points: Floats
    cost: Floats
    settled: Mask
    iterations: Indices
    evaluations: Indices


def joined(parts: Sequence[StartEnds]) -> StartEnds:
    """Starts one after the other; at least one part."""
    return StartEnds(
        points=np.concatenate([p.points for p in parts]),
        cost=np.concatenate([p.cost for p in parts]),
        settled=np.concatenate([p.settled for p in parts]),
        iterations=np.concatenate([p.iterations for p in parts]),
        evaluations=np.concatenate([p.evaluations for p in parts]),
    )


def ends_of_starts(part: Assembled, starts: Floats, iterations: int, settings: Settings) -> StartEnds:
    """Where the starts (T, N) lead to in so many iterations, without regard to constraints.

    ``settings`` give the threads, on whose number the ends do not depend, and stop them where they are. Those that were
    not begun by then have the cost of their starts, as far as one batch of residuals goes, the others inf.
    """
    way, workers = Settings(max_iterations=iterations, tolerance=SETTLED), settings.threads(len(starts))
    system = system_of(part, way, strict=False)
    if system is None:
        # Loaded by such equations only. Python evaluates them, one point after the other.
        from mbm.estimation.minimise.native.function import system_of_function

        system, workers = system_of_function(part, way), 1
    ends = system.solve(starts, workers=workers, stopped=settings.stopped)
    reasons, points, cost = ends.states[:, of.REASON], ends.numbers, ends.results[:, of.COST]
    idle = np.flatnonzero(ends.states[:, of.EVALUATIONS] == 0)
    if idle.size:
        points[idle], cost[idle] = starts[idle], np.inf
        known = idle[: max(1, MEMORY // max(1, part.count * part.dimension))]
        with np.errstate(all="ignore"):
            cost[known] = np.square(part.residuals_at(starts[known])).sum(axis=1)
    finite = np.isfinite(cost) & (reasons != of.NOT_FINITE_AT_START)
    return StartEnds(
        points=points,
        cost=np.where(finite, cost, np.inf),
        settled=finite & (reasons >= of.SMALL_OFFSET) & (reasons <= of.ONE_STEP),
        iterations=ends.states[:, of.STEPS],
        evaluations=ends.states[:, of.EVALUATIONS],
    )


Stopped: TypeAlias = Callable[[], bool]

ENDINGS = {
    of.SMALL_OFFSET: Reason.SMALL_OFFSET,
    of.ROUNDING: Reason.ROUNDING,
    of.EXACT_FIT: Reason.EXACT_FIT,
    of.KINK: Reason.KINK,
    of.ONE_STEP: Reason.ONE_STEP,
    of.RUNNING: Reason.INTERRUPTED,
    of.FLAT: Reason.FLAT,
    of.MAX_ITERATIONS: Reason.MAX_ITERATIONS,
    of.NO_FINITE_STEP: Reason.NO_FINITE_STEP,
    of.INFEASIBLE: Reason.INFEASIBLE,
}

SURE = (of.RUNNING, of.SMALL_OFFSET, of.ROUNDING, of.EXACT_FIT, of.KINK, of.ONE_STEP)
"""Ends that kernels are believed which eliminate corrections row by row."""

SAME, TINY = 1e-9, 1e-9
"""Relative difference of costs up to which corrections that were found in two ways are the same, and the cost below
which only rounding is left."""


def native_minimum(equations: Equations, start: Floats, settings: Settings, stopped: Stopped | None = None) -> Minimum:
    """The minimum that a start (N,) leads to, without regard to constraints.

    ``stopped`` is asked between iterations (None: nobody is).
    """
    found = kernel_minimum(equations, start, settings, stopped)
    return function_minimum(equations, start, settings, stopped) if found is None else found


def kernel_minimum(
    equations: Equations, start: Floats, settings: Settings, stopped: Stopped | None = None
) -> Minimum | None:
    """The same by kernels that the solver calls; None: not for these equations, or it is not sure."""
    system = _by_kernels(equations, settings)
    if system is None:
        return None
    sure = not getattr(equations, "profiled", False)
    return minimum_at(equations, system.one(start, stopped=stopped, end="set_end"), 0, sure=sure)


def compared_minimum(
    equations: Equations, start: Floats, settings: Settings, ranges: RangeMaps, stopped: Stopped | None = None
) -> Minimum | None:
    """The same compared with the places that ``ranges`` give; None also where one of these may lead elsewhere."""
    system = _by_kernels(equations, settings)
    if system is None:
        return None
    ends = system.one(start, stopped=stopped, end="set_end", ranges=ranges)
    return minimum_at(equations, ends, 0, sure=True) if ends.states[0, of.COMPARED] else None


def function_minimum(
    equations: Equations, start: Floats, settings: Settings, stopped: Stopped | None = None
) -> Minimum:
    """The same with equations that are asked for their residuals and their Jacobian.

    Where those have no finite values when they are asked again, nothing else is to be said of the end.
    """
    # Loaded by the problems that need it only, so that the others start at once.
    from mbm.estimation.minimise.native.function import system_of_function

    ends = system_of_function(equations, settings).one(start, stopped=stopped, end="set_end")
    found = minimum_at(equations, ends, 0, sure=True)
    return replace(without_value(equations, ends.numbers[0]), reason=Reason.NO_FINITE_STEP) if found is None else found


def native_minima(equations: Assembled, starts: Floats, settings: Settings) -> Iterator[Minimum | None]:
    """The same for many starts (T, N) in one call; the ends do not depend on the number of threads.

    None: not by kernels, or not sure.
    """
    system = _by_kernels(equations, settings) if len(starts) else None
    if system is None:
        yield from (None for _ in starts)
        return
    for k, ends, at in linearised_ends(equations, system, starts, settings):
        yield None if at is None else minimum_at(equations, ends, k, at, sure=True)


def linearised_ends(
    equations: Assembled, system: NativeSystem, starts: Floats, settings: Settings
) -> Iterator[tuple[int, NativeEnds, tuple[Floats, Floats] | None]]:
    """Where each of many starts (T, N) ends: its number, all ends, residuals and Jacobian there; None: not made."""
    ends = system.solve(starts, workers=settings.threads(len(starts)), stopped=settings.stopped)
    for k, point in enumerate(ends.numbers):
        if ends.states[k, of.EVALUATIONS] > 0:
            with np.errstate(all="ignore"):
                at = equations.linearised(point)
            yield k, ends, at
        else:
            yield k, ends, None


def _by_kernels(equations: Equations, settings: Settings) -> NativeSystem | None:
    """The equations without their constraints, by kernels; None: those are not all that there is to them."""
    if not isinstance(equations, Assembled):
        return None
    straight = equations if equations.implicit is None else equations.straightened()
    if straight is None:
        return None
    free = replace(straight, constraints=()) if straight.constraints else straight
    return system_of(free, settings, strict=False)


def minimum_at(
    equations: Equations,
    ends: NativeEnds,
    k: int,
    linearised: tuple[Floats, Floats] | None = None,
    *,
    sure: bool,
) -> Minimum | None:
    """The end of solve ``k`` as a minimum; ``linearised`` are residuals and Jacobian there, if they are known.

    None where it is not to be believed. Not ``sure``: the kernels eliminate corrections row by row, which may lead to
    other feet than a search.
    """
    code, point = int(ends.states[k, of.REASON]), ends.numbers[k]
    if code == of.NOT_FINITE_AT_START:
        return without_value(equations, point) if sure else None
    if not sure and code not in SURE:
        return None
    with np.errstate(all="ignore"):
        residuals, jacobian = linearised or _linearised(equations, point)
    if not (np.isfinite(residuals).all() and np.isfinite(jacobian).all()):
        return None
    cost = float(residuals @ residuals)
    if not sure and not abs(ends.results[k, of.COST] - cost) <= SAME * max(cost, TINY):
        return None
    return Minimum(
        point=point,
        residuals=residuals,
        jacobian=jacobian,
        cost=cost,
        reason=ENDINGS[code],
        iterations=int(ends.states[k, of.STEPS]),
        evaluations=int(ends.states[k, of.EVALUATIONS]),
        at_bound=ends.sides[k].astype(np.int8),
    )


def _linearised(equations: Equations, point: Floats) -> tuple[Floats, Floats]:
    """Residuals and Jacobian, by one call where the equations have both in one."""
    if isinstance(equations, Assembled):
        return equations.linearised(point)
    return equations.residuals(point), equations.jacobian(point)


@np.errstate(all="ignore")
def without_value(equations: Equations, start: Floats) -> Minimum:
    """A start where something is not finite, with the first row that is not."""
    residuals = equations.residuals(start)
    cost = float(residuals @ residuals)
    row, reason = first_bad(residuals), Reason.NOT_FINITE_AT_START
    if row is None and not np.isfinite(cost):
        row = int(np.argmax(np.abs(residuals)))
    if row is None:
        slopes, reason = equations.jacobian(start), Reason.JACOBIAN_NOT_FINITE_AT_START
        row = first_bad(slopes)
        row = int(np.argmax(np.abs(slopes).max(axis=1, initial=0.0))) if row is None else row
    return Minimum(
        point=start,
        residuals=residuals,
        jacobian=np.zeros((residuals.size, equations.dimension)),
        cost=cost,
        reason=reason,
        iterations=0,
        evaluations=1,
        at_bound=np.zeros(equations.dimension, dtype=np.int8),
        bad_row=row,
    )
