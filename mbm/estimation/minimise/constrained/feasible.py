"""A search that ended with violations → a point that meets the constraints, or those that contradict one another."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbm.equations.types import Conflict, Floats
from mbm.estimation.minimise.constrained.conflict import conflict_at
from mbm.estimation.minimise.constrained.linearise import linearise, met
from mbm.estimation.minimise.constrained.types import ConstrainedEquations
from mbm.estimation.minimise.constrained.violation import STILL, Violations, least_violation
from mbm.estimation.settings import Settings

PLACES = 10
"""Points around the start from which a feasible one is searched for before there is said to be none."""


def feasible_point(
    equations: ConstrainedEquations, here: Floats, start: Floats, settings: Settings
) -> tuple[Floats, Conflict | None]:
    """A point that meets the constraints; or the point of least violation, with what contradicts there."""
    least, fewest, unit_there = None, np.inf, np.zeros(0)
    for point in _places(equations, here, start, settings.seed):
        unit = linearise(equations, point).unit
        alone = Violations(
            equations=equations, chosen=np.arange(unit.size), unit=unit, lower=equations.lower, upper=equations.upper
        )
        found = least_violation(alone, point, settings.max_iterations)
        if not np.isfinite(found.cost):
            continue
        holds = bool((np.abs(found.residuals) <= STILL).all())
        if holds or bool(met(linearise(equations, found.point), equations.equality).all()):
            return found.point, None
        if found.cost < fewest:
            least, fewest, unit_there = found, found.cost, unit
    if least is None:
        return here, None
    return least.point, conflict_at(equations, least, unit_there, settings.max_iterations)


def _places(equations: ConstrainedEquations, here: Floats, start: Floats, seed: int) -> Iterator[Floats]:
    """Where the search for a point that meets the constraints begins: here, at the start, around them, in the box."""
    yield here
    yield start
    random = np.random.default_rng(seed)
    low, high = equations.lower, equations.upper
    boxed = np.isfinite(low) & np.isfinite(high)
    sizes = np.maximum(np.abs(equations.coordinates(start)), 1.0 / linearise(equations, start).scale)
    for _ in range(PLACES):
        moved = equations.retract(start, sizes * random.normal(size=equations.dimension))
        inside = np.where(boxed, low + random.random(equations.dimension) * np.where(boxed, high - low, 0.0), 0.0)
        coordinates = np.clip(np.where(boxed, inside, equations.coordinates(moved)), low, high)
        yield equations.placed(moved, coordinates)
