"""Profiles of the cost within all limits: of a coordinate, or of a derived quantity, as an equation more.

Unlike those of `trust.profile`, which are followed along the tangent of a minimum, each place is a minimum of its own:
estimates that a limit holds leave it where the cost wants it.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.metric import Forwarding
from mbm.equations.types import Floats, Mask, Minimum
from mbm.estimation.coverage.quantities import Coordinates, Quantities
from mbm.estimation.minimise.constrained.linearise import linearise, met
from mbm.estimation.minimise.constrained.solve import function_constrained_minimum
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.minimise.native.minimum import native_minimum
from mbm.estimation.settings import Settings
from mbm.values import dataclass

SHORTER_STEPS = 40
"""Steps to where a likelihood has a value, those that are halved as they lead to none counted."""


class Profile:
    """The profile of the cost of the coordinate ``which`` (of the free ones) about a minimum."""

    def __init__(self, equations: Assembled, minimum: Minimum, which: int, variance: float, settings: Settings) -> None:
        free = equations.free
        self._number = int(equations.layout.number[free[which]])
        self._every = equations
        self._others = equations.freed(np.delete(free, which), minimum.point)
        self._settings = settings
        self._least = minimum.cost
        self._variance = variance
        self._points = {0.0: minimum.point}
        self.value = float(minimum.point[self._number])
        self.centre = 0.0

    def growth(self, step: float) -> float:
        """By how many variances the cost grows with a step of the coordinate, least over all others; infinite where
        there is no value.

        Where there is none with the others as they are at the nearest step so far, shorter steps lead there.
        """
        return self._along(self._points, step)

    def _along(self, points: dict[float, Floats], step: float) -> float:
        """The same from the nearest of points, by their steps, which are kept."""
        near, there = min(points, key=lambda each: abs(each - step)), step
        for _ in range(SHORTER_STEPS):
            found = self._found(points[near], there)
            if found is None:
                there = 0.5 * (near + there)
                continue
            cost, point = found
            if not np.isfinite(cost):
                break
            points[there] = point
            if there == step:
                return max(cost - self._least, 0.0) / self._variance
            near, there = there, step
        return np.inf

    def _found(self, start: Floats, there: float) -> tuple[float, Floats] | None:
        """The least cost (infinite: none) after a step, from a point near it, and where; None: nothing leads there."""
        start = start.copy()
        start[self._number] = self.value + there
        residuals = self._others.residuals(start)
        cost = float(residuals @ residuals)
        if not self._others.dimension:
            every = self._every
            met_all = not every.constraints or bool(met(linearise(every, start), every.equality).all())
            return (cost if met_all else np.inf), start
        if not np.isfinite(cost):
            return None
        found = minimise(self._others, start, self._settings)
        return (found.cost if found.feasible else np.inf), found.point


class Constants:
    """Uncertain constants beside the residuals (r,) of a cost of one variance: v (m,), of one standard deviation each.

    These move residuals by −``moves`` v, with ``moves`` (r, m), and a quantity by ``direct`` (m,) v.
    """

    def __init__(self, moves: Floats, direct: Floats) -> None:
        self.moves, self.direct = moves, direct
        self.length = float(np.linalg.norm(direct))
        along = direct / self.length if self.length > 0.0 else direct
        self.pulled = moves @ along / (self.length or 1.0)
        self._left, singular, _ = np.linalg.svd(moves - np.outer(moves @ along, along), full_matrices=False)
        self._less = 1.0 - 1.0 / np.sqrt(1.0 + np.square(singular))

    def without(self, values: Floats) -> Floats:
        """The root (r, …) of the least cost over all v that do not move the quantity."""
        return np.asarray(values - self._left @ ((self._left.T @ values).T * self._less).T)

    def best(self, residuals: Floats) -> Floats:
        """The v (m,) of the least cost."""
        square = np.eye(len(self.direct)) + self.moves.T @ self.moves
        return np.asarray(np.linalg.solve(square, self.moves.T @ residuals))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beside(Forwarding):
    """The ``equations`` where constants are as probable as can be."""

    equations: Assembled
    constants: Constants
    lower: Floats
    upper: Floats

    @property
    def linear(self) -> bool:
        """As the equations are."""
        return self.equations.linear

    @property
    def equality(self) -> Mask:
        """Which constraints are equations."""
        return self.equations.equality

    def residuals(self, x: Floats) -> Floats:
        """Whitened residuals."""
        return self.constants.without(self.equations.residuals(x))

    def jacobian(self, x: Floats) -> Floats:
        """Their derivatives."""
        return self.constants.without(self.equations.jacobian(x))

    def constraint_values(self, x: Floats) -> Floats:
        """Those of the problem."""
        return self.equations.constraint_values(x)

    def constraint_jacobian(self, x: Floats) -> Floats:
        """Their derivatives."""
        return self.equations.constraint_jacobian(x)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Aimed(Beside):
    """The same, and what the number ``place`` of quantities lacks of a change by ``target``."""

    quantities: Quantities | Coordinates
    place: int
    target: float

    @property
    def linear(self) -> bool:
        """Never promised of the quantity."""
        return False

    def lacking(self, x: Floats) -> float:
        """What the quantity lacks."""
        return self.target - float(self.quantities.changes(x[None])[0, self.place])

    def slope(self, x: Floats) -> Floats:
        """The gradient (n,) of the quantity."""
        return self.quantities.slope(self.place, x)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Brought(_Aimed):
    """The same with what the quantity lacks as a constraint more."""

    @property
    def equality(self) -> Mask:
        """Which constraints are equations."""
        return np.append(self.equations.equality, True)

    def constraint_values(self, x: Floats) -> Floats:
        """Those of the problem, and what the quantity lacks."""
        return np.append(self.equations.constraint_values(x), -self.lacking(x))

    def constraint_jacobian(self, x: Floats) -> Floats:
        """Their derivatives."""
        return np.vstack([self.equations.constraint_jacobian(x), self.slope(x)])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MadeUp(_Aimed):
    """The same where constants move the quantity directly: they make up for what it lacks, a residual more."""

    @property
    def count(self) -> int:
        """One more."""
        return self.equations.count + 1

    def residuals(self, x: Floats) -> Floats:
        """Whitened residuals."""
        lacking, constants = self.lacking(x), self.constants
        own = self.equations.residuals(x) - constants.pulled * lacking
        return np.append(constants.without(own), lacking / constants.length)

    def jacobian(self, x: Floats) -> Floats:
        """Their derivatives."""
        slope, constants = self.slope(x), self.constants
        own = self.equations.jacobian(x) + np.outer(constants.pulled, slope)
        return np.vstack([constants.without(own), -slope / constants.length])


class QuantityProfile(Profile):
    """The same of the number ``place`` of derived quantities, with uncertain constants.

    Their standard deviations are ``moves`` (m, n) of the coordinates without limits, and (m,) of the number itself.
    Points along ``paths``, by the step of the number, are where to begin, too: what bends is reached in several ways.
    """

    def __init__(
        self,
        equations: Assembled,
        minimum: Minimum,
        which: tuple[Quantities | Coordinates, int],
        moves: tuple[Floats, Floats],
        variance: float,
        settings: Settings,
        paths: Sequence[dict[float, Floats]] = (),
    ) -> None:
        self._equations, self._settings = equations, settings
        self._quantities, self._place = which
        self._least = minimum.cost
        self._variance = variance
        self._points, self._paths = {0.0: minimum.point}, paths
        self.value = float(self._quantities.values[self._place])
        self.centre = 0.0
        free, direct = (each / np.sqrt(variance) for each in moves)
        self._constants = Constants(np.nan_to_num(minimum.jacobian @ free.T), direct)
        if len(free):
            self._begin(minimum.point)

    def growth(self, step: float) -> float:
        """The least of all ways."""
        return min(self._along(points, step) for points in (self._points, *self._paths))

    def reached(self) -> list[Floats]:
        """The points (N,) that were come to."""
        return [point for points in (self._points, *self._paths) for point in points.values()]

    def begun_at(self, points: dict[float, Floats]) -> QuantityProfile:
        """The same that begins at more points, by the step of the number, too."""
        other = copy(self)
        other._paths = [*self._paths, *({step: point} for step, point in points.items())]
        return other

    def _begin(self, point: Floats) -> None:
        """Beside limits, constants need not be most probable where they are stated."""
        equations = self._equations
        every = Constants(self._constants.moves, np.zeros(len(self._constants.direct)))
        beside = Beside(equations=equations, constants=every, lower=equations.lower, upper=equations.upper)
        found = minimise(beside, point, self._settings)
        best = every.best(equations.residuals(found.point))
        change = float(self._quantities.changes(found.point[None])[0, self._place])
        self._least, self.centre = found.cost, change + float(self._constants.direct @ best)
        self._points[self.centre] = found.point

    def _found(self, start: Floats, there: float) -> tuple[float, Floats] | None:
        brought = (MadeUp if self._constants.length > 0.0 else Brought)(
            equations=self._equations,
            constants=self._constants,
            lower=self._equations.lower,
            upper=self._equations.upper,
            quantities=self._quantities,
            place=self._place,
            target=there,
        )
        least = function_constrained_minimum if brought.equality.size else native_minimum
        found = least(brought, start, self._settings)
        good = found.bad_row is None and found.feasible
        return (found.cost if good else np.inf), found.point
