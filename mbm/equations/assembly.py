"""Groups of equations → one least squares problem with constraints over the free coordinates."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.binding import Group, affine, all_seen, block_rows, mentioned
from mbm.equations.layout import Layout, places_in
from mbm.equations.losses import rooted_residuals, rooted_slopes
from mbm.equations.manifolds import chart_slopes
from mbm.equations.scatter import Scatter
from mbm.equations.types import Floats, Indices, Mask
from mbm.kernels.types import Backend, MachineCode
from mbm.problem.types import BlockRole
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.equations.corrections.elimination import Elimination
    from mbm.equations.losses import LossFunction
    from mbm.equations.structure import Structure


DENSE = 20_000_000
"""Numbers in a Jacobian up to which the places of its elements are found once for all."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Assembled:
    """The equations of one solve, as the solvers see them (protocol ``Equations``), over the free coordinates.

    A point is the vector of all numbers (N,); ``numbers`` is the start. ``used`` (M,) are the coordinates that some
    equation depends on, ``free`` the positions of the estimated ones. ``factors`` (all residuals,) multiplies σ row by
    row: the noise factors of unknown groups. ``rows`` picks residuals (None: all of them); m counts those picked.
    ``implicit`` has the equations with errors in measured columns, whose corrections are eliminated (None: there are
    none, or the columns are taken as exact), ``structure`` what residuals share (None: they are independent).
    """

    layout: Layout
    groups: tuple[Group, ...]
    constraints: tuple[Group, ...]
    equality: Mask
    numbers: Floats
    used: Mask
    free: Indices
    factors: Floats | None = None
    rows: Indices | None = None
    implicit: Elimination | None = None
    structure: Structure | None = None
    linear: bool = False
    _scatters: tuple[Scatter, ...] = ()

    @property
    def dimension(self) -> int:
        """Free coordinates, n."""
        return len(self.free)

    @property
    def backend(self) -> Backend | None:
        """What evaluates the kernels; None if there are none."""
        return self.groups[0].cache.backend if self.groups else None

    @property
    def machine_code(self) -> MachineCode | None:
        """The backend, if it makes machine code: only then is anything native worth loading."""
        backend = self.backend
        return backend if isinstance(backend, MachineCode) else None

    @property
    def whole(self) -> int:
        """Scalar residuals of all groups, picked or not."""
        return self.groups[-1].first + self.groups[-1].count if self.groups else 0

    @property
    def count(self) -> int:
        """Scalar residuals, m."""
        return self.whole if self.rows is None else len(self.rows)

    @property
    def lower(self) -> Floats:
        """Hard lower bounds (n,)."""
        return self.layout.lower[self.free]

    @property
    def upper(self) -> Floats:
        """Hard upper bounds (n,)."""
        return self.layout.upper[self.free]

    @property
    def positive(self) -> Mask:
        """Coordinates that stay above zero (n,)."""
        return self.layout.positive[self.free]

    @property
    def turning(self) -> Mask | None:
        """Coordinates of rotations, directions and scales (n,); None where there is none."""
        return self.layout.number[self.free] < 0 if self.layout.curved else None

    @property
    def profiled(self) -> bool:
        """The Jacobian is not the derivative of the residuals, though it gives the exact gradient."""
        return self.implicit is not None

    @property
    def lossy(self) -> bool:
        """Some group has a robust loss."""
        return any(group.losses for group in self.groups)

    @property
    def floored(self) -> bool:
        """Some combination of residuals has hardly any noise beside others (`mbm.equations.whitening.FLOOR`)."""
        return any(each.floored for group in self.groups for each in group.whiteners)

    @property
    def units(self) -> Indices:
        """The unit (one equation in one row) of each residual (m,); losses and outlier rules act on units."""
        return self.every_unit if self.rows is None else self.every_unit[self.rows]

    @property
    def every_unit(self) -> Indices:
        """The unit of each residual, picked or not."""
        parts = [group.units.ravel() for group in self.groups]
        return np.concatenate(parts) if parts else np.empty(0, dtype=np.int64)

    def moving(self) -> Mask:
        """Which numbers (N,) the estimated coordinates move."""
        return self._moved_by(self.free)

    def sought(self) -> Mask:
        """Which of these some equation mentions: closed forms and starts are looked for them alone."""
        return self._moved_by(self.free[self.used[self.free]])

    def foreknown(self) -> Mask:
        """Which of these priors speak of."""
        told = mentioned(tuple(g for g in self.groups if g.role is BlockRole.PRIOR), len(self.layout.number))
        return self._moved_by(self.free[told[self.free]])

    def _moved_by(self, coordinates: Indices) -> Mask:
        layout = self.layout
        free = np.zeros(len(layout.number), dtype=bool)
        free[coordinates] = True
        found = np.zeros(len(layout.start), dtype=bool)
        found[layout.number[free & (layout.number >= 0)]] = True
        for curved in layout.curved:
            found[curved.numbers[free[curved.coordinates].any(axis=1)]] = True
        return found

    def retract(self, x: Floats, step: Floats) -> Floats:
        """The point (N,) after a step (n,) of the free coordinates; or as many points (…, N) as steps (…, n)."""
        layout = self.layout
        if not layout.curved:
            moved = x.copy()
            moved[..., layout.number[self.free]] += step
            return moved
        every = np.zeros((*step.shape[:-1], len(layout.number)))
        every[..., self.free] = step
        return layout.retract(x, every)

    def chart_slopes(self, x: Floats, step: Floats) -> Floats:
        """How a step at ``retract(x, step)`` varies with the step at x (n, n); the identity for plain numbers."""
        every = np.zeros(len(self.layout.number))
        every[self.free] = step
        result = np.eye(len(every))
        for curved in self.layout.curved:
            slopes = chart_slopes(curved.piece, x[curved.numbers], every[curved.coordinates])
            for lines, slope in zip(curved.coordinates, slopes, strict=True):
                result[np.ix_(lines, lines)] = slope
        return result[np.ix_(self.free, self.free)]

    def coordinates(self, x: Floats) -> Floats:
        """The numbers that steps add to (n,), 0 for rotations, directions and scales."""
        places = self.layout.number[self.free]
        return x[places] if not self.layout.curved else np.where(places >= 0, x[places], 0.0)

    def placed(self, x: Floats, coordinates: Floats) -> Floats:
        """The point with other coordinates; what they do not hold stays."""
        places = self.layout.number[self.free]
        plain = places >= 0
        moved = x.copy()
        moved[places[plain]] = coordinates[plain]
        return moved

    def plain_residuals(self, x: Floats) -> Floats:
        """Whitened residuals without losses (m,)."""
        parts = [(group, group.whitened(group.values(x))) for group in self.groups if not self.eliminated(group)]
        result = np.zeros(self.whole)
        for group, part in parts:
            result[group.first : group.first + group.count] = part.ravel()
        if self.implicit is not None:
            self.implicit.add_residuals(x, result)
        self._divide(result)
        return result if self.rows is None else result[self.rows]

    def plain_jacobian(self, x: Floats) -> Floats:
        """Whitened Jacobian without losses (m, n)."""
        return self.plain_linearised(x)[1]

    def plain_linearised(self, x: Floats) -> tuple[Floats, Floats]:
        """``plain_residuals`` and ``plain_jacobian``, each kernel called once for both."""
        residuals, jacobian = np.zeros(self.whole), np.zeros((self.whole, self.dimension))
        scatters = self._scatters or tuple(group.scatter(self.columns) for group in self.groups)
        for group, places in zip(self.groups, scatters, strict=True):
            if not self.eliminated(group):
                lines = slice(group.first, group.first + group.count)
                part = jacobian[lines].reshape(group.rows, group.kernel.outputs, self.dimension)
                residuals[lines] = group.whitened(group.add_jacobian(x, places, part)).ravel()
                group.whiten_rows(part)
        if self.implicit is not None:
            self.implicit.add_residuals(x, residuals)
            self.implicit.add_jacobian(x, jacobian)
        self._divide(residuals)
        self._divide(jacobian.T)
        return (residuals, jacobian) if self.rows is None else (residuals[self.rows], jacobian[self.rows])

    def eliminated(self, group: Group) -> bool:
        """Whether the corrections of measured values in a group's equations are eliminated."""
        return self.implicit is not None and group.kernel.corrections is not None

    def residuals(self, x: Floats) -> Floats:
        """Whitened residuals with losses in square-root form (m,): the sum of their squares is the robust cost."""
        return self.rooted(self.plain_residuals(x))

    def residuals_at(self, points: Floats) -> Floats:
        """``residuals`` (P, m) at points (P, N), each kernel called once for all of them."""
        straight = self.straightened()
        if straight is None:
            return self.rooted(self.plain_residuals_at(points))
        found = straight.residuals_at(points)
        left = np.flatnonzero(~np.isfinite(found).all(axis=1))
        if len(left):
            found[left] = self.rooted(self.plain_residuals_at(points[left]))
        return found

    def plain_residuals_at(self, points: Floats) -> Floats:
        """The same without losses."""
        result = np.zeros((len(points), self.whole))
        for group in self.groups:
            if not self.eliminated(group):
                values = group.whitened(group.values_at(points))
                result[:, group.first : group.first + group.count] = values.reshape(len(points), group.count)
        if self.implicit is not None:
            self.implicit.residuals_at(points, result)
        self._divide(result)
        return result if self.rows is None else result[:, self.rows]

    def _divide(self, whitened: Floats) -> None:
        """Divide (…, whole) by what rows share of their noise, in place: factors of blocks, correlations of rows."""
        if self.factors is not None:
            whitened /= self.factors
        if self.structure is not None:
            self.structure.make_independent(whitened.T)

    def jacobian(self, x: Floats) -> Floats:
        """Derivative of ``residuals`` by a step (m, n)."""
        return self.linearised(x)[1]

    def linearised(self, x: Floats) -> tuple[Floats, Floats]:
        """``residuals`` and ``jacobian``, each kernel called once for both."""
        plain, slopes = self.plain_linearised(x)
        return (self.rooted(plain), rooted_slopes(loss_lines(self), plain, slopes)) if self.lossy else (plain, slopes)

    def rooted(self, plain: Floats) -> Floats:
        """Residuals (…, m) with the losses of their units, in square-root form."""
        acting = ((loss, (..., lines)) for loss, lines in loss_lines(self))
        return rooted_residuals(acting, plain) if self.lossy else plain

    def constraint_values(self, x: Floats) -> Floats:
        """What the constraints want zero, or not above zero (k,); see ``equality``."""
        parts = [group.values(x).ravel() for group in self.constraints]
        return np.concatenate(parts) if parts else np.empty(0)

    def constraint_jacobian(self, x: Floats) -> Floats:
        """Derivative of ``constraint_values`` by a step (k, n)."""
        columns = self.columns
        parts = [g.dense_jacobian(x, columns, self.dimension).reshape(-1, self.dimension) for g in self.constraints]
        return np.vstack(parts) if parts else np.empty((0, self.dimension))

    def with_factors(self, factors: Floats | None) -> Assembled:
        """The same equations with other noise factors (all residuals,)."""
        if factors is self.factors:
            return self
        structure = None if self.structure is None else self.structure.scaled(factors)
        return replace(self, factors=factors, structure=structure)

    def everything(self) -> Assembled:
        """The same equations with no residual left out."""
        if self.rows is None:
            return self
        implicit = self.implicit.everything(self.columns) if self.implicit is not None else None
        return replace(self, rows=None, implicit=implicit)

    def kept(self, units: Mask) -> Assembled:
        """The equations of those units alone that the mask (all units,) picks."""
        chosen = units[self.every_unit]
        implicit = self.implicit.kept(chosen, self.columns) if self.implicit is not None else None
        return replace(self, rows=np.flatnonzero(chosen), implicit=implicit)

    def uncorrected(self) -> Assembled:
        """The same with all measured values exact and weighted as they are (no likelihoods), to find starts with."""
        exact = replace(self, implicit=None)
        if self.likely:
            return replace(exact._seen(plain=True), factors=None, structure=None)
        return self if self.implicit is None else exact.freed(self.free, self.numbers)

    @property
    def likely(self) -> bool:
        """Residuals of some group are those of a likelihood."""
        return any(group.readings is not None for group in self.groups)

    @property
    def uncounted(self) -> Mask | None:
        """Which residuals (m,) are no part of χ², and have no noise; None: none of them."""
        found = np.zeros(self.whole, dtype=bool)
        for group in self.groups if self.likely else ():
            found[group.first : group.first + group.count] = np.tile(~group.counting, group.rows)
        found = found if self.rows is None else found[self.rows]
        return found if found.any() else None

    def informing(self) -> Assembled:
        """Equations the squares of whose derivatives are the Fisher information; these where there is no likelihood."""
        return self._seen(plain=False) if self.likely else self

    def _seen(self, *, plain: bool) -> Assembled:
        groups, implicit = all_seen(self.groups, plain=plain), self.implicit
        if implicit is not None:
            implicit = implicit.some(groups, [np.arange(group.rows) for group in groups])
        return replace(self, groups=groups, implicit=implicit).freed(self.free, self.numbers)

    def noise_rows(self, number: int) -> Indices:
        """Positions (in m) of the residuals of block ``number`` that have its noise."""
        every, left = self.block_rows(number), self.uncounted
        return every if left is None else every[~left[every]]

    def straightened(self) -> Assembled | None:
        """The same equations, their corrections eliminated by the kernels; None: it cannot be done so.

        Residuals and Jacobian are the same; they are not finite where the corrections need a search.
        """
        if self.implicit is None or self.rows is not None or self.machine_code is None:
            return None
        groups = self.implicit.straight(self.groups)
        return None if groups is None else replace(self, groups=groups, implicit=None, linear=False, _scatters=())

    def roughly_corrected(self) -> Assembled:
        """The same equations with corrections of measured values to first order, to compare many points with."""
        return self if self.implicit is None else replace(self, implicit=self.implicit.roughly())

    @property
    def columns(self) -> Indices:
        """The column of each coordinate (M,) in Jacobians, -1 where it is not free."""
        return places_in(self.free, len(self.layout.number))

    @property
    def is_free(self) -> Mask:
        """Which coordinates (M,) are free."""
        return self.columns >= 0

    def picked(self, whole: Floats) -> Floats:
        """Of one value for each of all residuals those of the residuals picked (m,)."""
        return whole if self.rows is None else whole[self.rows]

    def expanded(self, picked: Floats) -> Floats:
        """The reverse: of all residuals what those picked (m, …) have, 0 of the others."""
        if self.rows is None:
            return picked
        whole = np.zeros((self.whole, *picked.shape[1:]))
        whole[self.rows] = picked
        return whole

    def block_rows(self, number: int) -> Indices:
        """Positions (in m) of the residuals of block ``number``."""
        every = block_rows(self.groups, number)
        return every if self.rows is None else np.flatnonzero(np.isin(self.rows, every))

    def freed(self, free: Indices, numbers: Floats) -> Assembled:
        """The same equations over another set of free coordinates, starting at ``numbers`` (N,)."""
        columns = places_in(free, len(self.layout.number))
        linear = not self.lossy and self.implicit is None and all(affine(g, columns >= 0) for g in self.groups)
        small = self.whole * len(free) <= DENSE
        scatters = tuple(group.scatter(columns) for group in self.groups) if small else ()
        implicit = self.implicit.over(columns) if self.implicit is not None else None
        return replace(self, free=free, numbers=numbers, linear=linear, implicit=implicit, _scatters=scatters)


def loss_lines(equations: Assembled) -> Iterator[tuple[LossFunction, Indices]]:
    """Each loss with the places (in m) of the residuals it acts on, shape (units, components)."""
    place = None
    if equations.rows is not None:
        place = places_in(equations.rows, equations.whole)
    for group in equations.groups:
        starts = group.first + np.arange(group.rows) * group.kernel.outputs
        for whitener_, loss in zip(group.whiteners, group.losses, strict=False):
            lines = starts[:, None] + np.arange(whitener_.first, whitener_.last)
            if place is not None:
                lines = place[lines]
                lines = lines[lines[:, 0] >= 0]
            yield loss, lines
