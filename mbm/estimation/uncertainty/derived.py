"""Quantities computed from the estimates, with their uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binder import Binder
from mbm.equations.binding import Group
from mbm.equations.layout import half_turns, places_in
from mbm.equations.manifolds import numbers_of_stated, tangent_slopes
from mbm.equations.types import Floats, Mask
from mbm.estimation.search.solution import DerivedSolution
from mbm.estimation.uncertainty.degrees import common
from mbm.estimation.uncertainty.observability import limited, pinned, pinned_coordinates, propagate
from mbm.estimation.uncertainty.statistics import Statistics
from mbm.kernels.types import KernelSet
from mbm.problem.manifold import manifold_of
from mbm.problem.tables import Table
from mbm.problem.types import Derived, Problem
from mbm.solver.covariance import STILL
from mbm.values import dataclass

GRADIENT_LIMIT = 20_000_000
"""Numbers in the gradients of derived quantities that are kept for their covariance."""

VARYING = 4 * float(np.finfo(np.float64).eps)
"""Standard deviation beside the value up to which a quantity cannot vary: its derivatives are roundings."""

PINNED = "it varies only as an estimate leaves the limit that holds it"

COVARIANCE_LIMIT = 2_000
"""Derived scalars whose full covariance is made; beyond, the marginal sigmas stay."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Propagation:
    """Linear propagation at the solution: ``numbers`` (N,) are all unknowns, ``equations`` the weighted ones."""

    problem: Problem
    kernels: KernelSet
    binder: Binder
    equations: Assembled
    numbers: Floats
    outcome: Statistics

    def all_derived(self) -> tuple[tuple[DerivedSolution, ...], Floats | None]:
        """All derived quantities, and their common covariance if it is not too large."""
        with np.errstate(all="ignore"):
            found = tuple(self._one(owner) for owner in range(len(self.problem.derived)))
            gradients = [one.gradient for one in found if one.gradient is not None]
            total = sum(len(g) for g in gradients)
            if not gradients or len(gradients) < len(found) or total > COVARIANCE_LIMIT:
                return found, None
            matrix = self._covariance(np.vstack(gradients))
        undefined = np.isnan(np.concatenate([one.sigma.ravel() for one in found]))
        matrix[undefined, :] = np.nan
        matrix[:, undefined] = np.nan
        return found, matrix

    @np.errstate(all="ignore")
    def elsewhere(self, owner: int, table: Table) -> DerivedSolution:
        """A derived quantity for the rows of another table in the place of its own."""
        tables = {**self.binder.tables, table.name: table}
        return replace(self, binder=replace(self.binder, tables=tables))._one(owner)

    def _covariance(self, gradient: Floats) -> Floats:
        """Covariance (k, k) of quantities with a gradient (k, n); NaN where it depends on noise that nobody knows."""
        outcome = self.outcome
        matrix = propagate(gradient, outcome.observed, outcome.covariance).matrix
        unknown = np.zeros(matrix.shape, dtype=bool)
        for each in outcome.alternatives:
            unknown |= each.unknown_of(gradient)
        return np.where(unknown, np.nan, matrix)

    def _one(self, owner: int) -> DerivedSolution:
        derived = self.problem.derived[owner]
        rows = len(self.binder.tables[derived.table]) if derived.table is not None else 1
        numbers, size = widths(derived)
        width = self.equations.dimension
        values, sigma = np.full((rows, numbers), np.nan), np.full((rows, size), np.nan)
        known = common(self.outcome.freedoms.dof, sigma.shape)
        gradient = np.zeros((rows, size, width)) if rows * size * width <= GRADIENT_LIMIT else None
        reason = undefined = None
        for group in self.binder.derived(self.kernels, owner):
            positions = group.positions if group.positions is not None else np.arange(1)
            stated = group.values(self.numbers).copy()
            undefined = undefined or self._why_undefined(group, stated)
            unknown, held_too = self._unknown(group), self._limited(group)
            if derived.kind is None:
                values[positions] = reported(derived, stated)
            else:
                values[positions] = numbers_of_stated(derived.kind, derived.dimension, stated)
                unknown, held_too = (
                    np.repeat(each.any(axis=1, keepdims=True), size, axis=1) for each in (unknown, held_too)
                )
            for lines, slopes in group.dense_slopes(self.numbers, self.equations.columns, width):
                chosen, part = positions[lines], slopes
                if derived.kind is not None:
                    part = tangent_slopes(derived.kind, derived.dimension, stated[lines], slopes)
                spread = self._sigmas(part)
                still, certain = (
                    each.reshape(spread.shape)
                    for each in pinned(self.outcome.observed, part.reshape(spread.size, width))
                )
                constant = ~part.any(axis=-1) | (cannot_vary(stated[lines], spread) if derived.kind is None else False)
                still |= held_too[lines] & constant & ~certain
                reason = PINNED if bool(still.any()) else reason
                if derived.kind is None:
                    held = (cannot_vary(stated[lines], spread) & ~still) | certain
                    part, spread = np.where(held[..., None], 0.0, part), np.where(held, 0.0, spread)
                sigma[chosen] = np.where(unknown[lines] | still, np.nan, spread)
                found = self.outcome.freedoms.of(part)
                known.dof[chosen], known.inflation[chosen] = found.dof, found.inflation
                if gradient is not None:
                    gradient[chosen] = part
        return DerivedSolution(
            owner=owner,
            values=values,
            sigma=sigma,
            freedom=known,
            gradient=None if gradient is None else gradient.reshape(gradient.shape[0] * size, width),
            reason=reason,
            undefined=undefined,
        )

    def _why_undefined(self, group: Group, values: Floats) -> str | None:
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if not len(bad) or not group.kernel.calls:
            return None
        from mbm.kernels.backends.calling import reason_of

        first = int(bad[0])
        inputs = group.inputs_at(self.numbers[None], slice(first, first + 1))
        return reason_of(group.cache.stream(group.number, group.kernel), inputs)

    def _sigmas(self, part: Floats) -> Floats:
        """Standard deviations (rows, size) for gradients (rows, size, n), a part of the rows at a time."""
        flat = part.reshape(part.shape[0] * part.shape[1], part.shape[2])
        sigma = np.empty(len(flat))
        for start in range(0, len(flat), COVARIANCE_LIMIT):
            block = self._covariance(flat[start : start + COVARIANCE_LIMIT])
            sigma[start : start + COVARIANCE_LIMIT] = np.sqrt(np.diag(block))
        return sigma.reshape(part.shape[:2])

    def _unknown(self, group: Group) -> np.ndarray:
        """Which outputs (rows, size) depend on members that no equation mentions."""
        layout = self.equations.layout
        free = self.equations.is_free
        loose = np.flatnonzero(~free & ~layout.fixed)
        if not loose.size or not np.isin(group.reached, loose).any():
            return np.zeros((group.rows, group.kernel.outputs), dtype=bool)
        slopes = group.dense_jacobian(self.numbers, places_in(loose, len(self.equations.layout.number)), len(loose))
        return np.asarray((slopes != 0).any(axis=2))

    def _limited(self, group: Group) -> Mask:
        """Which outputs (rows, outputs) are made of estimates that limits hold, among others."""
        observed, kernel = self.outcome.observed, group.kernel
        shape = group.rows, kernel.outputs
        if not limited(observed):
            return np.zeros(shape, dtype=bool)
        held = np.zeros(len(self.equations.layout.number), dtype=bool)
        held[self.equations.free] = pinned_coordinates(observed)
        if observed.limited_space is not None:
            held[self.equations.free] |= (np.abs(observed.limited_space) > STILL).any(axis=1)
        if group.gathered is not None:
            return np.full(shape, bool(held[group.reached[group.reached < len(held)]].any()))
        of_output = kernel.jacobian_rows[:, None] == np.arange(kernel.outputs)
        return np.broadcast_to(held[group.touched[:, kernel.jacobian_columns]] @ of_output, shape)


def widths(derived: Derived) -> tuple[int, int]:
    """How many numbers a value of a derived quantity has, and how many coordinates its errors."""
    if derived.kind is None:
        return (len(derived.cases[0].values) if derived.cases else 0,) * 2
    shape = manifold_of(derived.kind.value, derived.dimension, 0)
    return shape.size, shape.tangent


def reported(derived: Derived, values: Floats) -> Floats:
    """Values of any shape as they are reported: an angle in (−π, π]."""
    return half_turns(values) if derived.turns else values


def cannot_vary(values: Floats, sigma: Floats) -> Mask:
    """Which quantities have standard deviations that are roundings of their values; arrays of one shape."""
    return np.asarray((sigma > 0.0) & (sigma <= VARYING * np.abs(values)))
