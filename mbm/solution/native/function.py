"""Equations that Python evaluates as a whole, for the compiled solver: residuals and Jacobian are one fused kernel."""

from __future__ import annotations

import ctypes
from dataclasses import field
from functools import cache
from typing import Any

import numpy as np

from mbm.solution.assembly import Assembled
from mbm.solution.forwarding import Forwarding
from mbm.solution.native.callbacks import Guard, address_of, memory
from mbm.solution.native.code import AnyCode, NativeCode
from mbm.solution.native.packing import Fused, Rows, function_arrays
from mbm.solution.native.system import NativeSystem, iteration_of, native_code
from mbm.solution.settings import Settings
from mbm.solution.types import Equations, Floats
from mbm.target.solver import description as of
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
    _residuals: Floats | None = None
    _jacobian: Floats | None = None

    def residuals(self, point: Floats) -> Floats:
        """Those (m,) at a point (N,)."""
        if self._point is None or self._residuals is None or not np.array_equal(point, self._point):
            self._point, self._jacobian = point.copy(), None
            self._residuals = self.equations.residuals(self._point)
        return self._residuals

    def jacobian(self, point: Floats) -> Floats:
        """That (m, n) at a point."""
        self.residuals(point)
        if self._jacobian is None:
            self._jacobian = self.equations.jacobian(point.copy())
        return self._jacobian


@dataclass(slots=True, kw_only=True, eq=False)
class Function:
    """Residuals and Jacobian of ``equations`` as kernels, at points of so many ``numbers``."""

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


def system_of_function(equations: Equations, settings: Settings) -> NativeSystem:
    """Any equations for the native solver: their residuals and Jacobian are asked for as `Equations` has them."""
    base = underlying(equations)
    function = Function(equations=equations, numbers=equations.dimension if base is None else len(base.layout.start))
    system, constants = function_arrays(
        equations, base, iteration_of(equations, settings, direct=None, strict=False), function.fused()
    )
    none, nowhere = np.zeros(1), np.zeros(1, dtype=np.int64)
    data = np.array([[equations.count]], dtype=np.int64)
    return NativeSystem(
        system=system,
        constants=constants,
        rows=Rows(parameters=none, weights=none, index=nowhere, columns=nowhere, data=data),
        code=_code(base),
        held=function,
        failed=function.guard.raise_failure,
    )


def _code(base: Assembled | None) -> AnyCode:
    if base is None or not base.groups:
        return solver_code()
    return native_code(base.groups[0].cache).solver
