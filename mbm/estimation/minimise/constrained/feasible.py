"""A search that ended with violations → a point that meets the constraints, or the fewest that contradict one another.

Where the violations are least, those that remain and the bounds that hold there are a contradiction (the multipliers
of the minimum prove it for the linearised constraints). The deletion filter (Chinneck and Dravnieks 1991) then leaves
one out at a time: what can be left out without making the rest feasible belongs not to the set.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbm.equations.metric import Forwarding
from mbm.equations.types import Conflict, Floats, Indices, Mask, Minimum
from mbm.estimation.minimise.constrained.linearise import linearise, met
from mbm.estimation.minimise.constrained.types import ConstrainedEquations
from mbm.estimation.minimise.native.minimum import native_minimum
from mbm.estimation.settings import Settings
from mbm.problem.types import Method
from mbm.values import dataclass

TOLERANCE = 1e-10
STILL = 1e-7
"""Violations (in units of the constraints) that are none: the search for the least has this accuracy at least."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Violations(Forwarding):
    """A residual for each constraint ``chosen`` (k,), in its ``unit`` (k,); 0 of an inequality that holds."""

    equations: ConstrainedEquations
    chosen: Indices
    unit: Floats
    lower: Floats
    upper: Floats

    @property
    def count(self) -> int:
        """Constraints."""
        return len(self.unit)

    @property
    def linear(self) -> bool:
        """Never promised: inequalities have a kink."""
        return False

    def residuals(self, x: Floats) -> Floats:
        """The violations, of equations with their signs."""
        values = self.equations.constraint_values(x)[self.chosen]
        return np.where(self._equality | np.isnan(values), values, np.maximum(values, 0.0)) / self.unit

    def jacobian(self, x: Floats) -> Floats:
        """Their derivatives."""
        acting = self._equality | ~(self.equations.constraint_values(x)[self.chosen] <= 0.0)
        return self.equations.constraint_jacobian(x)[self.chosen] * (acting / self.unit)[:, None]

    @property
    def _equality(self) -> Mask:
        return self.equations.equality[self.chosen]


def least_violation(alone: Violations, start: Floats, limit: int) -> Minimum:
    """The point near ``start`` where ``Σ (violation/unit)²`` is least; its residuals are the violations."""
    settings = Settings(method=Method.MARQUARDT, max_iterations=limit, tolerance=TOLERANCE)
    return native_minimum(alone, start, settings)


PLACES = 10
"""Points around the start from which a feasible one is searched for before there is said to be none."""


LARGEST = 200
"""Members of a contradiction that are tried one by one; of more, all that take part are named."""


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


def conflict_at(equations: ConstrainedEquations, least: Minimum, unit: Floats, limit: int) -> Conflict:
    """The contradiction seen at the point ``least`` of least violation."""
    values = equations.constraint_values(least.point) / unit
    remaining = np.where(equations.equality, np.abs(values), values) > STILL
    members = [("constraint", int(i)) for i in np.flatnonzero(remaining)]
    members += [("lower", int(j)) for j in np.flatnonzero((least.at_bound < 0) & np.isfinite(equations.lower))]
    members += [("upper", int(j)) for j in np.flatnonzero(least.at_bound > 0)]
    smallest = len(members) <= LARGEST
    if smallest and not _impossible(equations, members, least.point, unit, limit):
        members += [("constraint", int(i)) for i in np.flatnonzero(~remaining)]
        smallest = len(members) <= LARGEST
    if smallest:
        for member in tuple(members):
            others = [m for m in members if m != member]
            if others and _impossible(equations, others, least.point, unit, limit):
                members = others
    return Conflict(
        constraints=tuple(i for kind, i in members if kind == "constraint"),
        lower=tuple(i for kind, i in members if kind == "lower"),
        upper=tuple(i for kind, i in members if kind == "upper"),
        smallest=smallest,
    )


def _impossible(
    equations: ConstrainedEquations, members: list[tuple[str, int]], point: Floats, unit: Floats, limit: int
) -> bool:
    """Whether no point near ``point`` meets the constraints and bounds ``members``."""
    chosen = np.array([i for kind, i in members if kind == "constraint"], dtype=np.int64)
    if not chosen.size:
        return False
    lower, upper = np.full(equations.dimension, -np.inf), np.full(equations.dimension, np.inf)
    for kind, i in members:
        if kind == "lower":
            lower[i] = equations.lower[i]
        elif kind == "upper":
            upper[i] = equations.upper[i]
    part = Violations(equations=equations, chosen=chosen, unit=unit[chosen], lower=lower, upper=upper)
    return not bool((np.abs(least_violation(part, point, limit).residuals) <= STILL).all())
