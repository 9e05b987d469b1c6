"""Equations that Python evaluates as a whole, for the compiled solver, and unit by unit for consensus."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import field, replace
from functools import cache
from typing import Any, cast

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.metric import Forwarding
from mbm.equations.types import Equations, Floats, Indices
from mbm.equations.whitening import Whitener
from mbm.estimation.minimise.constrained.types import ConstrainedEquations
from mbm.estimation.minimise.native.iteration import Iteration, iteration_of
from mbm.estimation.minimise.native.packing import Fused, Limits, Rows, function_arrays, rows_of, system_arrays
from mbm.estimation.minimise.native.system import ROWS_IN_PYTHON, NativeSystem
from mbm.estimation.native.callbacks import KERNEL, CallbackKernels, Guard, address_of, memory
from mbm.estimation.native.code import AnyCode, NativeCode, native_code
from mbm.estimation.settings import Settings
from mbm.kernels.types import Kernel, Stream
from mbm.machine.kinds import LANES
from mbm.solver import description as of
from mbm.symbolic.types import ConstantInput, Slot
from mbm.values import dataclass

CALL = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)
"""The signature of ``call_fused``."""


@dataclass(slots=True, eq=False)
class Remembered:
    """Equations with what they were at the last point: several kernels ask for parts of it.

    Used by one thread at a time: equations keep what they evaluate with.
    """

    equations: Equations
    _point: Floats | None = None
    _parts: dict[str, Floats] = field(default_factory=dict)

    def residuals(self, point: Floats) -> Floats:
        """Those (m,) at a point (N,)."""
        return self._once("residuals", self.equations.residuals, point)

    def jacobian(self, point: Floats) -> Floats:
        """That (m, n) at a point."""
        return self._once("jacobian", self.equations.jacobian, point)

    def constraint_values(self, point: Floats) -> Floats:
        """Those (k,) at a point."""
        return self._once("values", self.limited.constraint_values, point)

    def constraint_jacobian(self, point: Floats) -> Floats:
        """Their derivatives (k, n) at a point."""
        return self._once("slopes", self.limited.constraint_jacobian, point)

    @property
    def limited(self) -> ConstrainedEquations:
        """The equations, as those that have constraints."""
        return cast(ConstrainedEquations, self.equations)

    def _once(self, part: str, evaluated: Callable[[Floats], Floats], point: Floats) -> Floats:
        if self._point is None or not np.array_equal(point, self._point):
            self._point = point.copy()
            self._parts.clear()
        found = self._parts.get(part)
        if found is None:
            found = self._parts[part] = evaluated(self._point)
        return found


@dataclass(slots=True, kw_only=True, eq=False)
class Function:
    """What ``equations`` have, residuals and constraints, as kernels, at points of so many ``numbers``."""

    equations: Equations
    numbers: int
    guard: Guard = field(default_factory=Guard)
    _remembered: Remembered = field(init=False)
    _held: tuple[Any, ...] = field(default=())

    def __post_init__(self) -> None:
        self._remembered = Remembered(self.equations)

    def fused(self) -> Fused:
        """What the solver is told of them; the callbacks live as long as this object does."""
        self._held = (CALL(self._values), CALL(self._slopes))
        head = np.zeros(of.FUSED, dtype=np.int64)
        head[of.Fused.values], head[of.Fused.jacobian] = (address_of(callback) for callback in self._held)
        head[of.Fused.residuals] = self.equations.count
        return Fused(table=head, reals=1, library=self)

    def limits(self) -> Limits:
        """The same of the constraints."""
        callbacks = KERNEL(self._limits), KERNEL(self._limit_slopes)
        self._held = (*self._held, *callbacks)
        values, jacobian = (address_of(callback) for callback in callbacks)
        return Limits(values=values, jacobian=jacobian, equality=self._remembered.limited.equality)

    def _limits(self, given: int, target: int, _blocks: int) -> None:
        found = memory(target, LANES * len(self._remembered.limited.equality)).reshape(-1, LANES)

        def evaluate() -> None:
            found[...] = self._remembered.constraint_values(self._first_lane(given))[:, None]

        self.guard.fill(found, evaluate)

    def _limit_slopes(self, given: int, target: int, _blocks: int) -> None:
        count = len(self._remembered.limited.equality)
        found = memory(target, LANES * count * (1 + self.equations.dimension)).reshape(-1, LANES)

        def evaluate() -> None:
            here = self._first_lane(given)
            found[:count] = self._remembered.constraint_values(here)[:, None]
            found[count:] = self._remembered.constraint_jacobian(here).reshape(-1, 1)

        self.guard.fill(found, evaluate)

    def _first_lane(self, given: int) -> Floats:
        """A point as a kernel is given it; all lanes are equal."""
        return memory(given, LANES * self.numbers)[::LANES]

    def _values(self, point: int, _data: int, target: int, _stride: int) -> None:
        found = memory(target, self.equations.count)

        def evaluate() -> None:
            found[:] = self._remembered.residuals(memory(point, self.numbers))

        self.guard.fill(found, evaluate)

    def _slopes(self, point: int, _data: int, target: int, stride: int) -> None:
        equations = self.equations
        found = memory(target, (equations.dimension + 1) * stride).reshape(-1, stride)[:, : equations.count]

        def evaluate() -> None:
            here = memory(point, self.numbers)
            found[-1], found[:-1] = self._remembered.residuals(here), self._remembered.jacobian(here).T

        self.guard.fill(found, evaluate)


def underlying(equations: Equations) -> Assembled | None:
    """The equations of a problem that others are made of; None: these are none of a problem."""
    while isinstance(equations, Forwarding):
        equations = equations.equations
    return equations if isinstance(equations, Assembled) else None


@cache
def solver_code() -> AnyCode:
    """The solver for equations that belong to no problem, kept for this process only."""
    return NativeCode(None).solver


def system_of_function(equations: Equations, settings: Settings, *, constrained: bool = False) -> NativeSystem:
    """Any equations for the native solver: their residuals and Jacobian are asked for as `Equations` has them.

    ``constrained``: their constraints as well.
    """
    base = underlying(equations)
    function = Function(equations=equations, numbers=equations.dimension if base is None else len(base.layout.start))
    system, constants = function_arrays(
        equations,
        base,
        iteration_of(equations, settings, direct=False if constrained else None, strict=False),
        function.fused(),
        function.limits() if constrained else None,
    )
    none = np.zeros(1)
    places = np.arange(max(function.numbers, equations.dimension))
    data = np.array([[equations.count, *(constrained * [0, 0, 0, 0, 1])]], dtype=np.int64)
    return NativeSystem(
        system=system,
        constants=constants,
        rows=Rows(parameters=none, weights=none, index=places, columns=places, data=data),
        code=_code(base),
        held=function,
        failed=function.guard.raise_failure,
    )


def _code(base: Assembled | None) -> AnyCode:
    if base is None or not base.groups:
        return solver_code()
    return native_code(base.groups[0].cache).solver


ANY_NUMBER, PLACE = Slot("", 0, None), ConstantInput("place")
"""What kernels of picked rows take: all numbers of a point, then where in the vector of residuals a row stands."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AllLimits:
    """The kernel of all constraints of equations together (protocol `Stream`), at points of so many ``numbers``."""

    remembered: Remembered
    numbers: int

    def values(self, inputs: Floats) -> Floats:
        """Their values (rows, k); all rows are at the point of the first."""
        found = self.remembered.constraint_values(inputs[0, : self.numbers])
        return np.broadcast_to(found, (len(inputs), len(found)))

    def values_and_jacobian(self, inputs: Floats) -> tuple[Floats, Floats]:
        """The same, and their derivatives (rows, k · n)."""
        slopes = self.remembered.constraint_jacobian(inputs[0, : self.numbers]).ravel()
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
        streams.append(AllLimits(remembered=remembered, numbers=numbers))
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
        dependence=np.ones((components * n, n), dtype=bool),
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
