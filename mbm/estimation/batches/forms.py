"""What a closed form says of many solves at once: starts where none is stated, and whether it might fit better.

A closed form is recognised in the rows of one solve; what it knows of a row follows from the row's data alone, so that
the others need no probing. Solves are answered where one form gives all numbers of a solve at once, and one solution
fits; the others are left to the general path.
"""

from __future__ import annotations

from dataclasses import field, replace
from typing import Any, Protocol

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.portion import Portion
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import Which
from mbm.estimation.consensus.recognised import Recognised, recognised
from mbm.estimation.settings import Settings
from mbm.estimation.starts.closed_forms.multilateration import Spheres
from mbm.estimation.starts.closed_forms.pose_from_points import Sights
from mbm.estimation.starts.closed_forms.rows import ENOUGH
from mbm.estimation.starts.closed_forms.types import Plan
from mbm.solver.decisions import plausible
from mbm.values import dataclass


class Systems(Protocol):
    """Many solves of one problem, as a closed form looks at them; ``equations`` tell what their numbers are."""

    @property
    def equations(self) -> Assembled:
        """The equations of all of them, or of one that they are like."""
        ...

    def units_of(self, which: Which) -> tuple[Indices, Indices]:
        """Solve (U,), ascending, and number (U,) of the units of some solves."""
        ...

    def costs(self, which: Which, points: Floats) -> Floats:
        """Σ r² (K,) of some solves at points (K, N); anything that is not finite where there is none."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Stacked:
    """The solves of a stack."""

    stack: Stack

    @property
    def equations(self) -> Assembled:
        return self.stack.equations

    def units_of(self, which: Which) -> tuple[Indices, Indices]:
        solve, _, unit = self.stack.units(which, (True,) * len(self.stack.equations.groups))
        return solve, unit

    def costs(self, which: Which, points: Floats) -> Floats:
        with np.errstate(all="ignore"):
            return np.asarray(np.square(Portion(self.stack, which).residuals(points)).sum(axis=1))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Formed:
    """A closed form for all solves of ``systems``.

    ``plan`` has what is known of each unit of the equations, ``known`` (units,) whether that is anything; the numbers
    that are not estimated are those of ``base`` (N,).
    """

    systems: Systems
    plan: Plan
    known: Mask
    base: Floats = field(repr=False)

    def fits(self, which: Which) -> tuple[Floats, Floats]:
        """Points (K, S, N) for some solves, and what they cost (K, S): infinite where a solution is none."""
        found, usable = self._within(self._solved(which))
        costs = np.full(usable.shape, np.inf)
        for rank in range(found.shape[1]):
            there = usable[:, rank]
            if there.any():
                mine = which if there.all() else np.asarray(which)[there]
                costs[there, rank] = self.systems.costs(mine, found[there, rank])
        return found, np.where(np.isfinite(costs), costs, np.inf)

    def _within(self, found: Floats) -> tuple[Floats, Mask]:
        """Points (K, S, N) moved to the bounds that they lie beyond, and which of them are solutions."""
        layout, places = self.systems.equations.layout, self.systems.equations.free
        numbers = layout.number[places]
        plain = numbers >= 0
        lower, upper, positive = layout.lower[places], layout.upper[places], layout.positive[places]
        moved = np.clip(found[..., numbers[plain]], lower[plain], upper[plain])
        found[..., numbers[plain]] = moved
        usable = np.isfinite(found).all(axis=2) & (~positive[plain] | (moved > 0)).all(axis=2)
        return found, np.asarray(usable)

    def starts(self, which: Which) -> Floats:
        """The start (K, N) of each of some solves; NaN where there is none, or several."""
        points, costs = self.fits(which)
        found, lowest = _best(points, costs)
        with np.errstate(invalid="ignore"):
            meant = np.vectorize(plausible, otypes=[bool])(costs, lowest[:, None]) & np.isfinite(costs)
        return np.where((meant.sum(axis=1) == 1)[:, None], found, np.nan)

    def best(self, which: Which) -> tuple[Floats, Floats]:
        """The point (K, N) of the best solution for each of some solves, and its cost (K,): infinite without one."""
        return _best(*self.fits(which))

    def _solved(self, which: Which) -> Floats:
        """The points (K, S, N) of all solutions, NaN beside them."""
        solve, units = self._units(which)
        counts = np.bincount(solve, minlength=len(which))
        ends = np.cumsum(counts)
        parts = []
        for count in np.unique(counts[counts >= self.plan.minimal]).tolist():
            mine = np.flatnonzero(counts == count)
            subsets = units[(ends[mine] - count)[:, None] + np.arange(count)]
            parts.append((mine, self.plan.solved(subsets)))
        width = max((part.shape[1] for _, part in parts), default=1)
        places = self.plan.candidate.places[0]
        found = np.full((len(which), width, len(places)), np.nan)
        for mine, part in parts:
            found[mine, : part.shape[1]] = part
        points = np.tile(self.base, (len(which), width, 1))
        points[..., places] = found
        return points

    def _units(self, which: Which) -> tuple[Indices, Indices]:
        """Solve (U,), ascending, and number (U,) of the units of some solves that the form knows."""
        solve, unit = self.systems.units_of(which)
        known = self.known[unit]
        return solve[known], unit[known]


def _best(points: Floats, costs: Floats) -> tuple[Floats, Floats]:
    """The points (K, N) of least cost among those of S solutions (K, S, N), and that (K,)."""
    best = np.argmin(costs, axis=1)
    found = np.take_along_axis(points, best[:, None, None], axis=1)[:, 0]
    return found, np.take_along_axis(costs, best[:, None], axis=1)[:, 0]


def of_all(found: Recognised, systems: Systems, told: Floats, precision: Floats) -> Formed:
    """A form for ``systems``; ``told`` (units, width) and ``precision`` (units,), 1/σ², are of all units."""
    return Formed(
        systems=systems,
        plan=_of_all(found.plan, told, precision),
        known=np.asarray(np.isfinite(told).all(axis=1)),
        base=found.first.numbers,
    )


def recognised_in(stack: Stack, first: Assembled, settings: Settings) -> Recognised | None:
    """The closed form that gives all numbers of each solve of a stack; None if it is not known from the rows.

    ``first`` are the equations of one solve, in which the form is recognised.
    """
    families = any(entry.keys is not None for entry in stack.equations.layout.entries)
    return None if families or int(stack.rows.max(initial=0)) > ENOUGH else recognised(first, settings)


def formed(stack: Stack, found: Recognised, settings: Settings) -> Formed | None:
    """The closed form for all solves of a stack in which it was recognised; None where rows have to be probed."""
    equations = stack.equations
    told = found.form.of_rows(equations, (True,) * len(equations.groups), settings.closed_forms, exact=True)
    return None if told is None else of_all(found, _Stacked(stack=stack), told, precisions(equations))


def precisions(equations: Assembled) -> Floats:
    """1/σ² of a component (units,), the mean of several."""
    found = []
    for group in equations.groups:
        parts = [np.square(w.weights).reshape(group.rows, -1).sum(axis=1) / (w.last - w.first) for w in group.whiteners]
        found.append(np.stack(parts, axis=1).ravel())
    return np.concatenate(found)


def _of_all(plan: Plan, told: Floats, precision: Floats) -> Plan:
    """The plan with what is told of each unit (units, width) in place of the rows that it was recognised in."""
    data: Any = plan.data
    if isinstance(data, Spheres):
        d = data.stations.shape[1]
        data = replace(
            data,
            stations=told[:, :d],
            length=told[:, d],
            extra=told[:, d + 1],
            slope=told[:, d + 2],
            precision=precision,
        )
    elif isinstance(data, Sights):
        data = replace(data, moved=replace(data.moved, points=told[:, :3]), bearings=told[:, 3:])
    return replace(plan, rows=replace(plan.rows, weight=precision), data=data)
