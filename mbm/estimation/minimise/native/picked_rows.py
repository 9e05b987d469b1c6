"""Equations that no kernel gives row by row, for consensus: Python evaluates them as a whole, a unit is what it picks.

Such are errors in measured columns, whose corrections are eliminated, and tables that are sampled where unknowns say.
"""

from __future__ import annotations

from dataclasses import field, replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.types import Floats, Indices
from mbm.equations.whitening import Whitener
from mbm.estimation.minimise.native.function import Remembered
from mbm.estimation.minimise.native.iteration import Iteration
from mbm.estimation.minimise.native.packing import rows_of, system_arrays
from mbm.estimation.minimise.native.system import ROWS_IN_PYTHON, NativeSystem
from mbm.estimation.native.callbacks import CallbackKernels
from mbm.estimation.native.code import AnyCode
from mbm.kernels.types import Kernel, Stream
from mbm.symbolic.types import ConstantInput, Slot
from mbm.values import dataclass

ANY_NUMBER, PLACE = Slot("", 0, None), ConstantInput("place")
"""What kernels of picked rows take: all numbers of a point, then where in the vector of residuals a row stands."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AllLimits:
    """The kernel of all constraints of ``equations`` together (protocol `Stream`), at points of so many ``numbers``."""

    equations: Assembled
    numbers: int

    def values(self, inputs: Floats) -> Floats:
        """Their values (rows, k); all rows are at the point of the first."""
        found = self.equations.constraint_values(inputs[0, : self.numbers].copy())
        return np.broadcast_to(found, (len(inputs), len(found)))

    def values_and_jacobian(self, inputs: Floats) -> tuple[Floats, Floats]:
        """The same, and their derivatives (rows, k · n)."""
        slopes = self.equations.constraint_jacobian(inputs[0, : self.numbers].copy()).ravel()
        return self.values(inputs), np.broadcast_to(slopes, (len(inputs), len(slopes)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PickedRows:
    """The kernel of units with so many ``components`` (protocol `Stream`), at points of so many ``numbers``."""

    remembered: Remembered
    numbers: int
    components: int

    def values(self, inputs: Floats) -> Floats:
        """The residuals (rows, components); all rows are at the point of the first."""
        return self.remembered.residuals(inputs[0, : self.numbers])[self._places(inputs)]

    def values_and_jacobian(self, inputs: Floats) -> tuple[Floats, Floats]:
        """The same, and their derivatives (rows, components · n)."""
        slopes = self.remembered.jacobian(inputs[0, : self.numbers])[self._places(inputs)]
        return self.values(inputs), slopes.reshape(len(inputs), -1)

    def _places(self, inputs: Floats) -> Indices:
        return inputs[:, self.numbers].astype(np.int64)[:, None] + np.arange(self.components)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picked:
    """Equations with a group for each equation of each group that they were made of.

    Row r of group k is the unit ``units[k][r]`` of the original equations.
    """

    equations: Assembled
    units: tuple[Indices, ...]
    kernels: CallbackKernels = field(repr=False)

    def system(self, iteration: Iteration, code: AnyCode) -> NativeSystem:
        """The equations as the solver takes them."""
        groups = (*self.equations.groups, *self.equations.constraints)
        addresses = [(self.kernels.values_address(k), self.kernels.jacobian_address(k), 0) for k in range(len(groups))]
        system, constants = system_arrays(
            self.equations,
            addresses,
            iteration,
            most_rows=[group.rows for group in groups],
            at_a_time=ROWS_IN_PYTHON,
        )
        return NativeSystem(
            system=system,
            constants=constants,
            rows=rows_of(self.equations),
            code=code,
            held=self.kernels,
            failed=self.kernels.guard.raise_failure,
        )


def picked_rows(equations: Assembled) -> Picked:
    """Equations without losses as rows that are picked from all of them, those left out by their weights not."""
    place = np.full(equations.whole, -1, dtype=np.int64)
    place[slice(None) if equations.rows is None else equations.rows] = np.arange(equations.count)
    remembered, numbers = Remembered(equations), len(equations.layout.start)
    groups: list[Group] = []
    units: list[Indices] = []
    first = first_unit = 0
    for group in equations.groups:
        firsts = group.first + np.arange(group.rows) * group.kernel.outputs
        for k, whitener in enumerate(group.whiteners):
            here = place[firsts + whitener.first]
            rows = np.flatnonzero((here >= 0) & ~group.left_out[:, k])
            own = _group(equations, group, whitener.last - whitener.first, here[rows], len(groups))
            groups.append(replace(own, first=first, first_unit=first_unit))
            units.append(group.first_unit + rows * len(group.whiteners) + k)
            first, first_unit = first + own.count, first_unit + own.rows
    streams: list[Stream] = [
        PickedRows(remembered=remembered, numbers=numbers, components=g.kernel.outputs) for g in groups
    ]
    limits = tuple(
        replace(
            _group(equations, each, len(equations.equality), np.zeros(1, dtype=np.int64), len(groups)), whiteners=()
        )
        for each in equations.constraints[:1]
    )
    if limits:
        streams.append(AllLimits(equations=equations, numbers=numbers))
    widths = [(numbers + 1, g.kernel.outputs, len(g.kernel.jacobian_rows)) for g in (*groups, *limits)]
    plain = replace(equations, groups=tuple(groups), constraints=limits, factors=None, rows=None, implicit=None)
    return Picked(
        equations=replace(plain, linear=False, _scatters=()),
        units=tuple(units),
        kernels=CallbackKernels(streams, widths),
    )


def _group(equations: Assembled, group: Group, components: int, places: Indices, number: int) -> Group:
    """Some units of an equation; ``places`` (rows,) is where their first residuals stand."""
    numbers, n, rows = len(equations.layout.start), equations.dimension, len(places)
    kernel: Kernel = replace(
        group.kernel,
        variables=(ANY_NUMBER,) * numbers,
        tangents=(ANY_NUMBER,) * n,
        parameters=(PLACE,),
        outputs=components,
        jacobian_rows=np.repeat(np.arange(components), n),
        jacobian_columns=np.tile(np.arange(n), components),
        corrections=None,
    )
    return replace(
        group,
        kernel=kernel,
        positions=None,
        index=np.broadcast_to(np.arange(numbers), (rows, numbers)),
        columns=np.broadcast_to(equations.free, (rows, n)),
        shared=(True,) * numbers,
        shared_columns=(True,) * n,
        parameters=places[:, None].astype(np.float64),
        whiteners=(Whitener(0, components, np.ones((rows, components))),),
        losses=(),
        number=number,
        sampled=(),
    )
