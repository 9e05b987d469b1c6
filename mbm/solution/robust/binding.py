"""The equations of a solve as consensus asks for them: their units, and evaluation at many points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mbm.problem.types import Block, Problem
from mbm.solution.assembly import Assembled
from mbm.solution.batch import Batch, batch
from mbm.solution.closed_forms.minimal import MinimalSolver, minimal_solver
from mbm.solution.closed_forms.types import ClosedForm
from mbm.solution.robust.trials import Trials
from mbm.solution.robust.units import Units
from mbm.solution.solvers.batched import minimise_all
from mbm.solution.sparsity import sparse_suits
from mbm.solution.types import Floats, Indices, Mask
from mbm.target.decisions import CONSENSUS_ROUNDING, FIT_STEPS, STATED
from mbm.values import dataclass


def units_of(equations: Assembled, problem: Problem, point: Floats, ruled: Callable[[Block], bool]) -> Units:
    """The units of the blocks that ``ruled`` picks; ``point`` (N,) is where the rounding of residuals is judged."""
    numbers = equations.units
    act = np.zeros(equations.whole, dtype=bool)
    group = np.full(equations.whole, STATED, dtype=np.int64)
    for each in equations.groups:
        block = problem.blocks[each.kernel.owner]
        lines = slice(each.first, each.first + each.count)
        act[lines] = ruled(block)
        group[lines] = each.kernel.owner if block.unknown_factor else STATED
    number, first, of_row, sizes = np.unique(numbers[act], return_index=True, return_inverse=True, return_counts=True)
    rows = np.full(equations.whole, -1, dtype=np.int64)
    rows[act] = of_row
    terms = np.abs(equations.plain_residuals(point))
    if not sparse_suits(equations):
        terms = terms + np.abs(equations.plain_jacobian(point)) @ np.abs(equations.coordinates(point))
    terms = np.where(np.isfinite(terms), terms, 0.0)[act]
    return Units(
        of_row=rows,
        components=np.asarray(sizes, dtype=np.int64),
        group=group[act][first],
        number=np.asarray(number, dtype=np.int64),
        rounding=np.square(CONSENSUS_ROUNDING * np.maximum.reduceat(terms, first)) if first.size else np.empty(0),
    )


def trials_of(equations: Assembled, units: Units, closed_forms: tuple[ClosedForm, ...] = ()) -> Trials:
    """The equations at many points; together where that is possible, else one after the other.

    Subsets are fitted by one of ``closed_forms`` where one gives all unknowns from a few units.
    """
    plain = without_losses(equations)
    if plain.implicit is not None:
        return _OneByOne(plain.roughly_corrected(), units)
    direct = minimal_solver(plain, plain.numbers, closed_forms) if closed_forms else None
    return _Together(plain, units, batch(plain), np.unique(plain.units), direct)


def trials_of_part(equations: Assembled, units: Units, numbers: Indices, columns: Indices) -> Trials:
    """The equations of some units (``numbers``, ascending) in some coordinates; ``units`` are the ruled ones."""
    plain = without_losses(equations)
    return _Together(plain, units, batch(plain, columns=columns, units=numbers), numbers, None)


def without_losses(equations: Assembled) -> Assembled:
    """The same equations, every unit with its plain squares."""
    return replace(equations, groups=tuple(replace(g, losses=()) for g in equations.groups))


@dataclass(frozen=True, slots=True, eq=False)
class _Together:
    """All points through each kernel at once."""

    equations: Assembled
    units: Units
    whole: Batch
    numbers: Indices
    direct: MinimalSolver | None

    @property
    def dimension(self) -> int:
        """n."""
        return self.whole.dimension

    def residuals(self, points: Floats) -> Floats:
        """Whitened residuals (T, m)."""
        return self.whole.residuals(points)

    def linearised(self, points: Floats) -> tuple[Floats, Floats]:
        """Residuals (T, m) and derivatives (T, m, n)."""
        return self.whole.linearised(points, np.arange(len(points)))

    def coordinates(self, points: Floats) -> Floats:
        """Numbers that steps add to (T, n)."""
        return self.whole.coordinates(points)

    def moved(self, points: Floats, steps: Floats) -> Floats:
        """Points after steps (T, n)."""
        return self.whole.moved(points, steps)

    def fitted(self, starts: Floats, subsets: Indices) -> tuple[Floats, Indices]:
        """Fits to the units of each subset, with what no rule touches."""
        if self.direct is None:
            return self._approached(starts, subsets), np.arange(len(subsets))
        different, first = np.unique(subsets, axis=0, return_index=True)
        points, solved = self.direct.points(np.where(different >= 0, self.units.number[different], -1))
        left = np.setdiff1d(np.arange(len(different)), solved)
        if not len(left):
            return points, first[solved]
        more = self._approached(starts[first[left]], different[left])
        return np.concatenate((points, more)), first[np.concatenate((solved, left))]

    def _approached(self, starts: Floats, subsets: Indices) -> Floats:
        """The same by iteration."""
        filled = np.where(subsets >= 0, subsets, subsets[:, :1])  # a unit that counts twice still fits exactly
        always = np.setdiff1d(self.numbers, self.units.number)
        chosen = np.hstack((self.units.number[filled], np.tile(always, (len(subsets), 1))))
        stack = batch(self.equations, columns=self.whole.columns, units=chosen)
        return minimise_all(stack, starts, iterations=FIT_STEPS).points


@dataclass(frozen=True, slots=True, eq=False)
class _OneByOne:
    """Equations that correct measured values cannot be stacked: one point after the other."""

    equations: Assembled
    units: Units

    @property
    def dimension(self) -> int:
        """n."""
        return self.equations.dimension

    def residuals(self, points: Floats) -> Floats:
        """Whitened residuals (T, m)."""
        return np.stack([self.equations.residuals(point) for point in points])

    def linearised(self, points: Floats) -> tuple[Floats, Floats]:
        """Residuals (T, m) and derivatives (T, m, n)."""
        return self.residuals(points), np.stack([self.equations.jacobian(point) for point in points])

    def coordinates(self, points: Floats) -> Floats:
        """Numbers that steps add to (T, n)."""
        return np.stack([self.equations.coordinates(point) for point in points])

    def moved(self, points: Floats, steps: Floats) -> Floats:
        """Points after steps (T, n), inside the bounds."""
        found = []
        for point, step in zip(points, steps, strict=True):
            there = self.equations.retract(point, step)
            inside = np.clip(self.equations.coordinates(there), self.equations.lower, self.equations.upper)
            found.append(self.equations.placed(there, inside))
        return np.stack(found)

    def fitted(self, starts: Floats, subsets: Indices) -> tuple[Floats, Indices]:
        """Fits to the units of each subset, with what no rule touches: Gauss-Newton steps of minimum norm."""
        found = starts.copy()
        for trial, subset in enumerate(subsets):
            rows = self._rows(subset[subset >= 0])
            for _ in range(FIT_STEPS):
                residuals = self.equations.residuals(found[trial])[rows]
                jacobian = self.equations.jacobian(found[trial])[rows]
                if not (np.isfinite(residuals).all() and np.isfinite(jacobian).all()):
                    break
                step = np.asarray(np.linalg.lstsq(jacobian, -residuals, rcond=1e-10)[0], dtype=np.float64)
                found[trial] = self.moved(found[trial : trial + 1], step[None])[0]
                if float(np.abs(jacobian @ step).max(initial=0.0)) < 1e-9:
                    break
        return found, np.arange(len(subsets))

    def _rows(self, subset: Indices) -> Mask:
        return np.asarray((self.units.of_row < 0) | np.isin(self.units.of_row, subset), dtype=bool)
