"""Derived quantities and coordinates as numbers whose profiles are followed: values, gradients, and how far they go."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group, affine
from mbm.equations.types import Floats, Indices
from mbm.estimation.coverage.limits import box
from mbm.estimation.search.solution import DerivedSolution
from mbm.estimation.trust.curvature import FARTHER, MOST_DERIVED, MOST_LINES
from mbm.estimation.trust.farthest import farthest
from mbm.estimation.uncertainty.derived import Propagation
from mbm.solver.covariance import STILL
from mbm.values import dataclass

BETWEEN = 64
"""Places on each side of an estimate at which quantities of it alone are looked at."""

LEAVING = np.geomspace(0.03, 4.0, 16)
"""Steps out of a limit, in standard deviations, where what is least over all else is looked for, too."""

FAR = 100.0
"""The logarithm of the farthest of them where that side has no end."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Quantities:
    """The numbers (k,) of a derived quantity, of the ``group``, with their ``values`` (k,) at the estimates.

    These are the ``point`` (N,). Reported angles are ``turned`` (N,) from those of the equations. ``gradient`` (k, n)
    is that at the estimates, and ``columns`` (M,) the place of each coordinate among the free ones, -1 elsewhere.
    ``straight``: it is the same everywhere.
    """

    group: Group
    point: Floats
    turned: Floats
    values: Floats
    gradient: Floats
    columns: Indices
    angle: bool
    straight: bool

    def touched(self, place: int) -> Indices:
        """The free coordinates that a number is made of."""
        row, output = divmod(place, self.group.kernel.outputs)
        kernel = self.group.kernel
        own = self.group.columns[row % len(self.group.columns), kernel.jacobian_columns[kernel.jacobian_rows == output]]
        own = own if self.group.gathered is None else self.group.reached
        found = self.columns[own[own < len(self.columns)]]
        return np.unique(found[found >= 0])

    @np.errstate(all="ignore")
    def changes(self, points: Floats) -> Floats:
        """How far they are (P, k) from their values at points (P, N)."""
        moved = self.group.values_at(points + self.turned).reshape(len(points), -1) - self.values
        return moved - 2 * np.pi * np.round(moved / (2 * np.pi)) if self.angle else moved

    def slope(self, place: int, point: Floats) -> Floats:
        """The gradient (n,) of one of them at a point (N,)."""
        width = self.gradient.shape[1]
        dense = self.group.dense_jacobian(point + self.turned, self.columns, width)
        return np.asarray(dense.reshape(-1, width)[place])

    def felt(self, place: int, equations: Assembled, alone: Floats) -> bool:
        """Whether one of them has a slope: not one that is rounding beside what steps ``alone`` (n,) make of it.

        Nothing leads away from where it has none, as a product of two numbers at 0.
        """
        steps = np.diag(alone)[self.touched(place)]
        steps = np.vstack([steps, steps.sum(axis=0)])
        points = equations.retract(np.tile(self.point, (2 * len(steps), 1)), np.vstack([steps, -steps]))
        moved = np.abs(self.changes(points)[:, place])
        slope = float(np.abs(self.gradient[place]) @ alone)
        return slope > STILL * float(moved[np.isfinite(moved)].max(initial=0.0))

    @np.errstate(all="ignore")
    def paths(self, place: int, equations: Assembled, leaving: Floats) -> list[dict[float, Floats]]:
        """Points (N,) by how far one of them is from its value there, along each of the steps (n, q) as far as that is
        within all limits, and apart where the number turns round.
        """
        found: list[dict[float, Floats]] = []
        for step in [*leaving.T, *-leaving.T]:
            points = equations.retract(np.tile(self.point, (len(LEAVING), 1)), step * LEAVING[:, None])
            changes = self.changes(points)[:, place]
            last, way = 0.0, 0.0
            for change, point in zip(changes.tolist(), points, strict=True):
                if change == 0.0 or not np.isfinite(change) or not _within(equations, point):
                    continue
                if (change - last) * way <= 0.0:
                    found.append({})
                found[-1][change] = point
                last, way = change, change - last
        return found

    @np.errstate(all="ignore")
    def behind(
        self,
        place: int,
        equations: Assembled,
        steps: Floats,
        ends: tuple[float, float],
        inside: Callable[[Floats], bool],
    ) -> dict[float, Floats]:
        """The points (N,) farthest beyond its ``ends``, by how far one of them is from its value there: one below and
        one above, where there are some ``inside`` and within all limits along ``steps`` (n, q).
        """
        ways = (np.hstack([steps, -steps]).T[:, None] * LEAVING[:, None]).reshape(-1, len(steps))
        points = equations.retract(np.tile(self.point, (len(ways), 1)), ways)
        changes = self.changes(points)[:, place]
        found: dict[float, Floats] = {}
        for beyond, order in (
            (changes < -(1.0 + FARTHER) * ends[0], np.argsort(changes)),
            (changes > (1.0 + FARTHER) * ends[1], np.argsort(-changes)),
        ):
            candidates = (which for which in order[beyond[order]].tolist() if np.isfinite(changes[which]))
            good = (which for which in candidates if inside(points[which]) and _within(equations, points[which]))
            found.update({float(changes[which]): points[which] for which in islice(good, 1)})
        return found

    @np.errstate(all="ignore")
    def endless(
        self,
        place: int,
        equations: Assembled,
        steps: Floats,
        reached: list[Floats],
        inside: Callable[[Floats], bool],
    ) -> tuple[bool, bool]:
        """Whether one of them has no end below and above: along ``steps`` (n, q), as where a divisor becomes 0, or at
        the limits of the unknowns beside points (N,) that are ``reached``.
        """
        lines = np.concatenate([-LEAVING[::-1], [0.0], LEAVING])

        def moved(step: Floats, sign: float, shares: Floats) -> Floats:
            points = equations.retract(np.tile(self.point, (len(shares), 1)), shares[:, None] * step)
            good = [inside(point) and _within(equations, point) for point in points]
            return np.where(good, sign * self.changes(points)[:, place], np.nan)

        def without_end(sign: float) -> bool:
            far = np.nanmax(sign * table, axis=1, initial=0.0)
            best = (which for which in np.argsort(-far)[:MOST_LINES].tolist() if far[which] > 0.0)
            values = ((partial(moved, steps[:, which], sign), sign * table[which]) for which in best)
            return any(np.isinf(farthest(value, lines, each)[0]) for value, each in values)

        table = np.stack([moved(step, 1.0, lines) for step in steps.T])
        points = [each for point in reached for each in _at_limits(equations, point) if inside(each)]
        changes = self.changes(np.array(points))[:, place] if points else np.zeros(0)
        return bool((changes == -np.inf).any()) or without_end(-1.0), bool((changes == np.inf).any()) or without_end(
            1.0
        )

    def beyond_all(self, place: int, paths: list[dict[float, Floats]]) -> bool:
        """Whether all values along one of the paths are lost in rounding beside that at the estimates, as of a quotient
        by what is at 0: it has no value there.
        """
        value = float(self.values[place])
        return any(all(abs(value + change) < STILL * abs(value) for change in path) for path in paths)

    def reach(self, number: int, below: float, above: float) -> tuple[Floats, Floats]:
        """How far they go (k,) below and above while one ``number`` goes so far; NaN where that is not known."""

        def moved(places: int | slice, sign: float, shares: Floats) -> Floats:
            points = np.tile(self.point, (len(shares), 1))
            points[:, number] += np.where(shares < 0.0, -_distances(-shares, below), _distances(shares, above))
            return sign * self.changes(points)[:, places]

        grid = np.linspace(-1.0, 1.0, 2 * BETWEEN - 1)
        every = moved(slice(None), 1.0, grid)
        table = np.stack([-every, every])
        lost = np.isnan(table[0, [0, -1]][np.isinf([below, above])]).any(axis=0)
        ends = np.nanmax(table, axis=1)
        turning = (table[:, [0, -1]].max(axis=1) != ends) & (ends > 0.0)
        for side, place in np.argwhere(turning).tolist():
            value = partial(moved, place, -1.0 if side == 0 else 1.0)
            ends[side, place] = farthest(value, grid, table[side, :, place])[0]
        return np.where(lost, np.nan, ends[0]), np.where(lost, np.nan, ends[1])


