"""The equations of some solves at one point for each: residuals and their derivatives, solve by solve.

Quantities that are derived once in each solve, with their uncertainty, follow from them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.manifolds import numbers_of_stated, tangent_slopes
from mbm.equations.scatter import Scatter, scatter
from mbm.equations.solves import Lines, Solves
from mbm.equations.types import Floats, Indices, Mask
from mbm.equations.whitening import Whitener
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import Kept, Which, places_of
from mbm.estimation.uncertainty.derived import cannot_vary, reported
from mbm.problem.types import Derived
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Lines(Lines):
    """With ``counts`` (K,) rows of each solve, and the ``inputs`` of their kernel.

    What is data in these stays, the numbers of the unknowns are put there, from the places ``index`` (R, variables), or
    (1, variables) for all rows. ``scatter`` says where derivatives go.
    """

    counts: Indices
    index: Indices
    scatter: Scatter
    inputs: Floats


class Portion(Solves):
    """The equations of some solves, at one point for each: arrays (K, …) over the solves.

    ``most_limits`` is the largest number of constraints of a solve; what a solve has less is 0. ``kept`` and
    ``factors`` as `Ends` has them: the latter divide residuals.
    """

    lines: tuple[_Lines, ...]

    def __init__(self, stack: Stack, which: Which, kept: Kept | None = None, factors: Floats | None = None) -> None:
        size = len(which), int(stack.residuals[places_of(which)].max(initial=0))
        columns = stack.equations.columns
        found = []
        taken = np.zeros(size[0], dtype=np.int64)
        for number, group in enumerate(stack.equations.groups):
            counts = stack.rows[number, places_of(which)]
            lines = stack.lines(number, which)
            outputs = None if kept is None else kept.outputs[number]
            weight = None if factors is None else 1.0 / factors[:, group.kernel.owner][lines[0]]
            found.append(_lines(group, counts, lines, taken, outputs, weight, columns))
            taken += counts * group.kernel.outputs
        super().__init__(stack.equations, tuple(found), size, consensus=kept is not None)
        self.limits = []
        taken = np.zeros(self.count, dtype=np.int64)
        for number, group in enumerate(stack.equations.constraints, len(stack.equations.groups)):
            counts = stack.rows[number, places_of(which)]
            self.limits.append(_lines(group, counts, stack.lines(number, which), taken, None, None, columns))
            taken += counts * group.kernel.outputs
        self.most_limits = int(taken.max(initial=0))

    def as_many_rows(self, number: int) -> bool:
        """Whether all solves have as many rows of a group."""
        counts = self.lines[number].counts
        return bool((counts == counts[:1]).all())

    def values(self, number: int, points: Floats) -> Floats:
        """What a group says (R, outputs) at points (K, N), not whitened."""
        each = self.lines[number]
        return each.group.cache.stream(each.group.number, each.group.kernel).values(_inputs(each, points))

    def residuals(self, points: Floats) -> Floats:
        """Whitened residuals (K, m) at points (K, N), without losses."""
        result = np.zeros((self.count, self.most))
        for each in self.lines:
            values = each.group.cache.stream(each.group.number, each.group.kernel).values(_inputs(each, points))
            each.put(_whitened(each, values), result)
        return result

    def linearised(self, points: Floats) -> tuple[Floats, Floats]:
        """Whitened residuals (K, m), and their derivatives by a step (K, m, n), without losses."""
        width = self.equations.dimension
        result, slopes = np.zeros((self.count, self.most)), np.zeros((self.count, self.most, width))
        for each in self.lines:
            values, dense = self._sloped(each, points)
            for whitener in each.whiteners:
                part = dense[:, whitener.first : whitener.last]
                weights = whitener.weights
                if weights.ndim == 2:
                    part *= weights[:, :, None]
                else:
                    part[...] = np.einsum("rij,rjn->rin", weights, part)
            each.put(_whitened(each, values), result)
            each.put(dense, slopes)
        return result, slopes

    def constrained(self, points: Floats) -> tuple[Floats, Floats]:
        """Values (K, c) of the constraints at points (K, N), and their derivatives by a step (K, c, n)."""
        values = np.zeros((self.count, self.most_limits))
        slopes = np.zeros((self.count, self.most_limits, self.equations.dimension))
        for each in self.limits:
            found, steep = self._sloped(each, points)
            each.put(found, values)
            each.put(steep, slopes)
        return values, slopes

    def _sloped(self, each: _Lines, points: Floats) -> tuple[Floats, Floats]:
        """What a group says (R, outputs) at points (K, N), and its derivatives by a step (R, outputs, n)."""
        group = each.group
        found = group.cache.stream(group.number, group.kernel)
        values, nonzeros = found.values_and_jacobian(_inputs(each, points))
        dense = np.zeros((len(values), group.kernel.outputs, self.equations.dimension))
        each.scatter.add(nonzeros, dense)
        return values, dense


def _lines(
    group: Group,
    counts: Indices,
    lines: tuple[Indices, Indices | slice],
    taken: Indices,
    kept: Mask | None,
    weight: Floats | None,
    columns: Indices,
) -> _Lines:
    """The rows of some solves, ``counts`` (K,) of each; ``taken`` (K,) residuals stand before those of this group.

    ``lines`` as `Stack.lines` has them; ``kept`` (R, outputs) says which outputs count (None: all), ``weight`` (R,)
    multiplies the rows (None: 1); ``columns`` (M,) is the column of each coordinate, -1 where it is not free.
    """
    solve, places = lines
    own = np.arange(len(solve)) - (np.cumsum(counts) - counts)[solve]
    outputs = group.kernel.outputs
    alike = len(counts) > 0 and bool((counts == counts[0]).all() and (taken == taken[0]).all())
    slots = (taken[solve] + own * outputs)[:, None] + np.arange(outputs)
    return _Lines(
        group=group,
        counts=counts,
        solve=solve,
        slots=slots,
        kept=np.ones(slots.shape, dtype=bool) if kept is None else kept,
        place=places,
        whiteners=tuple(_taken(each, places, kept, weight) for each in group.whiteners),
        index=group.places if all(group.shared) else group.index[places],
        scatter=_scatter(group, group.touched if all(group.shared_columns) else group.columns[places], columns),
        inputs=_blank(group, group.parameters[places]),
        block=slice(int(taken[0]), int(taken[0] + counts[0] * outputs)) if alike else None,
    )


def _taken(whitener: Whitener, places: Indices | slice, kept: Mask | None, weight: Floats | None) -> Whitener:
    """The whitener of some rows; what does not count weighs nothing."""
    weights = whitener.weights[places]
    if kept is not None:
        counted = kept[:, whitener.first : whitener.last]
        weights = weights * (counted if weights.ndim == 2 else counted[:, :, None])
    if weight is not None:
        weights = weights * weight.reshape(-1, *([1] * (weights.ndim - 1)))
    return replace(whitener, weights=weights, exact=None)


def _scatter(group: Group, touched: Indices, columns: Indices) -> Scatter:
    """Where derivatives of rows go that depend on the coordinates ``touched`` (R or 1, tangents)."""
    kernel = group.kernel
    return scatter(kernel.jacobian_rows, kernel.jacobian_columns, touched, group.shared_columns, columns)


def _blank(group: Group, parameters: Floats) -> Floats:
    """Inputs of the kernel, the numbers of the unknowns still to be put there."""
    variables = group.index.shape[1]
    inputs = np.empty((len(parameters), variables + parameters.shape[1]))
    inputs[:, variables:] = parameters
    return inputs


def _inputs(lines: _Lines, points: Floats) -> Floats:
    """Inputs of the kernel, each row with the numbers of its solve; valid until the next call."""
    index = lines.index
    if len(index):
        own = lines.inputs[:, : index.shape[1]]
        if not all(lines.group.shared):
            own[...] = points[lines.solve[:, None], index]
        elif lines.block is None:
            own[...] = np.repeat(points[:, index[0]], lines.counts, axis=0)
        else:
            own.reshape(len(points), len(own) // len(points), own.shape[1])[...] = points[:, None, index[0]]
    return lines.inputs


def _whitened(lines: _Lines, values: Floats) -> Floats:
    parts = []
    for whitener in lines.whiteners:
        part, weights = values[:, whitener.first : whitener.last], whitener.weights
        parts.append(part * weights if weights.ndim == 2 else np.einsum("rij,rj->ri", weights, part))
    return parts[0] if len(parts) == 1 else np.hstack(parts)


def stated(group: Group, points: Floats) -> Floats:
    """The outputs (K, outputs) of a group of one row at points (K, N)."""
    return group.cache.stream(group.number, group.kernel).values(_inputs(_once(group, len(points)), points))


def stated_slopes(group: Group, points: Floats, equations: Assembled) -> Floats:
    """Their derivatives (K, outputs, n) by a step of the free coordinates."""
    lines = _once(group, len(points))
    nonzeros = group.cache.stream(group.number, group.kernel).values_and_jacobian(_inputs(lines, points))[1]
    result = np.zeros((len(points), group.kernel.outputs, equations.dimension))
    group.scatter(equations.columns).add(nonzeros, result)
    return result


def _once(group: Group, solves: int) -> _Lines:
    """A group of one row as that of each solve."""
    return _Lines(
        group=group,
        counts=np.ones(solves, dtype=np.int64),
        solve=np.arange(solves),
        slots=np.zeros((solves, 1), dtype=np.int64),
        kept=np.ones((solves, 1), dtype=bool),
        place=np.zeros(solves, dtype=np.int64),
        whiteners=(),
        index=group.places,
        scatter=Scatter(fixed=(), varying=()),
        inputs=_blank(group, np.repeat(group.parameters, solves, axis=0)),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DerivedColumns:
    """One derived quantity of K solves: ``values`` (K, numbers), ``sigma`` (K, size), ``gradient`` (K, size, n).

    ``image`` (K, size, n) is the gradient times a factor of the covariance.
    """

    owner: int
    group: Group
    values: Floats
    sigma: Floats
    gradient: Floats
    image: Floats


@np.errstate(all="ignore")
def derived_columns(quantity: Derived, owner: int, stack: Stack, points: Floats, factor: Floats) -> DerivedColumns:
    """A derived quantity at points (K, N), with the covariance ``factor @ factorᵀ`` (K, n, n) of the estimates."""
    group = stack.derived[owner][0]
    values = stated(group, points)
    gradient = stated_slopes(group, points, stack.equations)
    if quantity.kind is not None:
        gradient = tangent_slopes(quantity.kind, quantity.dimension, values, gradient)
        values = numbers_of_stated(quantity.kind, quantity.dimension, values)
    image = np.matmul(gradient, factor)
    sigma = np.sqrt(np.square(image).sum(axis=2))
    if quantity.kind is None:
        held = cannot_vary(values, sigma)
        gradient[held], image[held], sigma[held] = 0.0, 0.0, 0.0
        values = reported(quantity, values)
    return DerivedColumns(owner=owner, group=group, values=values, sigma=sigma, gradient=gradient, image=image)
