"""Constrained minima by kernels that the solver calls: its own penalties and steps along the surface."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from mbm.problem.types import ConstraintMethod
from mbm.solution.assembly import Assembled
from mbm.solution.constrained.answer import constraint_state
from mbm.solution.constrained.linearise import linearise
from mbm.solution.native.minimum import Stopped, linearised_ends, minimum_at
from mbm.solution.native.system import NativeEnds, NativeSystem, system_of
from mbm.solution.settings import Settings
from mbm.solution.types import Equations, Floats, Minimum
from mbm.target.solver import description as of


def kernel_constrained_minimum(
    equations: Equations, start: Floats, settings: Settings, stopped: Stopped | None = None
) -> Minimum | None:
    """The minimum on the surface of constraints by penalties; None: not by kernels, or not sure."""
    if not isinstance(equations, Assembled):
        return None
    straight = equations if equations.implicit is None else equations.straightened()
    system = None if straight is None else _with_penalties(straight, settings)
    if system is None:
        return None
    ends = system.one(start, stopped=stopped)
    return _on_surface(equations, ends, 0)


def kernel_constrained_minima(equations: Assembled, starts: Floats, settings: Settings) -> Iterator[Minimum | None]:
    """The same for many starts (T, N) in one call; the ends do not depend on the number of threads."""
    system = _with_penalties(equations, settings) if len(starts) else None
    if system is None:
        yield from (None for _ in starts)
        return
    for k, ends, at in linearised_ends(equations, system, starts, settings):
        yield None if at is None else _on_surface(equations, ends, k, at)


def _with_penalties(equations: Assembled, settings: Settings) -> NativeSystem | None:
    """The equations with their constraints as penalties; None: another method takes them."""
    if settings.constraints is not ConstraintMethod.PENALTY:
        return None
    return system_of(equations, settings) if settings.iterative else None


def _on_surface(
    equations: Assembled, ends: NativeEnds, k: int, linearised: tuple[Floats, Floats] | None = None
) -> Minimum | None:
    """The end of solve ``k`` with its constraints; None where they do not all hold, or the rank is not full."""
    if ends.states[k, of.REASON] != of.RUNNING and not ends.clean[k]:
        return None
    found = minimum_at(equations, ends, k, linearised, sure=equations.implicit is None)
    if found is None:
        return None
    place = linearise(equations, found.point)
    state = constraint_state(equations.equality, place, ends.multipliers[k, : len(place.values)])
    return None if bool(state.violated.any()) else replace(found, constraints=state)