@dataclass(frozen=True, slots=True, eq=False)
class Coordinates:
    """The free coordinates as quantities: their ``numbers`` (n,) among all, with ``values`` (n,) at the estimates."""

    numbers: Indices
    values: Floats

    def changes(self, points: Floats) -> Floats:
        """How far they are (P, n) from their values at points (P, N)."""
        return np.asarray(points[:, self.numbers] - self.values)

    def slope(self, place: int, _: Floats) -> Floats:
        """The gradient (n,) of one of them."""
        return np.asarray(np.eye(len(self.numbers))[place])


def _within(equations: Assembled, point: Floats) -> bool:
    """Whether a point is within all limits."""
    place = equations.coordinates(point)
    limits = equations.constraint_values(point)[~equations.equality]
    lower, upper = box(equations)
    return bool((limits <= 0.0).all() and (lower <= place).all() and (place <= upper).all())


def _at_limits(equations: Assembled, point: Floats) -> Iterator[Floats]:
    """The points (N,) with one coordinate at a limit of its own, where they are within all limits."""
    place = equations.coordinates(point)
    for limits in box(equations):
        for which in np.flatnonzero(np.isfinite(limits)).tolist():
            there = equations.retract(point, (limits - place)[which] * np.eye(len(place))[which])
            if _within(equations, there):
                yield there


def _distances(shares: Floats, reach: float) -> Floats:
    """Places at shares of a distance, which may be infinite."""
    return reach * shares if np.isfinite(reach) else np.where(shares < 1.0, np.expm1(FAR * shares), np.inf)


def quantities(propagation: Propagation, one: DerivedSolution, point: Floats) -> Quantities | None:
    """The numbers of a derived quantity at the estimates ``point`` (N,).

    None: they are rotations or the like, too many, or their rows follow several formulas.
    """
    equations, stated = propagation.equations, propagation.problem.derived[one.owner]
    groups = propagation.binder.derived(propagation.kernels, one.owner)
    several = len(groups) != 1 or groups[0].rows != len(one.values)
    if stated.kind is not None or one.gradient is None or several or one.values.size > MOST_DERIVED:
        return None
    columns = equations.columns
    return Quantities(
        group=groups[0],
        point=point,
        turned=equations.layout.reported(point) - point,
        values=one.values.ravel(),
        gradient=one.gradient,
        columns=columns,
        angle=stated.angle,
        straight=not stated.angle and affine(groups[0], columns >= 0),
    )
